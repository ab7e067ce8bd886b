"""The columns of a schedule: their names outside and inside, and how cells become SI numbers."""

from __future__ import annotations

import datetime
import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nearlift import units
from nearlift.campaign.manifest import Campaign
from nearlift.campaign.segments import ColumnOfRecord, Segments
from nearlift.declare import BOUNDARIES, FloatArray
from nearlift.errors import ManifestError, brief, did_you_mean
from nearlift.nomenclature import CARRIED
from nearlift.units import NUMBER

#: What a cell without a value may hold.
BLANK = ("", "nan", "na", "n/a", "none", "null", "-")

#: Kinds of characters that do not show: control, direction, ends of lines.
_UNSEEN = ("Cc", "Cf", "Zl", "Zp")


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """A column of the contract: `name` in trials.csv, `inside` in products, dimension or kind."""

    name: str
    inside: str
    dimension: str = ""
    kind: Literal["quantity", "plain", "text"] = "quantity"
    own_unit: str = ""


KNOWN = (
    Known(name="trial", inside="trial", kind="text"),
    Known(name="boundary", inside="boundary", kind="text"),
    Known(name="distance", inside="distance_m", dimension="length"),
    Known(name="reached", inside="reached_m", dimension="length"),
    Known(name="throttle", inside="throttle", dimension="throttle"),
    Known(name="start", inside="start_s", dimension="time"),
    Known(name="session", inside="session", kind="text"),
    Known(name="supply", inside="supply_V", dimension="voltage"),
    Known(name="current", inside="current_A", dimension="current"),
    # the only column whose name is its unit
    Known(name="rpm", inside="speed_Hz", dimension="rotation", own_unit="rpm"),
    Known(name="power", inside="power_W", dimension="power"),
    Known(name="temperature", inside="temperature_K", dimension="temperature"),
    Known(name="pressure", inside="pressure_Pa", dimension="pressure"),
    Known(name="humidity", inside="humidity", dimension="fraction"),
    Known(name="approach", inside="approach", kind="plain"),
    Known(name="tilt", inside="tilt_rad", dimension="angle"),
    Known(name="orientation", inside="orientation", kind="text"),
    Known(name="turn", inside="turn_rad", dimension="angle"),
    Known(name="propeller", inside="propeller", kind="text"),
    Known(name="fountain", inside="fountain_side", kind="plain"),
    Known(name="tare_after", inside="tare_after_N", dimension="force"),
    Known(name="roll_moment", inside="roll_moment_Nm", dimension="torque"),
    Known(name="pitch_moment", inside="pitch_moment_Nm", dimension="torque"),
    Known(name="wall_force", inside="wall_force_N", dimension="force"),
    Known(name="u_roll_moment", inside="u_roll_moment_Nm", dimension="torque"),
    Known(name="u_pitch_moment", inside="u_pitch_moment_Nm", dimension="torque"),
    Known(name="u_wall_force", inside="u_wall_force_N", dimension="force"),
    Known(name="lift", inside="lift_N", dimension="force"),
    Known(name="lift_sd", inside="lift_sd_N", dimension="force"),
    Known(name="n", inside="n", kind="plain"),
)
BY_NAME = {k.name: k for k in KNOWN}
#: What is measured beside lift; ``u_`` before a name is its standard uncertainty.
BESIDE = tuple(k.name for k in KNOWN if k.inside in CARRIED)
#: Columns of a schedule that pieces may bring.
BRINGABLE = tuple(k.name for k in KNOWN if k.kind == "quantity" and not k.name.startswith("lift"))


@dataclass(frozen=True, slots=True)
class ColumnTexts:
    """One column as read: its name, its texts, and where each stands (``trials.csv, line 7``)."""

    name: str
    texts: Sequence[str]
    file: str
    lines: Sequence[int]

    def at(self, i: int) -> str:
        """Where cell `i` stands."""
        kind = f"line {self.lines[i]}, column" if self.lines else "constant"
        return f"{self.file}, {kind} {self.name!r}"


class Numbers(Sequence[str]):
    """The texts of cells that were numbers before, written only where they are read; NaN blank."""

    def __init__(self, values: FloatArray) -> None:
        self.values = values

    def __len__(self) -> int:
        return len(self.values)

    def __getitem__(self, i: Any) -> Any:
        value = float(self.values[i])
        return "" if value != value else repr(value)


def numbers(cells: ColumnTexts, *, blank: bool) -> FloatArray:
    """The cells as plain numbers, NaN where blank; `ManifestError` of one that is no number, or is
    blank where `blank` is False.
    """
    if isinstance(cells.texts, Numbers) and blank and not np.isinf(cells.texts.values).any():
        return cells.texts.values
    out = np.empty(len(cells.texts))
    for i, text in enumerate(cells.texts):
        value = text.strip()
        if NUMBER.fullmatch(value):
            out[i] = float(value)
            if math.isinf(out[i]):
                raise ManifestError(
                    cells.at(i),
                    f"{brief(value)} is beyond what a number can hold",
                    "mend it; the largest is 1.8e308",
                )
        elif value.lower() in BLANK:
            if not blank:
                raise ManifestError(cells.at(i), without(value), "every trial needs this number")
            out[i] = math.nan
        else:
            comma = (
                "write decimals with a point"
                if re.fullmatch(r"[-+]?\d+,\d+", value)
                else "write a number; leave the cell empty where it is not known"
            )
            raise ManifestError(cells.at(i), f"{brief(repr(text))} is not a number", comma)
    return out


def without(text: str) -> str:
    """What is wrong with a cell that says no value."""
    return f"{text.strip()!r} is no value" if text.strip() else "is empty"


def quantity(
    cells: ColumnTexts, known: Known, unit: str | None, *, blank: bool = True
) -> FloatArray:
    """The cells in SI, NaN where blank, by the `unit` that the manifest says, None where it says
    nothing; `ManifestError` of a cell that is no number, and without a unit of the dimension.
    """
    unit = unit or known.own_unit
    if not unit:
        si = units.SI[known.dimension]
        si = "percent" if si == "dimensionless" else si
        raise ManifestError(
            "trials.units",
            f"the column {known.name!r} has no unit",
            f'add {known.name} = "..." (such as "{si}") under [trials.units]',
        )
    factor, offset = units.to_si(unit, known.dimension, f"trials.units.{known.name}")
    return factor * numbers(cells, blank=blank) + offset


def seconds(cells: ColumnTexts, unit: str | None) -> FloatArray:
    """Start times: numbers in `unit`, or ISO 8601 texts, which become seconds since the first
    trial; `ManifestError` of what is neither, or with a time zone only here and there.
    """
    if unit is not None:
        return quantity(cells, BY_NAME["start"], unit)
    stamps: list[datetime.datetime | None] = []
    for i, text in enumerate(cells.texts):
        if text.strip().lower() in BLANK:
            stamps.append(None)
            continue
        try:
            # fromisoformat takes bare digits for a date such as 20260101: those want a unit
            if NUMBER.fullmatch(text.strip()):
                raise ValueError
            stamps.append(datetime.datetime.fromisoformat(text.strip()))
        except ValueError:
            raise ManifestError(
                cells.at(i),
                f"{text!r} is not ISO 8601 time, and start has no unit",
                'add start = "s" under [trials.units], or write 2026-03-01T14:05:00',
            ) from None
    known = [s for s in stamps if s is not None]
    if len({s.tzinfo is None for s in known}) > 1:
        raise ManifestError(
            f"{cells.file}, column 'start'",
            "mixes times with and without a time zone",
            "write all of them alike",
        )
    return np.array([math.nan if s is None else (s - known[0]).total_seconds() for s in stamps])


def further(cells: ColumnTexts) -> NDArray[Any]:
    """A column that the contract does not name: numbers if all filled cells are, else the texts."""
    filled = [t.strip() for t in cells.texts if t.strip().lower() not in BLANK]
    if filled and all(NUMBER.fullmatch(t) for t in filled):
        return numbers(cells, blank=True)
    return np.array([t.strip() for t in cells.texts], dtype=object)


def ids(cells: ColumnTexts) -> NDArray[Any]:
    """The trials' ids; refuses one that is blank, does not show, or stands twice."""
    first: dict[str, int] = {}
    for i, text in enumerate(cells.texts):
        name = text.strip()
        shown = name.isprintable() or all(unicodedata.category(c) not in _UNSEEN for c in name)
        if not name or not shown:
            what = f"{name!a} holds a character that does not show" if name else "holds no trial id"
            raise ManifestError(cells.at(i), what, "give every trial an id of its own")
        if name in first:
            raise ManifestError(
                cells.at(i),
                f"trial {name!r} stands already in {cells.at(first[name]).split(', column')[0]}",
                "give every trial an id of its own",
            )
        first[name] = i
    return np.array(list(first), dtype=object)


def boundaries(cells: ColumnTexts) -> NDArray[Any]:
    """The boundaries' names; refuses one that there is not."""
    allowed = (*BOUNDARIES, "none")
    names = [t.strip() for t in cells.texts]
    for i, name in enumerate(names):
        if name not in allowed:
            raise ManifestError(
                cells.at(i),
                f"{name!r} is not a boundary",
                did_you_mean(name.lower(), allowed) or f"boundaries are {', '.join(allowed)}",
            )
    return np.array(names, dtype=object)


def plain(cells: ColumnTexts, name: str) -> FloatArray:
    """Plain numbers: approach (+1, -1, or 0 where the traverse did not move), n (whole, from 1)."""
    values = numbers(cells, blank=True)
    for i, value in enumerate(values):
        if name == "approach" and not (np.isnan(value) or value in (-1.0, 0.0, 1.0)):
            raise ManifestError(
                cells.at(i),
                f"{cells.texts[i].strip()!r} is not a side",
                "approach is +1 when the last move was away from the boundary, -1 towards it",
            )
        if name == "n" and not (np.isnan(value) or (value >= 1 and value == int(value))):
            raise ManifestError(
                cells.at(i),
                f"{cells.texts[i].strip()!r} is not a number of samples",
                "n is a whole number from 1",
            )
    return values


def counts(campaign: Campaign, cells: ColumnTexts) -> FloatArray:
    """A zero reading in counts, through the force channel's calibration."""
    if campaign.records.force is None:
        raise ManifestError(
            "trials.units.tare_after",
            "is in counts, but [records] has no force channel",
            "give it in a unit of force",
        )
    factor, zero = campaign.records.force.linear()
    return factor * (numbers(cells, blank=True) - zero)


def brought(cut: Segments) -> dict[str, tuple[ColumnOfRecord, str]]:
    """The schedule's columns that pieces bring: the column of the record that says each, and the
    manifest's key for it; `ManifestError` of a name that is none of the schedule's, a column
    without a unit, and what two bring.
    """
    columns: dict[str, tuple[ColumnOfRecord, str]] = {}
    if cut.has_level:
        columns[cut.maps] = cut.level(), "segments"
    for name, column in cut.columns.items():
        key = f"segments.columns.{name}"
        if name not in BRINGABLE:
            hint = did_you_mean(name, BRINGABLE) or f"known are {', '.join(BRINGABLE)}"
            raise ManifestError(key, "is no column of a schedule that a record may have", hint)
        if name in columns:
            raise ManifestError(key, "is what the level says already", "take one of them away")
        columns[name] = column, key
        if name in BESIDE:
            # from the same samples
            columns[f"u_{name}"] = column, key
    for name, (column, key) in columns.items():
        column.linear(dimension_of(name), key)
    return columns


def brought_by(campaign: Campaign) -> tuple[str, ...]:
    """The schedule's columns that the pieces of a campaign's records bring; raises as `brought`."""
    assert campaign.segments is not None
    return tuple(brought(campaign.segments))


def dimension_of(name: str) -> str:
    """The dimension of a schedule's column; empty for one that has none."""
    return BY_NAME[name].dimension if name in BY_NAME else ""
