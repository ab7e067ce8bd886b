"""comparison.json: one coefficient over many campaigns, and the population that they come from."""

from __future__ import annotations

from dataclasses import dataclass

from nearlift.declare import Boundary
from nearlift.results.estimate import UncertainValue
from nearlift.results.quotation import Verdict
from nearlift.results.serial import optional


@dataclass(frozen=True, slots=True, kw_only=True)
class SpreadPrior:
    """Prior of the spread between campaigns, and the mean with its scale doubled."""

    distribution: str = "half-Cauchy"
    scale: float
    mean_if_doubled: UncertainValue


@dataclass(frozen=True, slots=True, kw_only=True)
class Population:
    """Random-effects estimates from many campaigns.

    Attributes
    ----------
    mean : UncertainValue
        Of the population; 90 % interval with the spread integrated over.
    spread : UncertainValue
        Standard deviation between campaigns beyond their uncertainties; value is the median.
    next : UncertainValue
        Prediction for another campaign of the same population, measured without error.
    q, dof, p_value : float
        Cochran's statistic of zero spread, its degrees of freedom, and its p-value.
    """

    mean: UncertainValue
    spread: UncertainValue
    next: UncertainValue
    q: float
    dof: int
    p_value: float
    spread_prior: SpreadPrior


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadlineValue(UncertainValue):
    """The headline coefficient as a campaign quotes it, and what its interval allows for."""

    holds: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedCampaign:
    """One campaign, its coefficient alone and shrunk towards the population's mean."""

    campaign: str
    vehicle: str
    verdict: Verdict
    quoted: HeadlineValue
    in_population: UncertainValue | None


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
    population: Population | None = optional()


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignComparison:
    """The whole file; `shared` are components that are one and the same error in all campaigns."""

    schema: str = "nearlift.comparison/1"
    shared: tuple[str, ...]
    groups: tuple[ComparedCoefficient, ...]
