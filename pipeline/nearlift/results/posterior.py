"""Posterior of a model and its sampling: a block of fit.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nearlift.results.document import Above, Below, NumberKey, Real, Unbounded
from nearlift.results.estimate import Estimate

#: So many standard errors are a disagreement: by chance once in 10^6 comparisons.
APART = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplerCheck:
    """Check of a chain by a grid: the largest disagreement, in Monte Carlo standard errors.

    `where` locates it.

    `unfit` is the reason why the grid could not judge.
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

    Attributes
    ----------
    ess, ess_tail, tau : float
        Effective draws of the mean and of the ends of the 90 % interval. Autocorrelation time in
        steps, 1 for independent draws.
    width_ratio : float
        Of the 90 % intervals after and before.
    words, unlike_fit : str
        Where they matter. The second states why the posterior is unlike the fit.
    """

    ess: Real
    ess_tail: Real
    tau: Real
    prior: DeclaredPrior
    width_ratio: Real
    words: str
    unlike_fit: str


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


#: Name of L_inf in posterior.parquet, before its throttle.
LEVEL = "L_inf_N"


def level_name(throttle: float) -> str:
    """How L_inf at a throttle (a fraction) is called in posterior.parquet."""
    return f"{LEVEL}[{throttle:g}]"


def split_level(name: str) -> float:
    """The throttle in such a name."""
    return float(name.removeprefix(f"{LEVEL}[").removesuffix("]"))
