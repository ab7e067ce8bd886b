"""A fit linearised about the quoted values: the basis of uncertainty budget, influence and doubts.

The base fit and the loop's result differ only in their covariance. It contains the noise of trials
and the stated errors. Effects, the uncertainty of their form and residual structure are further
columns of unit-variance unknowns in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.fit import deletion, held_quantity, information, inputs
from nearlift.fit.least_squares import AT_BOUND, LeastSquaresFit
from nearlift.likelihood import budget, student
from nearlift.likelihood.budget import Component
from nearlift.likelihood.problem import Likelihood
from nearlift.results.fit import ModelFit
from nearlift.results.quotation import (
    LEVELS,
    BoundaryResult,
    BudgetLine,
    CoefficientResult,
    Correlation,
    Doubt,
    LargestShifts,
    Shift,
)

#: A source whose contribution and whose removal change an uncertainty by less than this fraction
#: has no line. It would be rounding, and u is printed to two digits.
NO_LINE = 1e-6
#: Shift by an undeclared input, in standard uncertainties, up to which it is no doubt: it would
#: widen u by sqrt(1 + 0.3^2), 4 %.
WORTH_TELLING = 0.3
#: Undeclared inputs: name, factor to the unit shown, and that unit.
INPUTS = {
    "rotor_radius": ("rotor radius", 1e2, "%"),
    "rotor_spacing": ("rotor spacing", 1e2, "%"),
    "height": ("distance datum", 1e3, "mm"),
}
#: `reason` until `diagnose` has run.
NOT_LOOKED_AT = "`nearlift diagnose` has not run"
#: Intervals agree where their ends differ by at most this many standard uncertainties. Ours: it
#: moves a 90 % interval's coverage by less than 4 %.
SAME_END = 0.25


@dataclass(frozen=True, kw_only=True)
class Estimator:
    """A linearised fit of p coefficients.

    Attributes
    ----------
    problem : Likelihood
        With every error in its covariance.
    theta : (p,)
        The values quoted.
    u, dof : (p,)
        Standard uncertainty and its degrees of freedom; u is infinite for an undetermined
        coefficient.
    gain : (p, n)
        Change of each coefficient per unit change of each trial's log lift.
    lines : list of Line
        The budget.
    parts : tuple of Component
        Stated uncertainties.
    slope : (n,)
        d log ratio / dz there.
    fixed : (p,) mask
        At a bound, or undetermined.
    """

    problem: Likelihood
    theta: FloatArray
    u: FloatArray
    dof: FloatArray
    gain: FloatArray
    lines: list[information.Line]
    parts: tuple[Component, ...]
    slope: FloatArray
    fixed: NDArray[np.bool_]

    @classmethod
    def from_fit(cls, fit: LeastSquaresFit) -> Estimator:
        """The estimator of a base fit."""
        estimates = fit.estimates.values()
        return cls(
            problem=fit.problem,
            theta=fit.theta,
            u=np.array([e.u for e in estimates]),
            dof=fit.effective,
            gain=fit.gain,
            lines=information.lines(fit.problem, fit.gain, fit.parts, fit.noise, fit.slope),
            parts=fit.parts,
            slope=fit.slope,
            fixed=np.array([e.at_bound or not np.isfinite(e.u) for e in estimates], dtype=bool),
        )

    def quoted(
        self,
        i: int,
        readings: Sequence[student.Mixture],
        holds: str,
        doubts: Sequence[Doubt],
        which: str = "",
        answers: int = 1,
    ) -> CoefficientResult:
        """Result of coefficient i over `readings`, this estimator's first; `which` is the budget
        source by which several answers differ, `answers` their number.
        """
        parameter, dof = self.problem.model.parameters[i], float(self.dof[i])
        low, high = parameter.bounds
        unbounded = ends(readings, dof, (-np.inf, np.inf))
        # with several answers u follows from the width of the interval over all
        width, u = unbounded["hi90"] - unbounded["lo90"], readings[0][0][2]
        if (len(readings) > 1 or len(readings[0]) > 1) and np.isfinite(width):
            u = width / (2 * student.quantile(0.95, dof))
        cut = [
            f"{bound:g}"
            for bound, beyond in ((low, unbounded["lo90"] < low), (high, unbounded["hi90"] > high))
            if beyond
        ]
        value = float(self.theta[i])
        return CoefficientResult(
            value=value,
            u=float(u),
            dof=dof,
            unit=parameter.unit,
            **ends(readings, dof, parameter.bounds),
            holds=holds
            + "."
            + (f" Cut off at {' and '.join(cut)}, the bound of {parameter.name}." if cut else ""),
            budget=self._budget(i, float(u), which),
            influence=self._influence[parameter.name],
            doubts=tuple(doubts),
            at_bound=bool(
                np.isfinite(high - low) and min(value - low, high - value) < AT_BOUND * (high - low)
            ),
            answers=answers,
            warning=None,
        )

    def doubt(self, i: int, condition: str, value: float, u: float) -> Doubt:
        """An alternative answer with the degrees of freedom of coefficient i."""
        bounds = self.problem.model.parameters[i].bounds
        e = ends([((1.0, value, u),)], float(self.dof[i]), bounds)
        return Doubt(condition=condition, value=value, lo90=e["lo90"], hi90=e["hi90"])

    def _budget(self, i: int, u: float, which: str) -> tuple[BudgetLine, ...]:
        """Budget lines of coefficient i, largest first; the excess of `u` over this estimator's is
        the difference between answers.
        """
        apart = float(np.sqrt(max(u**2 - self.u[i] ** 2, 0.0))) if np.isfinite(u) else 0.0
        budget = []
        # lines come from the linearised estimator, u may come from the nonlinear model
        linear = float(np.sqrt(sum(line.variance[i] for line in self.lines)))
        scale = float(self.u[i]) / linear if linear > 0 and np.isfinite(self.u[i]) else 1.0
        for line in self.lines:
            u_line = scale * float(np.sqrt(line.variance[i]))
            left = float(np.hypot(self._without[line.component][i], apart))
            if u_line > NO_LINE * u or left < (1 - NO_LINE) * u:
                budget.append(
                    BudgetLine(
                        source=line.component,
                        kind=line.kind,
                        u=u_line,
                        u_without=left,
                        distribution=line.distribution,
                        scope=line.scope,
                        dof=float(np.broadcast_to(line.dof, len(self.theta))[i]),
                        u_input=line.standard if line.unit else None,
                        unit=line.unit,
                        sensitivity=float(line.sensitivity[i]) if line.unit else None,
                    )
                )
        if which and apart > NO_LINE * u:
            budget.append(BudgetLine(source=which, kind="B", u=apart, u_without=float(self.u[i])))
        return tuple(sorted(budget, key=lambda line: -line.u))

    @cached_property
    def _without(self) -> dict[str, FloatArray]:
        """Standard uncertainties if one source of error were known exactly, by its name."""
        u = np.where(np.isfinite(self.u), self.u, 0.0)
        jacobian = self.problem.jacobian(self.theta)
        return information.u_without(self.problem, jacobian, self.lines, u)

    @cached_property
    def _influence(self) -> dict[str, LargestShifts]:
        """The trial and visit whose deletion shifts each coefficient most, scatter held."""
        data, free = self.problem.data, [int(i) for i in np.flatnonzero(~self.fixed)]
        moved = deletion.influence_on(self.problem, self.theta, free)
        return {
            name: LargestShifts(
                trial=largest(data.trial, moved.of_trial[:, i], data.trial, data.z_hat),
                visit=largest(moved.visit, moved.of_visit[:, i], data.visit, data.z_hat),
            )
            for i, name in enumerate(self.problem.names)
        }

    def doubts(self, *, exponents: bool = True) -> list[list[Doubt]]:
        """Each coefficient with uncertain inputs that are not stated, and at other `exponents`."""
        listed: list[list[Doubt]] = [[] for _ in self.theta]
        if not len(self.theta):
            return listed
        if exponents and np.isfinite(self.u[0]):
            listed[0] += [self.doubt(0, *answer) for answer in self._exponents()]
        for missing in inputs.undeclared(
            self.problem, self.theta, self.gain, self.parts, self.slope
        ):
            for i, shift in enumerate(missing.shift.values()):
                if np.isfinite(self.u[i]) and abs(shift) > WORTH_TELLING * self.u[i]:
                    name, scale, unit = INPUTS[missing.on]
                    condition = (
                        f"{scale * missing.size:g} {unit} uncertainty of the {name},"
                        " which the manifest does not state"
                    )
                    listed[i].append(
                        self.doubt(
                            i, condition, float(self.theta[i]), float(np.hypot(self.u[i], shift))
                        )
                    )
        return listed

    def _exponents(self) -> Iterator[tuple[str, float, float]]:
        """Condition, value and u of the first coefficient at a free exponent and 2/3."""
        problem = self.problem
        if free := held_quantity.free_exponent(problem, self.theta):
            yield "free exponent of the lift ratio", *free[2:]
        for _, value, u in held_quantity.at_exponents(problem, self.theta, [held_quantity.POWER]):
            yield "constant power instead of constant throttle (exponent 2/3)", value, u


def ends(
    readings: Sequence[student.Mixture], dof: float, bounds: tuple[float, float]
) -> dict[str, float]:
    """Ends lo68 to hi95 of the interval over `readings` (`student.interval`), within `bounds`."""
    cut: dict[str, float] = {}
    for level in LEVELS:
        low, high = np.clip(student.interval(level / 100, readings, dof), *bounds).tolist()
        cut |= {f"lo{level}": low, f"hi{level}": high}
    return cut


def largest(
    ids: NDArray[np.generic], shift: FloatArray, of: NDArray[np.generic], z_hat: FloatArray
) -> Shift | None:
    """The largest finite shift (m,) among trials or visits `ids` (m,); `of` (n,) is the id of each
    trial, `z_hat` (n,) its distance.
    """
    if not np.isfinite(shift).any():
        return None
    i = int(np.nanargmax(np.abs(shift)))
    return Shift.at(float(np.mean(z_hat[of == ids[i]])), str(ids[i]), float(shift[i]))


def base_result(
    fit: LeastSquaresFit, entry: ModelFit, reason: str = NOT_LOOKED_AT, wanted: str = ""
) -> BoundaryResult:
    """A boundary's result before or without the loop; `entry` is the model's in fit.json."""
    estimator = Estimator.from_fit(fit)
    noise = fit.noise.source.partition(" (")[0]
    errors = " and ".join([f"the {noise}", *budget.stated(fit.parts)])
    holds = f"Includes {errors}, but no effect: the residuals were not diagnosed"
    doubts, shapes = estimator.doubts(), shape_doubts(entry)
    correlation = information.correlation(fit.covariance)
    return BoundaryResult(
        verdict="not_diagnosed",
        reason=reason,
        wanted=wanted,
        base_model=fit.model.name,
        coefficients={
            name: estimator.quoted(
                i,
                [((1.0, float(fit.theta[i]), float(estimator.u[i])),)],
                holds,
                [*doubts[i], *shapes[name]],
            )
            for i, name in enumerate(fit.names)
        },
        correlation=Correlation(
            parameters=fit.names, values=tuple(tuple(row) for row in correlation.tolist())
        ),
    )


def shape_doubts(entry: ModelFit) -> dict[str, list[Doubt]]:
    """Profile and posterior intervals that differ from the fit's by `SAME_END`, by coefficient."""
    doubts: dict[str, list[Doubt]] = {}
    for name, e in entry.parameters.items():
        doubts[name] = []
        drawn = entry.posterior.parameters.get(name) if entry.posterior else None
        if not e.u or not math.isfinite(e.lo90):
            continue
        low, high = drawn.prior.bounds if drawn else (-math.inf, math.inf)
        others = []
        if profile := entry.profiles.get(name):
            ends = (
                low if math.isnan(profile.lo90) else profile.lo90,
                high if math.isnan(profile.hi90) else profile.hi90,
            )
            others.append(("interval from the profile likelihood", e.value, *ends))
        if drawn:
            others.append(
                (
                    "posterior, with the declared prior",
                    drawn.median,
                    drawn.lo90,
                    drawn.hi90,
                )
            )
        plain_low, plain_high = max(e.lo90, low), min(e.hi90, high)
        for condition, value, lo90, hi90 in others:
            apart = max(abs(lo90 - plain_low), abs(hi90 - plain_high))
            if apart > SAME_END * e.u and math.isfinite(lo90) and math.isfinite(hi90):
                doubts[name].append(Doubt(condition=condition, value=value, lo90=lo90, hi90=hi90))
    return doubts
