"""What is quoted of flights: gain and decay length of the boundary, and the base model's
coefficients only where the log can tell them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nearlift import catalogue
from nearlift.declare import Boundary, FloatArray, LiftModel
from nearlift.errors import NotConverged
from nearlift.fit import closed_loop
from nearlift.fit.closed_loop import POWERS, Solved, Windows, since_start
from nearlift.likelihood import student
from nearlift.likelihood.covariance import Covariance
from nearlift.likelihood.problem import Problem
from nearlift.manifest.campaign import Campaign
from nearlift.readers.flights import HISTORY_S
from nearlift.results import Observations
from nearlift.results.quotation import (
    LEVELS,
    BoundaryResult,
    BudgetLine,
    CoefficientResult,
    Doubt,
    LargestShifts,
    Shift,
    ends,
)
from nearlift.run.job import Job
from nearlift.run.store import Table
from nearlift.stages import hovering
from nearlift.stages.observe import observe

#: Names and units of what flights determine, as `closed_loop.gains` has them.
DETERMINED = (("gain_at_2", "1"), ("decay_length", "rotor radii"))
#: Windows, and starts, without which the gain is solved for to see which moves it most.
TRIES = 4
#: Where the set-point stood at a window's middle; without it nothing parts lift from feedback.
SETPOINT = "setpoint_m_0"
HOLDS = {
    True: (
        "Holds feedback, by the set-point's history as instruments, what stretches of flight left"
        " out would change, and the forms that a gain may fall off by"
    ),
    False: (
        "Holds feedback, by any power of the command from"
        f" {POWERS[0]:g} to {POWERS[1]:g}, since no set-point was logged; what stretches of flight"
        " left out would change, and the forms that a gain may fall off by"
    ),
}
NO_SETPOINT = (
    "refused: in closed loop the command answers the disturbances, which biases it by more than its"
    " scatter; log the height's set-point and name it under [flight]"
)
NO_HEIGHT = (
    "refused: it hangs on the height of the rotor plane above the feet, whose uncertainty nobody"
    ' declared; add [[uncertainty]] on = "height", scope = "campaign"'
)


def refusal(campaign: Campaign, data: Observations) -> str:
    """Why no fit to these flights can tell a base model's coefficients; empty where one may."""
    if campaign.flight is None:
        return ""
    if SETPOINT not in data.covariates:
        return NO_SETPOINT
    return "" if _u_height_m(campaign) else NO_HEIGHT


def _u_height_m(campaign: Campaign) -> float:
    """The declared standard uncertainty of every height at once."""
    return math.sqrt(
        sum(
            u.standard() ** 2
            for u in campaign.uncertainty
            if u.on == "height" and u.scope in ("campaign", "boundary")
        )
    )


def quoted(
    job: Job, trials: Table, results: Mapping[Boundary, BoundaryResult]
) -> tuple[dict[Boundary, BoundaryResult], list[str]]:
    """The results with what flights say put in, and notes; as they are of a tethered campaign."""
    answers, notes = dict(results), list[str]()
    if job.campaign.flight is None:
        return answers, notes
    for boundary, result in results.items():
        data = observe(trials, job.campaign, boundary)
        one = Determined(job.campaign, data)
        try:
            determined = one.determined()
        except NotConverged as fault:
            notes.append(f"{boundary}: {fault.where} {fault.what}: {fault.remedy}")
            determined = None
        model = catalogue.model(result.base_model)
        coefficients = one.coefficients(model, result.coefficients)
        hover = hovering.compared(job.campaign, trials, boundary)
        answers[boundary] = replace(
            result, coefficients=coefficients, in_flight=determined, hover=tuple(hover) or None
        )
        notes += [f"{boundary}: {comparison.text}" for comparison in hover]
        notes += [f"{boundary}: {name} is {why}" for name, why in answers[boundary].refused.items()]
        if determined is not None:
            gain, decay = (determined[name] for name, _ in DETERMINED)
            notes.append(
                f"{boundary}: the gain at two radii is {gain.estimate} of lift (90 %:"
                f" {gain.interval}); it decays over {decay.estimate} radii (90 %: {decay.interval})"
            )
    return answers, notes


@dataclass(frozen=True, slots=True, kw_only=True)
class _Answer:
    """Coefficients by one form, their standard uncertainties by source, (p,) each."""

    theta: FloatArray
    dof: int
    sources: Mapping[str, FloatArray]

    @property
    def u(self) -> FloatArray:
        return np.sqrt(sum(u**2 for u in self.sources.values()))


class Determined:
    """The flights near one boundary."""

    def __init__(self, campaign: Campaign, data: Observations) -> None:
        known, vehicle = data.covariates, campaign.vehicle
        self.data = data
        self.has_setpoint = SETPOINT in known
        self.why_refused = refusal(campaign, data)
        instruments = None
        # no disturbance of the height moves it: it is an instrument of its own
        aside = [known["level_speed_m_s"] ** 2] if "level_speed_m_s" in known else []
        label = data.flight_start
        if self.has_setpoint:
            history = np.stack([known[f"setpoint_m_{k}"] for k in range(len(HISTORY_S))], axis=1)
            shapes = closed_loop.instruments_of(
                history, campaign.rig.offset(data.boundary), vehicle.rotor_radius
            )
            count = since_start(label)
            since = count / max(int(count.max()), 1)
            instruments = np.hstack([shapes, np.stack([since, since**2, *aside], axis=1)])
        regressors = [known["climb_m_s"], *aside]
        regressors += [np.log(known["supply_V"])] if "supply_V" in known else []
        self.windows = Windows(
            log_lift=np.log(data.lift_N),
            log_command=np.log(data.throttle),
            beside=np.stack(regressors, axis=1),
            z_hat=data.z_hat,
            start=label,
            instruments=instruments,
        )
        self.lag = known["lag_slope"] * known["u_lag_s"]
        self.u_height = _u_height_m(campaign) / vehicle.rotor_radius

    def determined(self) -> dict[str, CoefficientResult]:
        """Gain at two radii and decay length; raises NotConverged where no window tells."""
        powers = (None,) if self.has_setpoint else (None, *POWERS)
        solved = [(p, *each) for p in powers for each in closed_loop.gains(self.windows, p)]
        answers = [
            self._answer(solution, _of_form(form), power, closed_loop.BELIEVED)
            for power, form, solution in solved
        ]
        _, form, first = solved[0]
        holds, moves = HOLDS[self.has_setpoint], self._moves(form, first.theta)
        return {
            name: replace(
                _result(answers, k, unit, (-math.inf, math.inf), holds, turn=math.exp),
                influence=moves[k],
            )
            for k, (name, unit) in enumerate(DETERMINED)
        }

    def _moves(self, form: float, theta: FloatArray) -> list[LargestShifts]:
        """The single window, and the single start, without which gain and decay length move
        farthest: the closed form says where to look, and a solution without it decides.
        """
        data, start = self.data, self.windows.start
        each = closed_loop.without_each(self.windows, _of_form(form)(self.windows), theta)
        of_start = np.zeros((int(start.max()) + 1, len(theta)))
        np.add.at(of_start, start, each)

        def moved(out: NDArray[np.bool_]) -> FloatArray:
            kept = self.windows.taken(~out)
            try:
                other = closed_loop.solve(
                    kept, _of_form(form)(kept), theta, believed=closed_loop.BELIEVED
                )
            except NotConverged:
                return np.zeros(len(theta))
            return np.asarray(np.exp(other.theta) - np.exp(theta))

        def farthest(by: FloatArray, label: NDArray[np.int64]) -> list[tuple[int, float]]:
            look = {i for k in range(len(theta)) for i in np.argsort(-np.abs(by[:, k]))[:TRIES]}
            shifts = {int(i): moved(label == i) for i in look}
            most = [max(shifts, key=lambda i: abs(shifts[i][k])) for k in range(len(theta))]
            return [(i, float(shifts[i][k])) for k, i in enumerate(most)]

        trials = farthest(each, np.arange(data.n))
        starts = farthest(of_start, start)
        return [
            LargestShifts(
                trial=Shift.at(float(data.z_hat[i]), str(data.trial[i]), shift),
                visit=Shift(id=self._start(j), shift=other),
            )
            for (i, shift), (j, other) in zip(trials, starts, strict=True)
        ]

    def _start(self, number: int) -> str:
        """What a start is called: its log, and which of the log's it is."""
        i = int(np.argmax(self.windows.start == number))
        log, _, _ = str(self.data.trial[i]).rpartition("#")
        return f"{log}, start {self.data.covariates['flight'][i]:g}"

    def coefficients(
        self, model: LiftModel, given: Mapping[str, CoefficientResult]
    ) -> dict[str, CoefficientResult]:
        """The base model's coefficients by the instruments; refused where they cannot be told."""
        if not (why := self.why_refused):
            start = np.array([given[p.name].value for p in model.parameters])
            ratio_of = _of_model(model, self.data)
            try:
                ratio = ratio_of(self.windows)
                answer = self._answer(closed_loop.solve(self.windows, ratio, start), ratio_of)
            except NotConverged as fault:
                why = f"refused: it {fault.what}; {fault.remedy}"
        if why:
            return {
                p.name: _refused(given[p.name], p.bounds, why) if p.name in given else given[p.name]
                for p in model.parameters
            }
        holds = "Holds feedback, by the set-point's history as instruments, and the declared height"
        return {
            p.name: _result(
                [answer], k, p.unit, p.bounds, holds, (*given[p.name].doubts, _plain(given[p.name]))
            )
            for k, p in enumerate(model.parameters)
        }

    def _answer(
        self,
        solution: Solved,
        ratio_of: Callable[[Windows], closed_loop.Ratio],
        power: float | None = None,
        believed: tuple[FloatArray, FloatArray] | None = None,
    ) -> _Answer:
        """A solution with what the lag and the height of the rotor plane add to its uncertainty."""
        sources = {"stretches of flight": np.sqrt(np.maximum(np.diag(solution.covariance), 0.0))}
        moves = {"motor lag": self.windows.moved(log_lift=-self.lag)} if self.lag.any() else {}
        if self.u_height:
            moves["height of the rotor plane"] = self.windows.moved(z_hat=self.u_height)
        for name, windows in moves.items():
            other = closed_loop.solve(windows, ratio_of(windows), solution.theta, power, believed)
            sources[name] = np.abs(other.theta - solution.theta)
        return _Answer(theta=solution.theta, dof=solution.dof, sources=sources)


def _of_form(form: float) -> Callable[[Windows], closed_loop.Ratio]:
    return lambda windows: closed_loop.decaying(windows.z_hat, form)


def _of_model(model: LiftModel, data: Observations) -> Callable[[Windows], closed_loop.Ratio]:
    """A lift model as `closed_loop` takes it."""
    n = data.n
    alone = Covariance(
        variance=np.ones(n), visit=data.visit, per_visit=np.zeros(n), shared=np.zeros((n, 0))
    )

    def ratio_at(windows: Windows) -> closed_loop.Ratio:
        problem = Problem(model=model, data=replace(data, z_hat=windows.z_hat), covariance=alone)
        low, high = model.bounds

        def ratio(theta: FloatArray) -> tuple[FloatArray, FloatArray]:
            inside = np.clip(theta, low, high)
            return problem.log_ratio(inside), problem.jacobian(inside)

        return ratio

    return ratio_at


def _result(
    answers: list[_Answer],
    k: int,
    unit: str,
    bounds: tuple[float, float],
    holds: str,
    doubts: tuple[Doubt, ...] = (),
    turn: Callable[[float], float] = float,
) -> CoefficientResult:
    """One coefficient over every answer that may be right; the first is its value. `turn` makes it
    of what was solved for.
    """
    dof = min(a.dof for a in answers)
    reach = {level: student.quantile(0.5 + level / 200, dof) for level in LEVELS}
    spans = [(float(a.theta[k]), float(a.u[k])) for a in answers]
    whole = {name: turn(end) for name, end in ends(spans, reach, bounds).items()}
    first, value = answers[0], turn(spans[0][0])
    u = (whole["hi90"] - whole["lo90"]) / (2 * reach[90])
    # what a change of what was solved for is worth
    scale = abs(turn(spans[0][0] + 1e-6) - value) / 1e-6
    budget = tuple(
        BudgetLine(
            source=name,
            kind="A" if name != "height of the rotor plane" else "B",
            u=scale * float(part[k]),
            u_without=scale * math.sqrt(max(float(first.u[k]) ** 2 - float(part[k]) ** 2, 0.0)),
        )
        for name, part in first.sources.items()
    )
    return CoefficientResult(
        value=value,
        u=u,
        dof=float(dof),
        unit=unit,
        lo68=whole["lo68"],
        hi68=whole["hi68"],
        lo90=whole["lo90"],
        hi90=whole["hi90"],
        lo95=whole["lo95"],
        hi95=whole["hi95"],
        holds=holds,
        budget=budget,
        doubts=doubts,
    )


def _plain(given: CoefficientResult) -> Doubt:
    return Doubt(
        condition="the command answers no disturbance (least squares)",
        value=given.value,
        lo90=given.lo90,
        hi90=given.hi90,
    )


def _refused(given: CoefficientResult, bounds: tuple[float, float], why: str) -> CoefficientResult:
    """A coefficient that these flights cannot tell: known to no more than its declared range."""
    low, high = bounds
    return replace(
        given,
        u=math.inf,
        dof=0.0,
        lo68=low,
        hi68=high,
        lo90=low,
        hi90=high,
        lo95=low,
        hi95=high,
        holds=why,
        refused=why,
        budget=(),
        influence=LargestShifts(),
        doubts=(*given.doubts, _plain(given)),
    )
