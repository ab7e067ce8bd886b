"""Table of all trials, from file to figure, and the influence of each exclusion on the fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from nearlift.declare import Boundary


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialCounts:
    """Trials at each step; `remarked` are accepted ones with a quality code."""

    scheduled: int
    recorded: int
    accepted: int
    remarked: int
    fitted: int


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRow:
    """One trial: its file, its record and the figures in which it is drawn."""

    trial: str
    boundary: str
    source: str
    sha256: str
    completeness: str
    samples: int
    averaged: int
    lift_N: float
    codes: tuple[str, ...]
    figures: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Refit:
    """Change of the headline coefficient when `trials` trials are put back or left out.

    It is in the coefficient's unit and in standard uncertainties. Where the coefficient cannot be
    fitted, it is nan and `why_not` is the reason.
    """

    trials: int
    change: float
    change_in_u: float
    why_not: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Exclusions:
    """Influence of one boundary's excluded trials on the headline `parameter` of its base model.

    They are put back together, by quality code, and the first few one by one. `left_out` are trials
    and visits that the fit names, and keeps.
    """

    model: str
    parameter: str
    excluded: int
    cannot_be_put_back: Mapping[str, str]
    all: Refit | None
    codes: Mapping[str, Refit]
    trials: Mapping[str, Refit]
    left_out: Mapping[str, Refit]


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialTable:
    """The whole table; `bytes` are those of `files` files, `samples` None where records were not
    read.
    """

    files: int
    bytes: int
    samples: int | None
    averaged: int
    counts: TrialCounts
    trials: tuple[TrialRow, ...]
    put_back: Mapping[Boundary, Exclusions]
