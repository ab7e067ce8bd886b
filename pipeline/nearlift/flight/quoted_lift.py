"""Lift of each boundary as it is quoted, for flights, detection and exports.

An identified effect of the vehicle, such as supply sag, is part of the model. One of the bench,
such as a drift, is not; only the coefficient that it corrected is used. Values and intervals are
the most probable explanation's where effects are identified, else those quoted. Draws have the ends
of these intervals and their correlation. What no interval bounds is drawn from its declared prior:
it is not known, and does not fly as if it were.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import catalogue
from nearlift.campaign.manifest import Campaign, boundaries_of
from nearlift.declare import BoolArray, Boundary, FloatArray, LiftModel, Parameter, compose
from nearlift.errors import InputRefused
from nearlift.flight import Ratio
from nearlift.likelihood import student
from nearlift.randomness import generator
from nearlift.reduction.quality import rejected
from nearlift.results import Estimate
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.fit import FitResults
from nearlift.results.quotation import Correlation, Results

#: Arguments of a model held at their reference value 1 in flight, where their effects change
#: nothing: the supply's fall is simulated as droop, and the rotor speed follows from the throttle.
AT_REFERENCE = ("supply_V", "supply_ref_V", "speed_hat")


@dataclass(frozen=True, slots=True, kw_only=True)
class QuotedLift:
    """Lift model of one boundary, with best estimate and draws of its parameters.

    Attributes
    ----------
    model : LiftModel
        The base model composed with the vehicle's effects.
    arguments : mapping
        Keyword arguments of the model other than its parameters.
    best : mapping of str to float
        Best estimates of the parameters.
    intervals : mapping of str to Estimate
        Quoted 90 % intervals of the parameters that have one.
    draws : mapping of str to array (number,)
        Draws of the parameters; empty where the model has no parameters.
    effects, left : tuple of str
        Named effects composed with the model, and those left out (of the bench, say).
    measured_z_hat : (float, float)
        Nearest and farthest station.
    supply_V : (float, float)
        Median and lowest supply voltage on record; nan where none was recorded.
    """

    boundary: Boundary
    model: LiftModel
    arguments: Mapping[str, Any]
    best: Mapping[str, float]
    intervals: Mapping[str, Estimate]
    draws: Mapping[str, FloatArray]
    effects: tuple[str, ...] = ()
    left: tuple[str, ...] = ()
    measured_z_hat: tuple[float, float]
    supply_V: tuple[float, float] = (math.nan, math.nan)

    @property
    def title(self) -> str:
        """Title of the base model and of the effects composed with it."""
        effects = "".join(f" with {catalogue.titled(e)}" for e in self.effects)
        return self.model.title.partition(" + ")[0] + effects

    @property
    def number(self) -> int:
        """Number of draws; 1 where the model has no parameters."""
        return next(map(len, self.draws.values()), 1)

    def ratio(self, member: int = -1) -> Ratio:
        """L / L_inf over z_hat of draw `member`; -1 is the best estimate."""
        drawn = self.best if member < 0 else {n: x[member] for n, x in self.draws.items()}
        values = {**self.arguments, **{name: float(x) for name, x in drawn.items()}}

        def ratio(z_hat: FloatArray) -> FloatArray:
            # a model that is constant may return one number
            lift = np.asarray(self.model(z_hat, **values), dtype=float)
            return np.broadcast_to(lift, np.shape(z_hat))

        return ratio

    @property
    def ratios(self) -> list[Ratio]:
        """L / L_inf as functions of z_hat: the best estimate, then every draw."""
        return [self.ratio(m) for m in range(-1, self.number)]

    def drawn(self, z_hat: FloatArray) -> FloatArray:
        """L / L_inf of every draw at heights (n,): shape (number, n)."""
        columns = {name: values[:, None] for name, values in self.draws.items()}
        ratio = np.asarray(self.model(z_hat, **{**self.arguments, **columns}), dtype=float)
        return np.broadcast_to(ratio, (self.number, np.size(z_hat)))

    @property
    def largest_change(self) -> float:
        """L / L_inf - 1 at the nearest station, best estimate."""
        return float(self.ratio()(np.array(self.measured_z_hat[:1]))[0] - 1.0)

    def droop(self) -> list[float]:
        """Relative change of lift once the supply has fallen to the lowest on record.

        The first is of the best estimate, the others are of the draws. All are 0 without a sag
        exponent or known supply.
        """
        left = self.supply_V[1] / self.supply_V[0]
        if "sag_exponent" not in self.best or not np.isfinite(left):
            return [0.0] * (1 + self.number)
        exponents = [self.best["sag_exponent"], *self.draws["sag_exponent"].tolist()]
        return [float(left**exponent - 1.0) for exponent in exponents]


@dataclass(frozen=True, slots=True, kw_only=True)
class QuotedLifts:
    """Trials of a campaign, fit.json and results.json, in which its lift is quoted, and the
    findings of the loop at each boundary that was diagnosed.
    """

    campaign: Campaign
    seed: int
    trials: Mapping[str, NDArray[Any]]
    fits: FitResults
    results: Results
    findings: Mapping[Boundary, BoundaryDiagnosis]

    @property
    def boundaries(self) -> list[Boundary]:
        """Boundaries that were fitted, in the order ground, ceiling, sidewall."""
        return boundaries_of(self.fits.boundaries)

    def accepted_at(self, boundary: Boundary) -> BoolArray:
        """Mask of the boundary's trials that were not rejected."""
        good = ~rejected(self.trials["quality"])
        return np.asarray((self.trials["boundary"] == boundary) & good)

    def levels(self, boundary: Boundary) -> tuple[dict[float, tuple[float, float]], float]:
        """L_inf and its standard uncertainty by throttle, N, and the relative scatter of trials.

        They are those of the accepted model where the boundary was diagnosed, else of the base fit.
        """
        if self.results.boundaries[boundary].verdict == "not_diagnosed":
            far, noise = self.fits.of_base(boundary).L_inf_N, self.fits.noise[boundary]
        else:
            far, noise = self.findings[boundary].L_inf_N, self.findings[boundary].noise
        return {t: (e.value, e.u) for t, e in far.items()}, noise.relative

    def lift(self, boundary: Boundary, number: int) -> QuotedLift:
        """The lift of one boundary, with so many draws."""
        quoted, trials = self.results.boundaries[boundary], self.trials
        base, mine = catalogue.model(quoted.base_model), self.accepted_at(boundary)
        intervals: dict[str, Estimate] = dict(quoted.coefficients)
        if accepted := self.findings[boundary].accepted if quoted.effects else None:
            # means over rivals draw none of them; dof 0 marks what the data do not determine
            intervals |= {
                name: replace(p, dof=intervals[name].dof if name in intervals else math.inf)
                for name, p in accepted.parameters.items()
            }
        effects = [catalogue.effect(name, quoted.form(name)) for name in quoted.effects]
        flying = [e for e in effects if e.belongs_to == "vehicle"]
        model = compose(base, *flying) if flying else base
        rng = generator(self.seed, "belief", boundary, base.name)
        best, draws = drawn_parameters(model.parameters, intervals, quoted.correlation, number, rng)
        z_hat = trials["z_hat"][mine]
        supply = trials["supply_V"][mine] if "supply_V" in trials else np.empty(0)
        known = supply[np.isfinite(supply)]
        return QuotedLift(
            boundary=boundary,
            model=model,
            arguments=self._arguments(model, mine),
            best=best,
            intervals={name: intervals[name] for name in best if name in intervals},
            draws=draws,
            effects=tuple(e.name for e in flying),
            left=tuple(e.name for e in effects if e not in flying),
            measured_z_hat=(float(z_hat.min()), float(z_hat[np.isfinite(z_hat)].max())),
            supply_V=(
                (float(np.median(known)), float(known.min())) if len(known) else (math.nan,) * 2
            ),
        )

    def _arguments(self, model: LiftModel, mine: BoolArray) -> dict[str, Any]:
        """Arguments of a model that are constant over a flight; refused where trials differ in
        them, or one distance is not enough.
        """
        where = f"model {model.name}"
        if "gap_hat" in model.needs:
            raise InputRefused(
                where,
                "lift between two boundaries is for fits; flights, detection and exports have one"
                " distance to one boundary",
                "choose another `base` for them",
            )
        known = dict.fromkeys(AT_REFERENCE, 1.0) | self.campaign.geometry()
        for name in set(model.needs) - known.keys():
            values = np.unique(self.trials.get(name, np.full(len(mine), np.nan))[mine])
            if len(values) != 1 or np.isnan(values[0]):
                raise InputRefused(
                    where,
                    f"needs {name}, which is not one and the same in all trials, and a flight has"
                    " one",
                    "choose another `base`, or exclude the trials that differ",
                )
            known[name] = float(values[0])
        return {n: known[n] for n in model.needs}


def drawn_parameters(
    parameters: Sequence[Parameter],
    intervals: Mapping[str, Estimate],
    known: Correlation,
    number: int,
    rng: np.random.Generator,
) -> tuple[dict[str, float], dict[str, FloatArray]]:
    """Best estimates and draws of parameters: a split normal on each quoted 90 % interval,
    correlated as quoted (Gaussian copula).

    The 5 and 95 % points are the interval's ends, however asymmetric; draws are clipped to the
    parameter's bounds. A parameter that the data do not determine (dof 0) is drawn from its
    declared prior within the bounds. One without an interval keeps its declared value.
    """
    from scipy.special import ndtr

    if not parameters:
        return {}, {}
    correlation, at = np.eye(len(parameters)), {n: i for i, n in enumerate(known.parameters)}
    for (i, a), (j, b) in itertools.permutations(enumerate(p.name for p in parameters), 2):
        if a in at and b in at:
            correlation[i, j] = known.values[at[a]][at[b]]
    mean = np.zeros(len(parameters))
    normal = rng.multivariate_normal(mean, correlation, size=number, method="eigh")
    best, draws = {}, {}
    for p, n in zip(parameters, normal.T, strict=True):
        quoted = intervals.get(p.name, Estimate(value=p.value, lo90=p.value, hi90=p.value))
        best[p.name] = float(quoted.value)
        if quoted.dof == 0:
            prior = p.prior.frozen()
            first, last = prior.cdf(p.bounds)
            drawn = prior.ppf(first + (last - first) * ndtr(n))
        else:
            below, above = quoted.value - quoted.lo90, quoted.hi90 - quoted.value
            drawn = quoted.value + np.where(n < 0, below, above) / student.NORMAL_90 * n
        draws[p.name] = np.clip(drawn, *p.bounds)
    return best, draws
