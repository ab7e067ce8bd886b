"""The schedule `trials.csv` as SI columns: boundary, distance, throttle and conditions of every
trial, in the order in which they were run.

A known column needs its unit, and a cell that is no number is named with its line. Any further
column is kept under its own name. Distances must be possible in the rig of the manifest.
"""

from __future__ import annotations

import csv
import datetime
import io
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nearlift import units
from nearlift.campaign.manifest import Campaign
from nearlift.campaign.rig import ColumnOfRecord, Segments
from nearlift.declare import BOUNDARIES, Boundary, FloatArray, IntArray
from nearlift.errors import InputRefused, ManifestError, NearliftError, brief, did_you_mean
from nearlift.nomenclature import CARRIED
from nearlift.readers.files import content_of, inside, packing
from nearlift.readers.guarded import Malformed
from nearlift.units import NUMBER

#: Largest compressed schedule, unpacked, bytes.
MOST_BYTES = 8 << 20
#: Cells without a value, in lower case.
BLANK = ("", "nan", "na", "n/a", "none", "null", "-")
#: Categories of invisible characters: control, direction, ends of lines.
INVISIBLE = ("Cc", "Cf", "Zl", "Zp")
REQUIRED = ("trial", "boundary", "distance", "throttle")
MEANS = ("lift", "lift_sd", "n")
STANDARD_ERROR = "a standard error times the square root of n is lift_sd"
#: Units of distances that are multiples of the rotor radius, and of its diameter.
RADII, DIAMETERS = "R", "2 R"
#: Column of the record's id, in a schedule of records and in trials.parquet.
RECORD_COLUMN = "record"
#: Smallest distance over rotor radius; and the least of the farthest trial of a boundary.
NEAREST, LEAST_FARTHEST = 1e-4, 1 / 50
#: Full scale of a share, and the meaning of one that never exceeds 1 %.
SHARES = {
    "throttle": ("full throttle", "at which no rotor lifts anything"),
    "humidity": ("saturation", "drier than any room"),
}


class Known(NamedTuple):
    """A column of the contract: `name` in trials.csv, `inside` in products, dimension or kind."""

    name: str
    inside: str
    dimension: str = ""
    kind: Literal["quantity", "plain", "text"] = "quantity"
    own_unit: str = ""


KNOWN = (
    Known("trial", "trial", kind="text"),
    Known("boundary", "boundary", kind="text"),
    Known("distance", "distance_m", "length"),
    Known("reached", "reached_m", "length"),
    Known("throttle", "throttle", "throttle"),
    Known("start", "start_s", "time"),
    Known("session", "session", kind="text"),
    Known("supply", "supply_V", "voltage"),
    Known("current", "current_A", "current"),
    Known("rpm", "speed_Hz", "rotation", own_unit="rpm"),
    Known("power", "power_W", "power"),
    Known("temperature", "temperature_K", "temperature"),
    Known("pressure", "pressure_Pa", "pressure"),
    Known("humidity", "humidity", "fraction"),
    Known("approach", "approach", kind="plain"),
    Known("tilt", "tilt_rad", "angle"),
    Known("orientation", "orientation", kind="text"),
    Known("turn", "turn_rad", "angle"),
    Known("propeller", "propeller", kind="text"),
    Known("fountain", "fountain_side", kind="plain"),
    Known("tare_after", "tare_after_N", "force"),
    Known("roll_moment", "roll_moment_Nm", "torque"),
    Known("pitch_moment", "pitch_moment_Nm", "torque"),
    Known("wall_force", "wall_force_N", "force"),
    Known("u_roll_moment", "u_roll_moment_Nm", "torque"),
    Known("u_pitch_moment", "u_pitch_moment_Nm", "torque"),
    Known("u_wall_force", "u_wall_force_N", "force"),
    Known("lift", "lift_N", "force"),
    Known("lift_sd", "lift_sd_N", "force"),
    Known("n", "n", kind="plain"),
)
BY_NAME = {k.name: k for k in KNOWN}
#: Columns measured in addition to lift; `u_` before a name is the standard uncertainty.
OUTCOMES = tuple(k.name for k in KNOWN if k.inside in CARRIED)
#: Columns of a schedule that pieces of a record may bring.
BRINGABLE = tuple(k.name for k in KNOWN if k.kind == "quantity" and not k.name.startswith("lift"))
#: First columns of trials.parquet: each trial, and how the rig was set for it.
SETTINGS = ("trial", "boundary", "z_hat", "z_m", "throttle")
#: Names that a further column must not have.
OF_TRIALS = (
    *SETTINGS,
    *[
        "lift_N",
        "u_lift_N",
        "u_zero_N",
        "n",
        "n_removed",
        "n_eff",
        "drift_N_s",
        "sd_N",
        "quality",
        "visit",
    ],
    *["source_sha256", "source", "samples", "completeness", "fault"],
)
RESERVED = {*OF_TRIALS, "u_height_m"} | {k.inside for k in KNOWN}


@dataclass(frozen=True, slots=True)
class TextColumn:
    """The texts of one column, their lines (none for a constant), and the unit if one is given."""

    name: str
    texts: Sequence[str]
    file: str
    lines: Sequence[int] = ()
    unit: str = ""

    def place(self, i: int) -> str:
        """File, line and column of cell `i`."""
        kind = f"line {self.lines[i]}, column" if self.lines else "constant"
        return f"{self.file}, {kind} {self.name!r}"

    def refusal(
        self, i: int, what: str, remedy: str, kind: type[NearliftError] = ManifestError
    ) -> NearliftError:
        """Refusal with the place of cell `i`."""
        return kind(self.place(i), what, remedy)

    def blank(self, i: int, remedy: str) -> NearliftError:
        """Refusal of a cell without a value."""
        cell = self.texts[i]
        return self.refusal(i, f"{cell!r} is no value" if cell else "is empty", remedy)

    def numbers(self, *, blank: bool = True) -> FloatArray:
        """The cells as numbers, NaN where blank; refuses other cells, and blanks unless `blank`."""
        values = np.full(len(self.texts), math.nan)
        for i, cell in enumerate(self.texts):
            if NUMBER.fullmatch(cell):
                values[i] = float(cell)
                if math.isinf(values[i]):
                    what = f"{brief(cell)} is beyond what a number can hold"
                    raise self.refusal(i, what, "correct it; the largest is 1.8e308")
            elif cell.lower() not in BLANK:
                remedy = "write a number; leave the cell empty where it is not known"
                if re.fullmatch(r"[-+]?\d+,\d+", cell):
                    remedy = "write decimals with a point"
                raise self.refusal(i, f"{brief(repr(cell))} is not a number", remedy)
            elif not blank:
                raise self.blank(i, "every trial needs this number")
        return values

    def si(self, *, blank: bool = True) -> FloatArray:
        """The cells in SI, by the column's unit."""
        dimension = BY_NAME[self.name].dimension
        if not (unit := self.unit or BY_NAME[self.name].own_unit):
            usual = units.SI[dimension].replace("dimensionless", "percent")
            remedy = f'add {self.name} = "..." (such as "{usual}") under [trials.units]'
            raise ManifestError("trials.units", f"the column {self.name!r} has no unit", remedy)
        factor, offset = units.to_si(unit, dimension, f"trials.units.{self.name}")
        return factor * self.numbers(blank=blank) + offset


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """The trials of a campaign in run order; every array has one entry per trial.

    `z_m` is rotor plane (sidewall: nearest blade tip) to boundary: the recorded distance plus the
    datum's offset, inf in free air. `z_hat` is `z_m` over rotor radius; `throttle` is a fraction.
    `visit` counts the traverse's stops. `covariates` are in SI, NaN where blank, the unit in the
    name (`supply_V`); unknown columns keep their own name.

    `means` (`lift_N`, `lift_sd_N`, `n`) exist for ``reader = "means"`` only. `reached_m` are the
    traverse's own readings plus the datum's offset. `notes` are remarks for the user.
    """

    trial: NDArray[Any]
    boundary: NDArray[Any]
    z_m: FloatArray
    z_hat: FloatArray
    throttle: FloatArray
    visit: IntArray
    covariates: Mapping[str, NDArray[Any]]
    means: Mapping[str, NDArray[Any]] | None = None
    reached_m: FloatArray | None = None
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.trial)


def schedule_file(campaign: Campaign, root: Path) -> Path:
    """The schedule's path, checked to lie under `root`."""
    return inside(root, campaign.trials.file, "trials.file")[0]


def read_schedule(campaign: Campaign, root: Path) -> Schedule:
    """Read and check the schedule of a campaign.

    Raises `InputRefused` for a missing or damaged file and for impossible distances. Raises
    `ManifestError` for a wrong column, unit or cell and for two trials with one id.
    """
    columns, notes = read_columns(campaign, root)
    bring: Collection[str] = ()
    if campaign.segments is not None:
        columns, bring = rename_records(campaign, root, columns)
    return of_columns(campaign, root, columns, notes, bring)


# ---- text to columns


def read_columns(campaign: Campaign, root: Path) -> tuple[dict[str, TextColumn], list[str]]:
    """Every column of the schedule's file, constants included, and a note if its last line has no
    end: a cut can turn `300` into `30`.
    """
    path, given = schedule_file(campaign, root), campaign.trials.units
    text = _text_of(path)
    header, lines, rows = _rows_of(path, text)
    columns = {
        name: TextColumn(name, texts, path.name, lines, given.get(name, ""))
        for name, texts in zip(header, zip(*rows, strict=True), strict=True)
    }
    for name, value in campaign.trials.constants.items():
        key, cell, unit = f"trials.constants.{name}", str(value).strip(), given.get(name, "")
        if name in columns:
            raise ManifestError(key, f"is also a column of {path.name}", "keep one of them")
        dimension = dimension_of(name)
        is_number = NUMBER.fullmatch(cell) or not isinstance(value, str)
        # a constant may have a unit of its own
        if dimension and not is_number and not (name == "start" and "T" in cell):
            cell, unit = repr(units.quantity(value, dimension, key)), units.SI[dimension]
        columns[name] = TextColumn(name, [cell] * len(rows), "campaign.toml", unit=unit)
    last = re.split(r"[\r\n]", text)[-1]
    if not last.strip():
        return columns, []
    note = (
        f"{path.name} ends within a line, {brief(repr(last), 80)}: if it was cut off there, that"
        " row is wrong and more may be lost; end the line"
    )
    return columns, [note]


def _text_of(path: Path) -> str:
    """The file, or its first sheet, as text; refuses one that is missing or not UTF-8."""
    if not path.is_file():
        remedy = "the schedule lists every trial; name it under [trials] file = ..."
        raise InputRefused(str(path), "is missing", remedy)
    try:
        packed = packing(path)
        content = content_of(path, MOST_BYTES + 1 if packed else None)
        if packed and len(content) > MOST_BYTES:
            what = f"holds more than {MOST_BYTES >> 20} MB"
            raise InputRefused(str(path), what, "unpack it: no schedule has so many trials")
        return content.decode("utf-8-sig")
    except Malformed as fault:
        raise InputRefused(str(path), str(fault), "save the schedule as CSV") from None
    except UnicodeDecodeError as fault:
        what = f"is not UTF-8 text (byte {fault.start})"
        raise InputRefused(str(path), what, "save it as UTF-8") from None


def _rows_of(path: Path, text: str) -> tuple[list[str], list[int], list[list[str]]]:
    """Names of the columns, and line and cells of each row, of a CSV text.

    Remarks (`#`) above the header are left out, but no header behind `#`: its names are refused.
    """
    above = re.match(r"(?:[ \t]*(?:#[^\r\n]*)?(?:\r\n|\r|\n))*", text)
    remarks = above[0] if above else ""
    named = [{cell.strip(' \t"#') for cell in line.split(",")} for line in remarks.splitlines()]
    if not any({"trial"} < cells & BY_NAME.keys() for cells in named):
        text = re.sub(r"#[^\r\n]*", "", remarks) + text[len(remarks) :]
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    lines, rows = list[int](), list[list[str]]()
    try:
        for row in reader:
            if any(cells := [cell.strip() for cell in row]):
                lines.append(reader.line_num)
                rows.append(cells)
    except csv.Error as fault:
        at = f"{path}, line {reader.line_num}"
        raise InputRefused(at, f"is not CSV: {fault}", "correct that line") from None
    if len(rows) < 2:
        what = "lists no trial" if rows else "is empty"
        remedy = "the first line names the columns, then one line per trial, in run order"
        raise InputRefused(str(path), what, remedy)
    header = rows[0]
    uneven = [k for k, row in enumerate(rows) if len(row) != len(header)]
    wrong, what = uneven[0] if uneven else 0, ""
    if len(header) == 1 and re.search(r"[;\t]", header[0]):
        wrong, what = 0, "is not separated by commas"
        remedy = "save it with commas between cells and points in decimals"
    elif "" in header:
        wrong, what = 0, f"column {header.index('') + 1} has no name"
        remedy = "name it, or take the extra comma away"
    elif twice := sorted(n for n, k in Counter(header).items() if k > 1):
        wrong, what, remedy = 0, f"the column {twice[0]!r} is there twice", "rename or drop one"
    elif uneven:
        what = f"has {len(rows[wrong])} cells under {len(header)} column names"
        remedy = "correct that line (a decimal comma splits a cell)"
    if what:
        raise InputRefused(f"{path}, line {lines[wrong]}", what, remedy)
    return header, lines[1:], rows[1:]


# ---- schedules of records


def columns_from_record(cut: Segments) -> dict[str, tuple[ColumnOfRecord, str]]:
    """The schedule's columns that pieces bring, each with its column of the record and its manifest
    key.

    `ManifestError` for an unknown name, a missing unit, and one name twice.
    """
    columns = {cut.becomes: (cut.level, "segments")} if cut.level is not None else {}
    for name, column in cut.columns.items():
        key = f"segments.columns.{name}"
        if name not in BRINGABLE:
            hint = did_you_mean(name, BRINGABLE) or f"known are {', '.join(BRINGABLE)}"
            raise ManifestError(key, "is no column of a schedule that a record may have", hint)
        if name in columns:
            raise ManifestError(key, "is given by the level already", "take one of them away")
        columns[name] = column, key
        if name in OUTCOMES:
            columns[f"u_{name}"] = column, key  # from the same samples
    for name, (column, key) in columns.items():
        column.linear(dimension_of(name), key)
    return columns


def dimension_of(name: str) -> str:
    """The dimension of a schedule's column; empty without one."""
    return BY_NAME[name].dimension if name in BY_NAME else ""


def rename_records(
    campaign: Campaign, root: Path, columns: Mapping[str, TextColumn]
) -> tuple[dict[str, TextColumn], Collection[str]]:
    """A schedule of records under the names of one of trials, and the columns that pieces bring.

    `ManifestError` without a column `record`, or with a column that pieces bring.
    """
    assert campaign.segments is not None
    bring, what = columns_from_record(campaign.segments), ""
    if RECORD_COLUMN not in columns or "trial" in columns:
        what = "has a column 'trial'" if "trial" in columns else "has no column 'record'"
        remedy = "with [segments] a row is a record: call the column of its ids record"
    elif both := [name for name in bring if name in columns]:
        what = f"the column {both[0]!r} is also brought by the pieces of records, by [segments]"
        remedy = "take the column away, or the key under [segments] (becomes, columns)"
    if what:
        raise ManifestError(str(root / campaign.trials.file), what, remedy)
    return {"trial" if n == RECORD_COLUMN else n: column for n, column in columns.items()}, bring


# ---- columns to a schedule


def of_columns(
    campaign: Campaign,
    root: Path,
    columns: Mapping[str, TextColumn],
    notes: Iterable[str],
    missing: Collection[str] = (),
) -> Schedule:
    """The schedule of columns of text; raises as `read_schedule` does.

    Required columns in `missing` may be absent or blank: pieces of records bring them.
    """
    path, notes = root / campaign.trials.file, list(notes)
    _check_names(campaign, path, columns, missing)
    trial, boundary = _ids(columns["trial"]), _boundaries(columns["boundary"])
    z_m = _distances(campaign, columns.get("distance"), boundary, "distance" in missing)
    covariates: dict[str, NDArray[Any]] = {}
    for name, column in columns.items():
        if name in ("trial", "boundary", "distance"):
            continue
        if name in BY_NAME:
            covariates[BY_NAME[name].inside] = _values(column, name in missing)
            continue
        if name in RESERVED:
            what = f"the column {name!r} has the name of a result"
            raise ManifestError(str(path), what, "rename it")
        # files' names, from which `new` took the ids, keep their heading
        files = all(map(str.startswith, column.texts, columns["trial"].texts))
        hint = did_you_mean(name, [n for n in BY_NAME if n not in columns])
        if re.search(r"(?:^|[ _])(?:se|sem)(?:$|[ _(])", name):
            hint = STANDARD_ERROR
        if hint and not files:
            notes.append(f"{path.name}: column {name!r} is kept as it is; {hint}")
        filled = [t for t in column.texts if t.lower() not in BLANK]
        is_numeric = filled and all(map(NUMBER.fullmatch, filled))
        covariates[name] = column.numbers() if is_numeric else np.array(column.texts, dtype=object)
    means = {n: covariates.pop(n) for n in (BY_NAME[m].inside for m in MEANS) if n in covariates}
    approach, session = covariates.get("approach"), covariates.get("session")
    if "start_s" in covariates:
        notes += _backwards(columns["start"], covariates["start_s"], session)
    reached = covariates.pop("reached_m", None)
    if reached is not None:
        sides = {*boundary} - {"none"}
        offsets = {side: campaign.distance_reference(side).offset_m for side in sides}
        reached = reached + [offsets.get(side, 0.0) for side in boundary]
    if "sidewall" in boundary and campaign.distance_reference("sidewall").datum == "rotor plane":
        notes.append(
            "sidewall distances are taken as wall to nearest blade tip; declare it with"
            ' distance_datum = { sidewall = "blade tip" }'
        )
    return Schedule(
        trial=trial,
        boundary=boundary,
        z_m=z_m,
        z_hat=z_m / campaign.vehicle.rotor_radius,
        throttle=covariates.pop("throttle", np.full(len(trial), np.nan)),
        visit=visits(boundary, z_m, approach, session, ordered=campaign.trials.order == "run"),
        covariates=covariates,
        means=means or None,
        reached_m=reached,
        notes=tuple(notes),
    )


def _check_names(
    campaign: Campaign, path: Path, columns: Mapping[str, TextColumn], missing: Collection[str]
) -> None:
    """Refuse a unit of an unknown column, a schedule without a required column, mean lifts with
    records, and ``reader = "means"`` without them.
    """
    for name in campaign.trials.units:
        if name not in columns and name not in BY_NAME:
            hint = did_you_mean(name, [*columns, *BY_NAME]) or f"columns are {', '.join(columns)}"
            raise ManifestError(f"trials.units.{name}", "no column has that name", hint)
    free_air = "boundary" in columns and {*columns["boundary"].texts} == {"none"}
    lacking = [n for n in REQUIRED if not (n in columns or n in missing)]
    for name in (n for n in lacking if n != "distance" or not free_air):
        hint = did_you_mean(name, [c for c in columns if c not in BY_NAME])
        add_it = f"add it, or set it for all under [trials.constants]: {name} = ..."
        if name == "trial":
            different = [c for c in columns.values() if len({*c.texts}) == len(c.texts)]
            listed = ", ".join(repr(c.name) for c in different if c.name not in BY_NAME)
            add_it = "it names each trial's record: " + (f"rename {listed}, or " * bool(listed))
            add_it += "add a column of ids"
        remedy = hint.replace("did you mean", "is it") or add_it
        raise ManifestError(str(path), f"has no column {name!r}", remedy)
    reader, means = campaign.records.reader, [name for name in MEANS if name in columns]
    if reader == "means" and "lift" not in means:
        remedy = 'reader = "means" takes the mean lift of every trial from it; add lift, and its'
        remedy += " unit under [trials.units]"
        raise ManifestError(str(path), "has no column 'lift'", remedy)
    if means and reader != "means":
        what = f'the column {means[0]!r} belongs to reader = "means"'
        raise ManifestError(str(path), what, f"rename it; here the lift is from {reader} records")


def _ids(column: TextColumn) -> NDArray[Any]:
    """The trials' ids; refuses a blank, an invisible character, and one id twice."""
    first: dict[str, int] = {}
    for i, name in enumerate(column.texts):
        what = "" if name else "holds no trial id"
        if any(unicodedata.category(c) in INVISIBLE for c in name):
            what = f"{name!a} holds a character that does not show"
        if name in first:
            what = f"trial {name!r} is already in {column.place(first[name]).split(', column')[0]}"
        if what:
            raise column.refusal(i, what, "give every trial an id of its own")
        first[name] = i
    return np.array(column.texts, dtype=object)


def _boundaries(column: TextColumn) -> NDArray[Any]:
    """The boundaries' names; refuses an unknown one."""
    allowed = (*BOUNDARIES, "none")
    for i, name in enumerate(column.texts):
        if name not in allowed:
            hint = did_you_mean(name.lower(), allowed) or f"boundaries are {', '.join(allowed)}"
            raise column.refusal(i, f"{name!r} is not a boundary", hint)
    return np.array(column.texts, dtype=object)


def _values(column: TextColumn, blank: bool) -> NDArray[Any]:
    """A known column in SI; refuses values that it cannot have, and blanks unless `blank` where
    every trial needs one.
    """
    name, kind, unit = column.name, BY_NAME[column.name].kind, column.unit
    if kind == "text":
        return np.array(column.texts, dtype=object)
    if name == "start" and not unit:
        return _seconds_since_first(column)
    if kind == "plain":
        values = column.numbers()
        possible, what = np.ones(len(values), dtype=bool), ""
        if name == "approach":
            possible, what = np.isin(values, (-1, 0, 1)), "side"
            remedy = "approach is +1 when the last move was away from the boundary, -1 towards it"
        elif name == "n":
            possible, what = (values >= 1) & (values % 1 == 0), "number of samples"
            remedy = "n is a whole number from 1"
        for i in np.flatnonzero(np.isfinite(values) & ~possible).tolist():
            raise column.refusal(i, f"{column.texts[i]!r} is not a {what}", remedy)
        return values
    values = column.si(blank=blank or name not in ("lift", "throttle"))
    if name not in SHARES:
        return values
    # a share outside 0 to 1, or never above 1 %, has another unit
    whole, too_little = SHARES[name]
    for i in np.flatnonzero((values < 0) | (values > 1 + 1e-9)).tolist():
        cell, dimension = column.texts[i], dimension_of(name)
        other = [u for u in units.plausible(float(cell), dimension, 0.0, 1.0) if u != unit]
        remedy = f"{other[0]}?" if other else f"{name} is a part of {whole}"
        what = f"a {name} of {cell} {unit} is not between 0 and 1"
        raise column.refusal(i, what, remedy, InputRefused)
    i = int(np.argmax(np.nan_to_num(values)))
    if unit != "fraction" and 0 < values[i] <= 0.01 + 1e-9:
        what = f"the largest {name} is {column.texts[i]} {unit}, {too_little}"
        remedy = f"fraction? then correct {name} under [trials.units]"
        raise column.refusal(i, what, remedy, InputRefused)
    return values


def _seconds_since_first(column: TextColumn) -> FloatArray:
    """ISO 8601 times as seconds since the first one."""
    stamps: list[datetime.datetime | None] = []
    for i, cell in enumerate(column.texts):
        try:
            # fromisoformat takes bare digits for a date such as 20260101: those need a unit
            if NUMBER.fullmatch(cell):
                raise ValueError
            blank = cell.lower() in BLANK
            stamps.append(None if blank else datetime.datetime.fromisoformat(cell))
        except ValueError:
            what = f"{cell!r} is not ISO 8601 time, and start has no unit"
            remedy = 'add start = "s" under [trials.units], or write 2026-03-01T14:05:00'
            raise column.refusal(i, what, remedy) from None
    known = [s for s in stamps if s is not None]
    if len({s.tzinfo is None for s in known}) > 1:
        what = "mixes times with and without a time zone"
        raise ManifestError(f"{column.file}, column 'start'", what, "write all of them alike")
    return np.array([math.nan if s is None else (s - known[0]).total_seconds() for s in stamps])


def _distances(
    campaign: Campaign, column: TextColumn | None, boundary: NDArray[Any], blank: bool
) -> FloatArray:
    """Rotor plane (sidewall: blade tip) to boundary in m, inf in free air, NaN where a cell is
    blank and may be; refuses impossible distances.
    """
    free, r = boundary == "none", campaign.vehicle.rotor_radius
    if column is None:
        return np.full(len(boundary), np.inf)
    recorded = column.numbers()
    for i in np.flatnonzero(np.isfinite(recorded) == free).tolist():
        if free[i]:
            what = "free air (boundary none) has no distance"
            raise column.refusal(i, what, "leave the cell empty")
        if not blank:
            remedy = "every trial at a boundary needs its distance; free air is boundary none"
            raise column.blank(i, remedy)
    of_rotor = {RADII: r, DIAMETERS: 2 * r}.get(column.unit)
    z_m = np.where(free, np.inf, of_rotor * recorded if of_rotor else column.si())
    for side in BOUNDARIES:
        here = np.flatnonzero((boundary == side) & np.isfinite(recorded))
        if len(here):
            z_m[here] += campaign.distance_reference(side).offset_m
            _check_arena(campaign, side, column, recorded, z_m, here)
    return z_m


def _check_arena(
    campaign: Campaign,
    side: Boundary,
    column: TextColumn,
    recorded: FloatArray,
    z_m: FloatArray,
    here: IntArray,
) -> None:
    """Refuse distances beyond the arena or behind the boundary.

    A unit is proposed if it makes every distance to this boundary possible: within the arena, and
    at least a fiftieth of a radius away.
    """
    arena, r, unit = campaign.rig.arena, campaign.vehicle.rotor_radius, column.unit
    ends = here[[np.argmin(z_m[here]), np.argmax(z_m[here])]]
    (nearest, farthest), offset = ends.tolist(), campaign.distance_reference(side).offset_m
    remedy = "correct distance under [trials.units], or the schedule"
    far = f"{column.texts[farthest]} {unit} is"
    if arena is not None and z_m[farthest] > arena:
        other = _other_units(recorded[ends], r * LEAST_FARTHEST - offset, arena - offset, unit)
        what = f"{far} outside the {arena:g} m arena{other}"
        remedy = "correct distance under [trials.units], the schedule, or [rig] arena"
        raise column.refusal(farthest, what, remedy, InputRefused)
    if z_m[nearest] <= NEAREST * r:
        into = f"{-1e3 * z_m[nearest]:.3g} mm into the {side}"
        place = into if z_m[nearest] < 0 else f"on the {side} itself"
        near = f"{column.texts[nearest]} {unit} with an offset of {1e3 * offset:g} mm"
        remedy = "correct [rig] distance_datum and distance_offset, or the schedule"
        raise column.refusal(nearest, f"{near} puts the rotor {place}", remedy, InputRefused)
    if z_m[farthest] < r * LEAST_FARTHEST:
        what = f"{far} the farthest from the {side}, {z_m[farthest] / r:.2g} of a rotor's radius"
        what += _other_units(recorded[[farthest]], r, arena or 100 * r, unit)
        raise column.refusal(farthest, what, remedy, InputRefused)


def _other_units(values: Iterable[float], low: float, high: float, unit: str) -> str:
    """The units that bring all distances between `low` and `high`, m, as a question."""
    first, *others = (units.plausible(float(value), "length", low, high) for value in values)
    fitting = [u for u in first if u != unit and all(u in other for other in others)]
    return f"; {' or '.join(fitting)}?" if fitting else ""


def visits(
    boundary: NDArray[Any],
    z_m: FloatArray,
    approach: FloatArray | None = None,
    session: NDArray[Any] | None = None,
    *,
    ordered: bool = True,
) -> IntArray:
    """Counter of the traverse's stops, from 0: a new one where boundary, distance, side of approach
    or session change.

    Without an order of the rows, all rows that agree in these are one stop.
    """
    stated = [boundary.astype(str), z_m, *([] if session is None else [session])]
    if not ordered:
        stated += [] if approach is None else [approach]
        labels = [np.unique(column, return_inverse=True)[1] for column in stated]
        _, first, label = np.unique(labels, axis=1, return_index=True, return_inverse=True)
        # numbered as they come
        return np.argsort(np.argsort(first))[label].astype(np.int64)
    moved = np.any([column[1:] != column[:-1] for column in stated], axis=0)
    if approach is not None:
        # an unknown side is the one before
        moved |= np.abs(np.diff(approach)) > 0
    return np.concatenate([[0], np.cumsum(moved)]).astype(np.int64)[: len(boundary)]


def _backwards(column: TextColumn, start_s: FloatArray, session: NDArray[Any] | None) -> list[str]:
    """A note on trials of a session that began before the one above them."""
    known = np.flatnonzero(np.isfinite(start_s))
    earlier = np.diff(start_s[known]) < 0
    if session is not None:
        earlier &= session[known][1:] == session[known][:-1]
    if not earlier.any():
        return []
    row = int(known[1:][earlier][0])
    others = f", as do {earlier.sum() - 1} more" if earlier.sum() > 1 else ""
    what = f"{column.texts[row]} lies before the row above{others}"
    return [f"{column.place(row)}: {what}: rows must be in the order in which they were run"]
