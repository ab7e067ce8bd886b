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
from collections.abc import Mapping
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
from nearlift.results.quotation import Results

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
        far, noise = self.fits.of_base(boundary).L_inf_N, self.fits.noise[boundary]
        if self.results.boundaries[boundary].verdict != "not_diagnosed":
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
        names = [p.name for p in model.parameters]
        correlation, at = np.eye(len(names)), quoted.correlation.parameters
        for (i, a), (j, b) in itertools.permutations(enumerate(names), 2):
            if a in at and b in at:
                correlation[i, j] = quoted.correlation.values[at.index(a)][at.index(b)]
        normal = np.empty((0, number))
        if names:
            rng = generator(self.seed, "belief", boundary, base.name)
            zero = np.zeros(len(names))
            normal = rng.multivariate_normal(zero, correlation, size=number, method="eigh").T
        z_hat = trials["z_hat"][mine]
        supply = trials["supply_V"][mine] if "supply_V" in trials else np.empty(0)
        known = supply[np.isfinite(supply)]
        return QuotedLift(
            boundary=boundary,
            model=model,
            arguments=self._arguments(model, mine),
            best={
                p.name: intervals[p.name].value if p.name in intervals else p.value
                for p in model.parameters
            },
            intervals={name: intervals[name] for name in names if name in intervals},
            draws={
                p.name: draws(p, intervals.get(p.name), x)
                for p, x in zip(model.parameters, normal, strict=True)
            },
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
        known = dict.fromkeys(AT_REFERENCE, 1.0) | self.campaign.geometry()
        values = {n: np.unique(self.trials[n][mine]) for n in model.needs if n in self.trials}
        known |= {
            n: float(v[0])
            for n, v in values.items()
            if n not in known and len(v) == 1 and np.isfinite(v[0])
        }
        for name in model.needs:
            if name == "gap_hat" or name not in known:
                raise InputRefused(
                    f"model {model.name}",
                    f"needs {name}: flights, detection and exports have one distance, to one"
                    " boundary, and conditions that are the same in all trials",
                    "choose another `base`, or exclude the trials that differ",
                )
        return {n: known[n] for n in model.needs}


def draws(parameter: Parameter, quoted: Estimate | None, normal: FloatArray) -> FloatArray:
    """Draws of a parameter from standard normal ones: a split normal on its quoted 90 % interval.

    The 5 and 95 % points are the interval's ends, however asymmetric; draws are clipped to the
    parameter's bounds. A parameter that the data do not determine (dof 0) is drawn from its
    declared prior within the bounds. One without an interval keeps its declared value.
    """
    from scipy.special import ndtr

    if quoted is None:
        return np.full(len(normal), parameter.value)
    if quoted.dof == 0:
        prior = parameter.prior.frozen()
        first, last = prior.cdf(parameter.bounds)
        drawn = prior.ppf(first + (last - first) * ndtr(normal))
    else:
        width = np.where(normal < 0, quoted.value - quoted.lo90, quoted.hi90 - quoted.value)
        drawn = quoted.value + width / student.NORMAL_90 * normal
    return np.asarray(np.clip(drawn, *parameter.bounds))
