"""How a model's posterior was sampled and what it says: a block of fit.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nearlift.results.serial import Above, Below, Unbounded

#: So many standard errors are a disagreement: by chance once in 10^6 comparisons.
APART = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LogEvidence:
    """Log of the marginal likelihood, and its Monte Carlo standard error."""

    value: float
    u: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplerCheck:
    """A second way to the same posterior: the largest distance in Monte Carlo standard errors, and
    where; `unfit` says why it could not judge.
    """

    by: str
    apart: float
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
class DrawnEstimate:
    """Mean, standard deviation, median and 90 % interval of draws."""

    value: float
    u: float
    median: float
    lo90: Below
    hi90: Above
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PosteriorParameter(DrawnEstimate):
    """One parameter after the data.

    Attributes
    ----------
    ess, ess_tail, r_hat, tau : float
        Effective draws in bulk and at the ends of the 90 % interval, agreement of chains, and steps
        from one independent draw to the next. nan where they do not apply.
    width_ratio : float
        Of the 90 % intervals after and before.
    at_low, at_high : float
        Share of draws at either bound.
    width_over_fit : float
        Of the 90 % intervals of the draws and of least squares.
    words, unlike_fit : str
        Where they matter; the second why the posterior is unlike the fit.
    """

    ess: float
    ess_tail: float
    r_hat: float
    tau: float
    prior: DeclaredPrior
    width_ratio: float
    at_low: float
    at_high: float
    width_over_fit: float
    words: str
    unlike_fit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class PosteriorSummary:
    """The posterior of one model. `ess`, `r_hat` and `tau` are the worst of all parameters, None
    where there is none; `data_sha256` is that of the trials.
    """

    model: str
    data_sha256: str
    sampler: str
    chains: int
    draws: int
    ess: float | None
    r_hat: float | None
    tau: float | None
    acceptance: float
    steps: int
    pareto_k: float
    noise_dof: Unbounded
    checks: tuple[SamplerCheck, ...]
    parameters: Mapping[str, PosteriorParameter]
    L_inf_N: Mapping[float, DrawnEstimate]
