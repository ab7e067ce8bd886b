"""comparison.json: one coefficient over many campaigns, and the population that they come from."""

from __future__ import annotations

from dataclasses import dataclass

from nearlift.declare import Boundary
from nearlift.results.document import IfAny, Real
from nearlift.results.estimate import Estimate
from nearlift.results.quotation import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class SpreadPrior:
    """Prior of the spread between campaigns, and the mean with its scale doubled."""

    distribution: str = "half-Cauchy"
    scale: Real
    mean_if_doubled: Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class Population:
    """Random-effects estimates from many campaigns.

    Attributes
    ----------
    mean : Estimate
        Of the population; 90 % interval with the spread integrated over.
    spread : Estimate
        Standard deviation between campaigns beyond their uncertainties; value is the median.
    next : Estimate
        Prediction for another campaign of the same population, measured without error.
    q, dof, p_value : float
        Cochran's statistic of zero spread, its degrees of freedom, and its p-value.
    """

    mean: Estimate
    spread: Estimate
    next: Estimate
    q: Real
    dof: int
    p_value: Real
    spread_prior: SpreadPrior


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadlineValue(Estimate):
    """The headline coefficient as a campaign quotes it, and what its interval allows for."""

    holds: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedCampaign:
    """One campaign and its coefficient."""

    campaign: str
    vehicle: str
    verdict: Verdict
    claim: str
    quoted: HeadlineValue


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedCoefficient:
    """A coefficient over the campaigns that have it, with what is to be held against them; without
    a population where they are too few.
    """

    boundary: Boundary
    model: str
    coefficient: str
    campaigns: tuple[ComparedCampaign, ...]
    remarks: tuple[str, ...]
    population: IfAny[Population] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignComparison:
    """The whole file; `shared` are components that are one and the same error in all campaigns."""

    schema: str = "nearlift.comparison/1"
    shared: tuple[str, ...]
    groups: tuple[ComparedCoefficient, ...]
