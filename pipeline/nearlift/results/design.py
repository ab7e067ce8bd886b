"""design.json: what a planned campaign could see, what it would confuse, and what to change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from nearlift.declare import Boundary
from nearlift.results.diagnosis import CoefficientLimit
from nearlift.results.document import IfAny, Real
from nearlift.results.estimate import Noise
from nearlift.results.outlook import EffectOutlook, UntestableEffect


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedCoefficient:
    """A coefficient, and its standard uncertainty without and with all undetected effects."""

    expected: Real
    u: Real
    u_with_undetected_effects: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedNoise:
    """Scatter of visits that a plan assumes; see `Noise`."""

    relative: Real
    force_N: Real
    height_m: Real
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangeOption:
    """Gain of a change to the plan for one pair: the `evidence` that its trials add, and how many
    trials distinguish the two. Without trials there is no evidence per trial.
    """

    change: str
    trials: int
    evidence: Real
    evidence_per_trial: float | None
    trials_to_part: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ConfoundedPair:
    """An effect of one `size` and a rival: their evidence by the plan, the changes that distinguish
    them, cheapest first, and what to log.
    """

    pair: tuple[str, str]
    parameter: str
    size: Real
    unit: str
    rival_chance: Real
    evidence_now: Real
    held_together_by: Literal["form", "noise"]
    options: tuple[ChangeOption, ...]
    log: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RivalChance:
    """The chance of a pair to be confused, before a change and after."""

    pair: tuple[str, str]
    before: Real
    after: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class RankedChange:
    """A change to the plan, and how many of all pairs it parts."""

    change: str
    trials: int
    pairs_parted: int
    pairs: int
    evidence_per_trial: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedChange(RankedChange):
    """One that was looked at as a plan of its own; None where it changes no trials."""

    rivals_after: tuple[RivalChance, ...] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanChanges:
    """Changes that distinguish the confounded pairs."""

    pairs: tuple[ConfoundedPair, ...]
    best: tuple[CheckedChange | RankedChange, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundaryOutlook:
    """A plan's outlook at one boundary.

    `noise` is the floor that the loop would find where trials scatter as expected; `groups` are
    effects that are confounded.
    """

    base_model: str
    trials: int
    false_alarm_rate: Real
    noise: Noise
    coefficients: Mapping[str, ExpectedCoefficient]
    effects: tuple[EffectOutlook, ...]
    groups: tuple[tuple[str, ...], ...]
    limits: tuple[CoefficientLimit, ...]
    changes: PlanChanges
    expected_noise: ExpectedNoise
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
    """Answer of `design`; `notes` say what could not be weighed, `files` what was written."""

    campaign: str
    plan: str
    assumed: tuple[str, ...]
    boundaries: Mapping[Boundary, BoundaryOutlook]
    notes: tuple[str, ...]
    schedule: DrawnSchedule
    files: IfAny[tuple[str, ...]] = None
