"""Lift of each boundary as it is quoted, for flights, detection and exports.

An identified effect of the vehicle, such as supply sag, is part of the model. One of the bench,
such as a drift, is not; only the coefficient that it corrected is used. Values and intervals are
the most probable explanation's where effects are identified, else those quoted. Draws have the ends
of these intervals and their correlation. What no interval bounds is drawn from its declared prior:
it is not known, and does not fly as if it were.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import catalogue
from nearlift.campaign.manifest import Campaign, boundaries_of
from nearlift.declare import Boundary, FloatArray, LiftModel, Parameter, compose
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
        return self.model.title.partition(" + ")[0] + "".join(
            f" with {catalogue.titled(e)}" for e in self.effects
        )

    @property
    def number(self) -> int:
        """Number of draws; 1 where the model has no parameters."""
        return len(next(iter(self.draws.values()))) if self.draws else 1

    def parameters(self, member: int) -> dict[str, float]:
        """Parameters of draw `member`; -1 is the best estimate."""
        if member < 0:
            return dict(self.best)
        return {name: float(values[member]) for name, values in self.draws.items()}

    def ratio(self, member: int = -1) -> Ratio:
        """L / L_inf over z_hat of draw `member`; -1 is the best estimate."""
        values = {**self.arguments, **self.parameters(member)}

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

    def droop(self, supply_end_V: float | None, member: int = -1) -> float:
        """Relative change of lift once the supply has fallen to `supply_end_V` (None: the lowest on
        record); 0 without a sag exponent or a known supply.
        """
        exponent = self.parameters(member).get("sag_exponent", 0.0)
        end = self.supply_V[1] if supply_end_V is None else supply_end_V
        left = end / self.supply_V[0]
        return float(left**exponent - 1.0) if exponent and np.isfinite(left) else 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class QuotedLifts:
    """Results of a campaign in which its lift is quoted, and its trials.

    Attributes
    ----------
    fits, results : FitResults, Results
        fit.json and results.json.
    findings : mapping
        Findings of the loop at each boundary that was diagnosed.
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
        base = catalogue.model(quoted.base_model)
        intervals: dict[str, Estimate] = dict(quoted.coefficients)
        if accepted := self.findings[boundary].accepted if quoted.effects else None:
            # means over rivals draw none of them; dof 0 marks what the data do not determine
            intervals |= {
                name: replace(p, dof=intervals[name].dof if name in intervals else math.inf)
                for name, p in accepted.parameters.items()
            }
        effects = [catalogue.effect(name, quoted.form(name)) for name in quoted.effects]
        flying = [e for e in effects if e.belongs_to == "vehicle"]
        parameters = (*base.parameters, *(p for e in flying for p in e.parameters))
        rng = generator(self.seed, "belief", boundary, base.name)
        best, draws = drawn_parameters(parameters, intervals, quoted.correlation, number, rng)
        model = compose(base, *flying) if flying else base
        mine = (trials["boundary"] == boundary) & ~rejected(trials["quality"])
        z_hat = trials["z_hat"][mine]
        supply = trials["supply_V"][mine] if "supply_V" in trials else np.empty(0)
        supply = supply[np.isfinite(supply)] if np.isfinite(supply).any() else np.array([np.nan])
        return QuotedLift(
            boundary=boundary,
            model=model,
            arguments=_arguments(model, self.campaign, trials, mine),
            best=best,
            intervals={name: intervals[name] for name in best if name in intervals},
            draws=draws,
            effects=tuple(e.name for e in flying),
            left=tuple(e.name for e in effects if e not in flying),
            measured_z_hat=(float(z_hat.min()), float(z_hat[np.isfinite(z_hat)].max())),
            supply_V=(float(np.median(supply)), float(supply.min())),
        )


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
    declared prior within the bounds; one without an interval keeps its declared value.
    """
    from scipy.special import ndtr

    if not parameters:
        return {}, {}
    correlation = np.eye(len(parameters))
    at = {n: i for i, n in enumerate(known.parameters)}
    for i, a in enumerate(parameters):
        for j, b in enumerate(parameters):
            if i != j and a.name in at and b.name in at:
                correlation[i, j] = known.values[at[a.name]][at[b.name]]
    normal = rng.multivariate_normal(
        np.zeros(len(parameters)), correlation, size=number, method="eigh"
    )
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


def _arguments(
    model: LiftModel,
    campaign: Campaign,
    trials: Mapping[str, NDArray[Any]],
    mine: NDArray[np.bool_],
) -> dict[str, Any]:
    """Arguments of a model that are constant over a flight; refused where trials differ in them, or
    one distance is not enough.
    """
    known = dict.fromkeys(AT_REFERENCE, 1.0) | campaign.geometry()
    if "gap_hat" in model.needs:
        raise InputRefused(
            f"model {model.name}",
            "lift between two boundaries is for fits; flights, detection and exports have one"
            " distance to one boundary",
            "choose another `base` for them",
        )
    for name in (n for n in model.needs if n not in known):
        values = np.unique(trials[name][mine]) if name in trials else np.array([np.nan])
        if len(values) != 1 or np.isnan(values[0]):
            raise InputRefused(
                f"model {model.name}",
                f"needs {name}, which is not one and the same in all trials, and a flight has one",
                "choose another `base`, or exclude the trials that differ",
            )
        known[name] = float(values[0])
    return {n: known[n] for n in model.needs}
