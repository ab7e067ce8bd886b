"""One effect in one campaign: the answer of `diagnose --explain`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nearlift.declare import Boundary
from nearlift.results.diagnosis import LoopEstimate, TriedCandidate
from nearlift.results.document import IfAny, Numbers, Real, Unbounded
from nearlift.results.estimate import Noise
from nearlift.results.outlook import UnseenBias
from nearlift.results.quotation import Verdict


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
    a rival (`alone`). All
    before the confirmation on held-out visits.
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
    correlation: Real
    rival_chance: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectSize:
    """One of an effect's sizes.

    Attributes
    ----------
    detection_limit, limit_within_set, limit_named_alone : float or None
        Sizes seen, named or a rival, and named alone with 80 % chance; None where none is.
    shown_size : float
        The size that `signature`, `confused_with` and `bias` are of.
    power : Power or None
        None of an effect that the model absorbs.
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
class EffectVerdict:
    """Result of the loop on an effect in this campaign; `rival_of`: the identified effects that
    it is a rival of.
    """

    verdict: Verdict
    named: bool
    parameters: Mapping[str, LoopEstimate] | None
    rivals: tuple[str, ...]
    rival_of: tuple[str, ...]
    tried: TriedCandidate | None


@dataclass(frozen=True, slots=True, kw_only=True)
class NoCandidate:
    """An effect that this boundary's trials say nothing of: what it needs, or a `reason`."""

    testable: Literal[False] = False
    needs: tuple[str, ...]
    log_next_time: tuple[str, ...]
    reason: IfAny[str] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CandidateEffect:
    """An effect that this boundary's trials could show; `in_this_campaign` is None where the loop
    has not run.
    """

    testable: Literal[True] = True
    base_model: str
    trials: int
    false_alarm_rate: Real
    draws: int
    few_visits: bool
    noise: Noise
    in_this_campaign: EffectVerdict | None


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
