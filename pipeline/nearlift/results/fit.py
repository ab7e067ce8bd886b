"""fit.json: every lift model fitted to every boundary, its posterior, how the models compare, and
checks of the base models' assumptions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused
from nearlift.results.document import Above, Below, IfAny, NumberKey, Real, Unbounded
from nearlift.results.estimate import Estimate, Noise
from nearlift.results.observations import LevelCurve

#: So many standard errors are a disagreement: by chance once in 10^6 comparisons.
APART = 5.0
#: Name of L_inf in posterior.parquet, before its throttle.
LEVEL = "L_inf_N"


def level_name(throttle: float) -> str:
    """Name of L_inf at a throttle (a fraction) in posterior.parquet."""
    return f"{LEVEL}[{throttle:g}]"


def split_level(name: str) -> float:
    """The throttle in such a name."""
    return float(name.removeprefix(f"{LEVEL}[").removesuffix("]"))


# ---- one fit


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterCovariance:
    """Covariance (p, p) of the parameters, as rows."""

    names: tuple[str, ...]
    values: tuple[tuple[Unbounded, ...], ...]

    @classmethod
    def named(cls, names: Iterable[str], values: FloatArray) -> ParameterCovariance:
        """The matrix of an array."""
        return cls(names=tuple(names), values=tuple(tuple(row) for row in values.tolist()))

    def among(self, names: Iterable[str]) -> ParameterCovariance:
        """Covariance of some of the parameters."""
        kept = tuple(names)
        at = [self.names.index(n) for n in kept]
        return ParameterCovariance.named(kept, np.array(self.values)[np.ix_(at, at)])


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelFit:
    """A fitted curve of L_inf, in N: coefficients of the curve's columns, with their covariance
    while the lift model's coefficients are free.

    `held_out` is by degree the root mean square of log lift in visits left out, with free curves of
    distance.
    """

    curve: LevelCurve
    coefficients: tuple[Real, ...]
    covariance: tuple[tuple[Real, ...], ...]
    held_out: Mapping[int, Real]

    def lift_inf_N(self, **values: float) -> tuple[float, float]:
        """L_inf, N, and its standard uncertainty at a throttle (a fraction); other arguments of the
        curve are at their medians unless given.

        Raises
        ------
        InputRefused
            A value lies beyond those of the trials: a polynomial says nothing there.
        """
        curve = self.curve
        at = dict(zip(curve.of, curve.typical, strict=True)) | values
        for name, low, high in zip(curve.of, curve.low, curve.high, strict=True):
            if not low <= at[name] <= high:
                raise InputRefused(
                    f"L_inf at {name} = {at[name]:.4g}",
                    f"lies outside {low:.4g} to {high:.4g}, where lift was measured",
                    "measure there, or ask within that range",
                )
        row = curve.columns(np.array([[at[name]] for name in curve.of]))[0]
        value = math.exp(float(row @ np.array(self.coefficients)))
        return value, value * math.sqrt(float(row @ np.array(self.covariance) @ row))


@dataclass(frozen=True, slots=True, kw_only=True)
class Degeneracy:
    """Two confounded quantities, and their correlation."""

    pair: tuple[str, str]
    r: Real
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcludedTrial:
    """A trial that the model does not speak about."""

    trial: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileIntervals:
    """Intervals of one coefficient by its profile likelihood, of 68, 90 and 95 %.

    An end is nan where the profile does not rise enough before it stops.
    """

    lo68: Real
    hi68: Real
    lo90: Real
    hi90: Real
    lo95: Real
    hi95: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class Remedy:
    """Gain of a coefficient from independent knowledge of one quantity, or of each of a kind.

    `needed` is the standard uncertainty of the quantity, in `unit`, that would halve the
    coefficient's, nan if even an exact one would not. `u` and `u_best` are the coefficient's now,
    and with the quantity known exactly.
    """

    quantity: str
    needed: Real
    u: Real
    u_best: Real
    unit: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeats:
    """Number of repeats that would halve a coefficient's uncertainty (inf: no number would)."""

    times: Unbounded
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Halving:
    """Remedies that would halve a coefficient's uncertainty: knowledge or repeats."""

    knowledge: tuple[Remedy, ...]
    repeats: Repeats


@dataclass(frozen=True, slots=True, kw_only=True)
class UndeclaredInput:
    """An input without a stated uncertainty: the `shift` of each coefficient by an error of
    the plausible `size`, in `unit`.
    """

    on: str
    size: Real
    unit: str
    shift: Mapping[str, Real]


# ---- posteriors


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplerCheck:
    """Check of a chain by a grid: the largest disagreement, in Monte Carlo standard errors, and
    `where` it is. `unfit` is the reason why the grid could not judge.
    """

    by: str
    apart: Real
    where: str
    unfit: str = ""

    @property
    def failed(self) -> bool:
        """Whether it is a disagreement."""
        return not self.unfit and self.apart > APART


@dataclass(frozen=True, slots=True, kw_only=True)
class DeclaredPrior:
    """A prior in words, its 90 % interval, and the bounds that cut it off."""

    text: str
    lo90: Below
    hi90: Above
    bounds: tuple[Below, Above]


@dataclass(frozen=True, slots=True, kw_only=True)
class PosteriorParameter(Estimate):
    """One parameter after the data.

    `ess` and `ess_tail` are the effective draws of the mean and of the ends of the 90 % interval.
    `tau` is the autocorrelation time in steps, 1 for independent draws. `width_ratio` is that of
    the 90 % intervals after and before.
    """

    ess: Real
    ess_tail: Real
    tau: Real
    prior: DeclaredPrior
    width_ratio: Real
    words: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PosteriorSummary:
    """The posterior of one model. `ess` and `tau` are the worst of all parameters, None
    where there is none; `data_sha256` is that of the trials.
    """

    model: str
    data_sha256: str
    sampler: str
    chains: int
    draws: int
    ess: float | None
    tau: float | None
    acceptance: Real
    steps: int
    noise_dof: Unbounded
    checks: tuple[SamplerCheck, ...]
    parameters: Mapping[str, PosteriorParameter]
    L_inf_N: Mapping[NumberKey, Estimate]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFit:
    """One lift model fitted to one boundary; `title` is its legend.

    `L_inf_N` is the lift far from every boundary, N, per throttle (a fraction). Of a curve (then
    `levels` is one) it is given at some throttles, its other arguments at their medians. `chi2` is
    against the scatter of repeats. `rmse` is relative. `r2` is of cell means of `delta_L`;
    `r2_near` is the same for 1 < z_hat < 3, at the ground only. Both are nan where too few cells
    are.
    `height_error` is the most probable height error that all trials share, m, where the slope does
    not carry it.
    """

    title: str
    parameters: Mapping[str, Estimate]
    covariance: ParameterCovariance
    chi2: Real
    dof: int
    n_trials: int
    rmse: Real
    r2: Real
    r2_near: IfAny[float] = None
    log_likelihood: Real
    aic: Real
    bic: Real
    L_inf_N: Mapping[NumberKey, Estimate]
    levels: IfAny[LevelFit] = None
    degeneracies: tuple[Degeneracy, ...]
    excluded: tuple[ExcludedTrial, ...]
    profiles: Mapping[str, ProfileIntervals]
    would_halve: Mapping[str, Halving]
    undeclared: tuple[UndeclaredInput, ...]
    height_error: IfAny[Estimate] = None
    log_evidence: IfAny[Estimate] = None
    posterior: IfAny[PosteriorSummary] = None

    @property
    def p_value(self) -> float:
        """Chance of a chi2 as large where the model is right and repeats scatter as estimated."""
        from scipy.special import chdtrc

        return float(chdtrc(self.dof, self.chi2))

    @property
    def values(self) -> dict[str, float]:
        """The parameters' values."""
        return {name: e.value for name, e in self.parameters.items()}


# ---- influence and comparison


@dataclass(frozen=True, slots=True, kw_only=True)
class Suspect:
    """A trial or visit that is named, its trials, and the headline coefficient fitted without it.

    It is `outlying` beyond what noise allows, whether or not the headline depends on it. A visit is
    left out together with the trials named. `without` is None where that fit failed. `shift` is
    `without` less the headline (a visit's: less the headline without the trials named).
    """

    kind: Literal["trial", "visit"]
    id: str
    trials: tuple[str, ...]
    outlying: bool
    without: Estimate | None
    shift: Real
    text: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Influence:
    """Influence of single trials and visits on one fit; `without_all` is the headline without any
    trial named, if several are. `why_not` says why nothing could be screened.
    """

    suspects: tuple[Suspect, ...] = ()
    without_all: Estimate | None = None
    why_not: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelScore:
    """A model's held-out score, and how far it is from a reference model's over the visits that
    both predict.

    `elpd` is the sum of log predictive densities, `d_elpd` its excess over the reference's,
    `u_d_elpd` the standard error of that by visits. `rmse` is in log lift; `d_rmse` and `u_d_rmse`
    are by a jackknife over visits. `skipped` visits are those that the others say nothing about.
    """

    visits: int
    skipped: int
    elpd: Real
    d_elpd: Real
    u_d_elpd: Real
    rmse: Real
    d_rmse: Real
    u_d_rmse: Real
    aic: Real = float("nan")
    bic: Real = float("nan")
    r2: Real = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelComparison:
    """Comparison of each model of a boundary with the `reference`, on `blocks` left out."""

    blocks: str = "visits"
    reference: str
    models: Mapping[str, ModelScore]


# ---- assumptions


@dataclass(frozen=True, slots=True, kw_only=True)
class CollapseTest:
    """An F test: what the freedom of `dof[0]` more unknowns gains, over noise known with `dof[1]`
    degrees of freedom.
    """

    statistic: Annotated[Real, Field(alias="F")]
    dof: tuple[int, Unbounded]
    p_value: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class LargestDeparture:
    """The two throttles that may differ most: by what fraction, and what 95 % confidence cannot
    exclude.
    """

    between: tuple[Real, Real]
    value: Real
    u: Real
    bound95: Unbounded


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrottleCollapse:
    """Whether Delta L is the same at all throttles: the scale of the log ratio at each throttle,
    about 1 on average. What these trials cannot test is None.
    """

    per_throttle: Mapping[NumberKey, Estimate]
    test: CollapseTest | None
    largest_departure: LargestDeparture | None
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ExponentFit(Estimate):
    """The headline coefficient with the ratio raised to `n`; `supposes` is the assumption with that
    exponent.
    """

    supposes: IfAny[str] = None
    n: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedResponse:
    """Response of a logged quantity to the boundary, and the exponents that it supports."""

    quantity: str
    response: Estimate
    p_value: Real
    held: bool
    spread: Real
    exponents: tuple[Real, Real] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldQuantity:
    """Dependence of the headline coefficient on the exponent of the ratio (the held quantity)."""

    declared: str
    coefficient: str
    plausible: tuple[ExponentFit, ...]
    exponent_from_lift: Estimate | None
    logged: tuple[LoggedResponse, ...]
    supported_exponents: tuple[Real, Real] | None
    supported: tuple[ExponentFit, ...]
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrottleLift(Estimate):
    """C_L at one throttle, and the speed in it."""

    speed_Hz: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorTrend:
    """C_L per throttle: one constant, and a power law of speed.

    `exponent` and `p_trend` (of a constant C_L) are None for one throttle.
    """

    air_density: Real
    per_throttle: Mapping[NumberKey, ThrottleLift]
    mean: Estimate
    exponent: Estimate | None
    p_trend: float | None
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorUnknown:
    """C_L cannot be had for want of what is `missing`."""

    missing: tuple[str, ...]
    text: str


RotorCoefficient = RotorTrend | RotorUnknown


@dataclass(frozen=True, slots=True, kw_only=True)
class FitResults:
    """The whole file. `failed` says of models that were not fitted why."""

    file: ClassVar[str] = "fit.json"

    schema: str = "nearlift.fit/1"
    base: dict[Boundary, str] = field(default_factory=dict)
    noise: dict[Boundary, Noise] = field(default_factory=dict)
    boundaries: dict[Boundary, Mapping[str, ModelFit]] = field(default_factory=dict)
    comparison: dict[Boundary, ModelComparison] = field(default_factory=dict)
    failed: dict[Boundary, Mapping[str, str]] = field(default_factory=dict)
    throttle_collapse: dict[Boundary, ThrottleCollapse] = field(default_factory=dict)
    held_quantity: dict[Boundary, HeldQuantity | None] = field(default_factory=dict)
    rotor_coefficient: dict[Boundary, RotorCoefficient] = field(default_factory=dict)
    influence: dict[Boundary, Influence] = field(default_factory=dict)

    def of_base(self, boundary: Boundary) -> ModelFit:
        """The fit of a boundary's base model."""
        return self.boundaries[boundary][self.base[boundary]]
