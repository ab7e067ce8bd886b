"""Answers of the commands `design`, `next`, `explain` and `compare`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nearlift.declare import Boundary
from nearlift.results.diagnosis import CoefficientLimit
from nearlift.results.document import IfAny, Numbers, Real, Unbounded
from nearlift.results.estimate import Estimate, Noise
from nearlift.results.outlook import EffectOutlook, UnseenBias, UntestableEffect
from nearlift.results.quotation import Verdict

# ---- design.json


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedCoefficient:
    """A coefficient, and its standard uncertainty without and with all undetected effects."""

    expected: Real
    u: Real
    u_with_undetected_effects: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryOutlook:
    """A plan's outlook at one boundary.

    `noise` is the floor that the loop would find where trials scatter by `expected_noise`; `groups`
    are effects that are confounded.
    """

    base_model: str
    trials: int
    false_alarm_rate: Real
    noise: Noise
    coefficients: Mapping[str, ExpectedCoefficient]
    effects: tuple[EffectOutlook, ...]
    groups: tuple[tuple[str, ...], ...]
    limits: tuple[CoefficientLimit, ...]
    expected_noise: Noise
    untestable: tuple[UntestableEffect, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnSchedule:
    """A random schedule that was written: the fraction of visits that arrive `from_afar`, and how
    many drive past their station first.
    """

    file: str
    trials: int
    visits: int
    sessions: int
    hours: Real
    from_afar: Real
    detours: int
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignOutlook:
    """Answer of `design`; `notes` say what could not be weighed."""

    campaign: str
    plan: str
    assumed: tuple[str, ...]
    boundaries: Mapping[Boundary, BoundaryOutlook]
    notes: tuple[str, ...]
    schedule: DrawnSchedule


# ---- next


@dataclass(frozen=True, slots=True, kw_only=True)
class NextVisit:
    """One visit: `z_hat` is infinite in free air, `supply_V` None where it is left as it is.

    `approach` is +1 where the last move leads away from the boundary, -1 where closer.
    """

    z_hat: Real
    distance_m: Real
    throttles: tuple[Real, ...]
    supply_V: float | None
    approach: int


@dataclass(frozen=True, slots=True, kw_only=True)
class NextVisits:
    """The next visits at one boundary, in order.

    `aim` is the coefficient, or the two explanations to distinguish. `now` and `after` are its
    standard uncertainty with the present trials and with these visits; or the expected evidence
    (non-centrality) between the two. Visits stop at `wanted`, and no number of them betters `best`.

    `visits_wanted` is their number until then by this plan, planned again every batch; None where
    none are enough.
    """

    boundary: Boundary
    base_model: str
    trials: int
    throttles: int
    aim: tuple[str, ...]
    now: Real
    after: Real
    wanted: float | None
    visits_wanted: int | None
    best: Real
    visits: tuple[NextVisit, ...]
    notes: tuple[str, ...] = ()

    @property
    def parts(self) -> bool:
        """Whether two explanations are to be distinguished."""
        return len(self.aim) > 1


# ---- explain


@dataclass(frozen=True, slots=True, kw_only=True)
class WithinTrialPower:
    """The smallest mean relative change of lift within a record that so many visits can detect."""

    visits: int
    limit: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class Power:
    """Power curves over size (distance from the null, in the parameter's unit); arrays (m,).

    `seen` is the probability that the test for structure is significant. The others are those that
    the effect then is identified or a rival (`within`), identified (`first`), or identified without
    a rival (`alone`). All before the confirmation on held-out visits.
    """

    size: Numbers
    seen: Numbers
    within: Numbers
    first: Numbers
    alone: Numbers

    def limit(self, at: float, of: str = "seen") -> float | None:
        """Size at which the curve `of` reaches `at`, interpolated; None if no size here does."""
        chance = np.maximum.accumulate(getattr(self, of))
        if chance[-1] < at:
            return None
        above = int(np.argmax(chance >= at))
        if above == 0:
            return float(self.size[0])
        low, high = chance[above - 1], chance[above]
        return float(
            self.size[above - 1]
            + (at - low) / (high - low) * (self.size[above] - self.size[above - 1])
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Signature:
    """Relative change of lift over trials, and what of it the coefficients and L_inf leave."""

    rms: Real
    rms_left: Real
    largest_left: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class Confusion:
    """Another effect, the share of energy that it takes over, and its chance to be a rival."""

    effect: str
    energy_absorbed: Real
    rival_chance: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectSize:
    """One of an effect's sizes; the limits are those seen, identified or a rival, and identified
    alone with 80 % chance, None where none is.

    `signature`, `confused_with` and `bias` are of `shown_size`. `power` is None of an effect that
    the model absorbs.
    """

    parameter: str
    unit: str
    meaning: str
    per: str
    shape: Mapping[str, Real]
    plausible_size: Real
    largest_size: Unbounded
    detection_limit: float | None
    limit_within_set: float | None
    limit_named_alone: float | None
    shown_size: Real
    signature: Signature
    power: Power | None
    confused_with: tuple[Confusion, ...]
    bias: Mapping[str, UnseenBias]


@dataclass(frozen=True, slots=True, kw_only=True)
class NoCandidate:
    """An effect that this boundary's trials cannot show: what it needs, or a `reason`."""

    testable: Literal[False] = False
    needs: tuple[str, ...]
    log_next_time: tuple[str, ...]
    reason: IfAny[str] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateEffect:
    """An effect that this boundary's trials could show."""

    testable: Literal[True] = True
    base_model: str
    trials: int
    false_alarm_rate: Real
    few_visits: bool
    noise: Noise


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectWithinTrial(CandidateEffect):
    """Visibility of an effect within a record; None where records are unknown."""

    within_trial: WithinTrialPower | None


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectBetweenTrials(CandidateEffect):
    """Visibility of an effect in the means of trials."""

    share_visible: Real
    sizes: tuple[EffectSize, ...]


EffectAtBoundary = NoCandidate | EffectWithinTrial | EffectBetweenTrials


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectAccount:
    """The whole answer at each boundary; `notes` are boundaries that could not be looked at.
    `nearlift describe EFFECT` has the effect's declaration.
    """

    effect: str
    campaign: str
    boundaries: Mapping[Boundary, EffectAtBoundary]
    notes: tuple[str, ...]


# ---- comparison.json


@dataclass(frozen=True, slots=True, kw_only=True)
class SpreadPrior:
    """Prior of the spread between campaigns, and the mean with its scale doubled."""

    distribution: str = "half-Cauchy"
    scale: Real
    mean_if_doubled: Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class Population:
    """Random-effects estimates from many campaigns.

    `mean` is the population's, with the spread integrated over. `spread` is beyond the campaigns'
    uncertainties, by its median. `next` predicts another campaign, measured without error. `q` is
    Cochran's statistic of zero spread.
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
    """A coefficient over the campaigns that have it, with their caveats.

    Too few campaigns have no population.
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
