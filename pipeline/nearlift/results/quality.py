"""quality.json: every trial from raw byte to figure, and what each exclusion is worth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from nearlift.declare import Boundary
from nearlift.results.serial import Unbounded


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFiles:
    """Files that trials came from, and their size."""

    number: int
    bytes: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SampleCounts:
    """Samples read, None where records were not, and averaged."""

    read: int | None
    averaged: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialCounts:
    """Trials at each step; `remarked` are accepted ones with a quality code."""

    scheduled: int
    recorded: int
    accepted: int
    remarked: int
    fitted: int


@dataclass(frozen=True, slots=True, kw_only=True)
class CodeCount:
    """How many trials have a quality code, and what it means."""

    trials: int
    rejects: bool
    meaning: str


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRecord:
    """What became of one trial; `why` it is not in a fit."""

    trial: str
    boundary: str
    source: str
    sha256: str
    completeness: str
    samples: int
    averaged: int
    lift_N: float
    u_lift_N: float
    codes: tuple[str, ...]
    accepted: bool
    fitted: bool
    figures: tuple[str, ...]
    why: str


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadlineOf:
    """The headline coefficient of so many trials."""

    value: float
    u: Unbounded
    trials: int


@dataclass(frozen=True, slots=True, kw_only=True)
class PutBack:
    """The headline coefficient with excluded `trials` among the others, and what that changes."""

    trials: int
    value: float
    u: Unbounded
    change: float
    change_in_u: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class NotPutBack:
    """Excluded trials with which the model cannot be fitted, and why."""

    trials: int
    value: None = None
    why_not: str


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadlineWithout:
    """The headline coefficient without a trial or visit that the fit named; None where that fit
    fails.
    """

    what: str
    trials: int
    why_not: str
    value: float | None
    u: Unbounded | None
    change: float
    change_in_u: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Exclusions:
    """What the excluded trials of one boundary are worth to the headline `parameter` of its base
    model: put back together, by quality code, and the first few one by one.
    """

    model: str
    parameter: str
    accepted: HeadlineOf
    excluded: int
    cannot_be_put_back: Mapping[str, str]
    all: PutBack | NotPutBack | None = None
    codes: Mapping[str, PutBack | NotPutBack]
    trials: Mapping[str, PutBack | NotPutBack]
    left_out: tuple[HeadlineWithout, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class QualityLedger:
    """The whole file."""

    file: ClassVar[str] = "quality.json"

    schema: str = "nearlift.quality/1"
    files: SourceFiles
    samples: SampleCounts
    counts: TrialCounts
    codes: Mapping[str, CodeCount]
    trials: tuple[TrialRecord, ...]
    put_back: Mapping[Boundary, Exclusions]
