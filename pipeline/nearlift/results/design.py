"""design.json: what a planned campaign could see, and what it would confuse."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nearlift.declare import Boundary
from nearlift.results.diagnosis import CoefficientLimit
from nearlift.results.document import Real
from nearlift.results.estimate import Noise
from nearlift.results.outlook import EffectOutlook, UntestableEffect


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
