"""Quantity and unit that a heading means, of a channel of a record or a column of a table.

The words are in ``words.toml``.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path

from nearlift import units
from nearlift.declare import FloatArray
from nearlift.errors import ManifestError
from nearlift.readers.base import (
    AS_FORCE,
    FORCE_UNITS,
    SECONDS,
    Channel,
    fold,
    split_unit,
    unit_word,
)
from nearlift.schedule import BY_NAME, DIAMETERS, KNOWN, RADII

WORDS = tomllib.loads((Path(__file__).parent / "words.toml").read_text(encoding="utf-8"))
#: Times since 1970 of records, s (1995 to 2096), and their dates in days of a spreadsheet and of
#: MATLAB.
STAMPS_S = (8e8, 4e9)
STAMPS_DAYS = (2e4, 8e4), (7.2e5, 7.8e5)
#: Letters behind the last underscore of a name that are an index or a count, and no unit.
NO_UNITS = ("c", "k", "n")


def named(heading: str) -> tuple[str, str]:
    """Name and unit (empty: none) of ``Thrust (gf)``, ``Kraft / N`` or ``h_mm``."""
    bare, unit = split_unit(heading)
    if unit:
        return bare, WORDS["units"].get(fold(unit), unit)
    # a unit before the last words, as in "Thrust (lbf) mean" and "Lift (N) at 40 %"
    within = re.fullmatch(r"([^()\[\]]+)[(\[]([^()\[\]]+)[)\]]\s*(\w[\w %]*)", heading.strip())
    if within and (inner := unit_word(within[2])):
        return f"{within[1].rstrip()} {within[3]}", inner
    if heading.rstrip().endswith("%"):
        return heading.rstrip(" %"), "percent"
    # the unit last, as in "Kraft / N", "h/mm", "Thrust, gf" and "Zeit in s"
    for sign in (" / ", ",", " in ", "/"):
        head, _, last = heading.strip().rpartition(sign)
        # a unit of its own: m/s
        is_unit = sign == "/" and (unit_word(head) or not head.isalpha()) and last in SECONDS
        if head and not is_unit and (stated := unit_word(last)):
            return head, stated
    head, _, suffix = heading.strip().rpartition("_")
    # a lower-case n is newtons in the name of a force
    is_unit = suffix not in NO_UNITS or (
        suffix == "n" and any(word in fold(head) for word in WORDS["force"])
    )
    known = unit_word(suffix) or (len(suffix) > 2 and WORDS["units"].get(fold(suffix)))
    if head and is_unit and known:
        return head, known
    return heading, WORDS["clock_units"].get(fold(heading), "")


def words(heading: str) -> set[str]:
    """The words of a name, folded, its unit left out."""
    return set(re.findall(r"[^\W\d_]+|±", fold(named(heading)[0])))


def says(heading: str, *kinds: str) -> bool:
    """Whether a name has a word of one of these kinds, such as ``"mean"``."""
    return any(words(heading) & {*WORDS[kind]} for kind in kinds)


# ---- channels of a record


def likely_force(columns: Sequence[tuple[str, str]]) -> int | None:
    """Place of the one column that may be the load cell's, by names and units; else None.

    It is called a force, or is in a unit of force. Of several, it is the most certain one.
    """
    ranks = [_rank(*column) for column in columns]
    best = max(ranks, default=0)
    return ranks.index(best) if best and ranks.count(best) == 1 else None


def _rank(heading: str, unit: str) -> int:
    plain = fold(named(heading)[0])
    ranked = [len(WORDS["force"]) - i + 2 for i, word in enumerate(WORDS["force"]) if word in plain]
    force = max(ranked, default=len(words(heading) & {*WORDS["lift"]}))
    mean = 100 * says(heading, "mean")
    if says(heading, "command") or (says(heading, "motor") and not force):
        return 0
    if unit in FORCE_UNITS:
        return 100 + force + mean
    if not force:
        return 0
    # a gram is a force only in a channel that is called one
    return 50 + force if unit in AS_FORCE else (force + mean) * (unit in ("", "count"))


def force_channel(channels: Sequence[Channel]) -> Channel | None:
    """Channel that may be the load cell: `likely_force`, else the only one that is no clock."""
    place = likely_force([(c.name, c.unit) for c in channels])
    if place is not None:
        return channels[place]
    only = [c for c in channels if not is_clock(c.name) and c.unit not in SECONDS]
    return only[0] if len(only) == 1 and not says(only[0].name, "command", "motor") else None


def is_clock(heading: str) -> bool:
    """Whether a column of that name is a clock."""
    bare, unit = named(heading)
    called = fold(bare.rsplit(".", 1)[-1])
    return (called in WORDS["clock"] and unit in ("", *SECONDS)) or called in WORDS["clock_units"]


def stamp_unit(clock: FloatArray) -> str:
    """The unit of a clock's stamps since 1970, or of a spreadsheet's days; empty for others."""
    first, last = (float(clock[i]) for i in (0, -1)) if len(clock) else (0.0, 0.0)
    for unit in ("s", "ms", "us", "ns"):
        if STAMPS_S[0] < first * SECONDS[unit] < STAMPS_S[1]:
            return unit
    dated = any(low < first < high for low, high in STAMPS_DAYS)
    return "day" if dated and 0 < last - first < 1 else ""


# ---- columns of a schedule


def is_own_name(heading: str) -> bool:
    """Whether a heading is the name of a schedule's column, its unit left out."""
    return fold(named(heading)[0]).replace(" ", "_") in BY_NAME


def schedule_column(heading: str) -> tuple[str, str]:
    """Column of the schedule that a heading means, and its unit; each may be empty."""
    bare, unit = named(heading)
    ratios = {fold(heading).replace("_over_", "/").replace(" ", ""), fold(unit)}
    if ratios & {*WORDS["radii"]} or unit == RADII:
        return "distance", RADII
    if ratios & {*WORDS["diameters"]} or unit == DIAMETERS:
        return "distance", DIAMETERS
    plain, others = fold(bare).replace("_", " "), WORDS["columns"]
    may = [k for k in KNOWN if plain in (k.name.replace("_", " "), *others.get(k.name, ()))]
    # a unit of another dimension makes it another quantity
    for known in may:
        written = unit_of(known.name, unit) if known.kind == "quantity" else ""
        if written or (known.kind != "quantity" and not unit):
            return known.name, written
    if may and not unit:
        # one letter for two quantities
        return (may[0].name if len(may) == 1 else ""), ""
    if says(heading, "other_statistic", "scatter"):
        return "", ""
    for column in (c for c, one in WORDS["one_word"].items() if words(heading) & {*one}):
        written = unit_of(column, unit) if unit else ""
        if written or (not unit and column != "supply"):
            return column, written
    return "", ""


def unit_of(column: str, unit: str) -> str:
    """Unit of a schedule's column as the manifest has it; empty if missing, or of another kind."""
    known = BY_NAME[column]
    written = (AS_FORCE.get(unit, unit) if known.dimension == "force" else unit) or known.own_unit
    try:
        units.to_si(written, known.dimension, "")
    except ManifestError:
        return ""
    return written
