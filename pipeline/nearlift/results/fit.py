"""fit.json: every lift model fitted to every boundary, how the models compare, and what was asked
of the base models' assumptions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal

from nearlift.declare import Boundary, FloatArray
from nearlift.results.assumptions import HeldQuantity, RotorCoefficient, ThrottleCollapse
from nearlift.results.document import IfAny, NumberKey, Real, Unbounded
from nearlift.results.estimate import Estimate, Noise
from nearlift.results.levels import LevelFit
from nearlift.results.posterior import PosteriorSummary


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterCovariance:
    """Covariance (p, p) of the parameters, as rows."""

    names: tuple[str, ...]
    values: tuple[tuple[Unbounded, ...], ...]

    @classmethod
    def named(cls, names: Iterable[str], values: FloatArray) -> ParameterCovariance:
        """From an array."""
        return cls(names=tuple(names), values=tuple(tuple(row) for row in values.tolist()))

    def among(self, names: Iterable[str]) -> ParameterCovariance:
        """Covariance of some of the parameters."""
        kept = tuple(names)
        at = [self.names.index(n) for n in kept]
        values = tuple(tuple(self.values[i][j] for j in at) for i in at)
        return ParameterCovariance(names=kept, values=values)


@dataclass(frozen=True, slots=True, kw_only=True)
class Degeneracy:
    """Two confounded quantities; `u_if_free` is the coefficient's uncertainty if the second were
    unknown.
    """

    pair: tuple[str, str]
    r: Real
    text: str
    u_if_free: float | None = None

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True, kw_only=True)
class ExcludedTrial:
    """A trial that the model does not speak about."""

    trial: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ProfileIntervals:
    """Intervals of one coefficient by its profile likelihood, of 68, 90 and 95 %.

    An end is nan where the profile does not rise enough before it stops; `open` names those ends
    (``low``, ``high``) by level. `skew` is upper over lower part of the 90 % interval.
    """

    lo68: Real
    hi68: Real
    lo90: Real
    hi90: Real
    lo95: Real
    hi95: Real
    open: Mapping[str, tuple[str, ...]]
    skew: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class Remedy:
    """Gain of a coefficient from independent knowledge of one quantity, or of each of a kind.

    Attributes
    ----------
    r : float
        Correlation of the two; of several of a kind, the multiple correlation, without a sign.
    known_to : float
        Standard uncertainty of the quantity as these trials and the budget leave it, in `unit`.
    needed : float
        Standard uncertainty of an independent measurement that would halve the coefficient's; nan
        if even an exact one would not.
    u, u_best : float
        The coefficient's standard uncertainty now, and with the quantity known exactly.
    """

    quantity: str
    r: Real
    known_to: Real
    needed: Real
    u: Real
    u_best: Real
    unit: str
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Repeats:
    """How many times these trials would halve a coefficient's uncertainty (inf: no number)."""

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


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelFit:
    """One lift model fitted to one boundary.

    Attributes
    ----------
    title : str
        What a legend says.
    L_inf_N : mapping of float to Estimate
        Lift far from every boundary, N, per throttle (a fraction). Of a curve, at some throttles,
        its other arguments at their medians.
    levels : LevelFit or None
        The curve of L_inf, where ``[levels]`` asks for one.
    chi2, dof : float
        Against the scatter of repeats.
    rmse, r2, aic, bic : float
        Relative root-mean-square residual; R² of cell means of `delta_L`; information criteria.
    height_error : Estimate or None
        Most probable height error that all trials share, m, where the slope does not carry it.
    r2_near : float or None
        The same R² within `r2_near_range`; at the ground only, nan where too few cells are.
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
    r2_near_range: IfAny[tuple[Real, Real]] = None
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Suspect:
    """A trial or visit that is named, and the headline coefficient fitted without it.

    Attributes
    ----------
    id : str
        The trial's, or the visit's label.
    trials : tuple of str
        The trial, or those of the visit.
    outlying : bool
        Beyond what noise allows, whether or not the headline depends on it.
    without : Estimate or None
        A visit's also without the trials named; None where that fit failed.
    shift : float
        That less the headline (a visit's: less the headline without the trials named).
    text : str
        Sentence on it.
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
    """Influence of single trials and visits on one fit.

    Attributes
    ----------
    without_all : Estimate or None
        The headline without any trial named; None unless several are.
    why_not : str
        Why nothing could be screened; empty where it could.
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
    """How the models of one boundary compare, each with the `reference`, on `blocks` left out."""

    blocks: str = "visits"
    reference: str
    models: Mapping[str, ModelScore]


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
