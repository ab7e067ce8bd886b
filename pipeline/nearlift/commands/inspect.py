"""What a file holds: format, channels with unit, rate, range and a sparkline, and the tables of a
manifest for it: those of a record, of a velocity grid, of a table of means.
"""

from __future__ import annotations

import functools
import json
from dataclasses import dataclass, field, replace
from pathlib import Path

import click
import numpy as np

from nearlift import readers
from nearlift.commands import flight_logs, grids, meaning, tables
from nearlift.commands.common import DIALECT, Call, declared, dialect_of
from nearlift.commands.grids import Grid
from nearlift.commands.sparkline import sparkline
from nearlift.commands.tables import Table
from nearlift.errors import InputRefused
from nearlift.readers import child, csv_trial
from nearlift.readers.channel import (
    AS_FORCE,
    FORCE_UNITS,
    Channel,
    Contents,
    Malformed,
    RecordsDialect,
)
from nearlift.readers.dialect import NoNames
from nearlift.readers.per_file import Format
from nearlift.readers.ramp import Ramp, ramp_of
from nearlift.readers.text import TEXT
from nearlift.run.lock import size

HEAD = 1 << 16
#: What to do with a record of many lifts.
CUT = (
    "[segments] cuts it, and a row of trials.csv is then a record (`nearlift segments CAMPAIGN`"
    " draws the cuts before anything is fitted)"
)
#: [records] of a table of means.
MEANS = '[records]\nreader = "means"                     # mean lifts in the schedule, no samples\n'


@dataclass(frozen=True, kw_only=True)
class Found:
    """One file's contents, the reader that reads it, and what may be the force and its clock;
    `columns` of a text that names none; `grid` where it is a velocity grid, `table` where it
    lists trials.
    """

    path: Path
    reader: str
    contents: Contents
    force: Channel | None
    clock: Channel | None
    bytes: int
    columns: int = 0
    dialect: RecordsDialect = field(default_factory=dict)
    grid: Grid | None = None
    table: Table | None = None

    @functools.cached_property
    def flight(self) -> flight_logs.Channels | None:
        """Its channels by what they are, where it is the log of a flight."""
        return flight_logs.channels_of(self.contents)

    @functools.cached_property
    def ramp(self) -> Ramp | None:
        """What it is where it holds many lifts; None where it is one trial, or no record."""
        # where the rate cannot be meant, rows are means already
        if self.force is None or self.reader in ("", "parquet") or self.doubt or self.flight:
            return None
        clocks = [c.name for c in self.contents.channels if meaning.is_clock(c.name)]
        return ramp_of(self.force, self.contents.channels, clocks, self.force.rate_Hz)

    @property
    def doubt(self) -> str:
        """Why the rate of the force cannot be meant; empty where it can, or is not known."""
        rate = None if self.force is None else self.force.rate_Hz
        return meaning.doubtful_rate(rate, self.clock) if rate else ""


def inspect(path: Path, dialect: RecordsDialect | None = None, *, record: bool = False) -> Found:
    """What a file holds; `dialect` as ``[records] dialect`` takes it; `record`: it is no velocity
    grid.

    Raises
    ------
    InputRefused
        It is no regular file, is empty, damaged, or of no format known.
    ManifestError
        The dialect has a key that the file's format does not know.
    """
    said = dict(dialect or {})
    if not path.exists():
        raise InputRefused(str(path), "is missing", "name a file that an instrument wrote")
    if not path.is_file():
        raise InputRefused(
            str(path),
            "is not a regular file",
            "name a file in it; `nearlift new DIR --from FOLDER` takes them all"
            if path.is_dir()
            else "a record is a plain file, no folder, pipe or device",
        )
    length = path.stat().st_size
    if length == 0:
        raise InputRefused(str(path), "is empty", "it was never written, or the disk was full")
    with path.open("rb") as file:
        head = file.read(HEAD)
    if not (said or record) and (grid := grids.grid_of(path)) is not None:
        return Found(
            path=path,
            reader="",
            contents=grid.contents,
            force=None,
            clock=None,
            bytes=length,
            grid=grid,
        )
    columns = 0
    form = recognised(head, path.name)
    try:
        contents = _contents(form, path, said)
    except NoNames as refusal:
        # numbers without names: shown under names that say so
        columns = refusal.columns
        contents = _contents(
            form, path, {**said, "columns": [f"column {i + 1}" for i in range(columns)]}
        )
    channels = tuple(
        c if c.unit else replace(c, unit=meaning.named(c.name)[1]) for c in contents.channels
    )
    force = meaning.likely_force(channels)
    clock = meaning.likely_clock(channels, force)
    if all(c.rate_Hz is None for c in channels):
        rate = meaning.clock_rate(clock)
        channels = tuple(replace(c, rate_Hz=rate) for c in channels)
        force = None if force is None else next(c for c in channels if c.name == force.name)
    contents = replace(contents, channels=channels)
    reader = (
        csv_trial.READER.name
        if form is TEXT and not said and _plain_csv(path, force or channels[0], clock)
        else form.name
    )
    table = tables.table_of(path, said) if form is TEXT and not columns else None
    return Found(
        path=path,
        reader=reader,
        contents=contents,
        force=force,
        clock=clock,
        bytes=length,
        columns=columns,
        dialect=said,
        table=table if table is not None and table.lists_trials else None,
    )


def _plain_csv(path: Path, force: Channel, clock: Channel | None) -> bool:
    """Whether the stricter and faster reader of plain CSV reads the same numbers."""
    try:
        values, times, _ = csv_trial.parse(
            path.read_bytes(), str(path), force.name, clock.name if clock else None
        )
    except InputRefused:
        return False
    return np.array_equal(values, force.values, equal_nan=True) and (
        clock is None or (times is not None and np.array_equal(times, clock.values, equal_nan=True))
    )


def recognised(head: bytes, name: str) -> Format:
    """The format of a file; text where no other claims it."""
    for reader in readers.readers():
        if reader.format is not None and reader.format.recognises(head, name.casefold()):
            return reader.format
    return TEXT


def _contents(form: Format, path: Path, dialect: RecordsDialect) -> Contents:
    try:
        with child.source(form) as read:
            contents = read(path, form.checked_dialect(dialect), None)
    except Malformed as fault:
        raise InputRefused(str(path), str(fault), "copy it anew from the rig") from None
    if not contents.channels:
        raise InputRefused(
            str(path), "holds no channel of numbers", "it has a header and no samples, or only text"
        )
    return contents


def described(inspected: Found) -> str:
    """The whole answer as text."""
    lines = [f"{inspected.path}: {inspected.contents.kind}, {size(inspected.bytes)}"]
    rows = [("channel", "unit", "samples", "rate, Hz", "lowest", "highest", "")]
    for c in inspected.contents.channels:
        known = c.values[np.isfinite(c.values)]
        low, high = (f"{known.min():.6g}", f"{known.max():.6g}") if len(known) else ("-", "-")
        rows.append(
            (
                c.name,
                c.unit or "-",
                str(len(c.values)),
                f"{c.rate_Hz:.6g}" if c.rate_Hz else "-",
                low,
                high,
                sparkline(c.values),
            )
        )
    widths = [max(len(row[i]) for row in rows) for i in range(6)]
    lines += [
        "  "
        + "  ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=False))
        + "  "
        + row[6]
        for row in rows
    ]
    lines += [f"note: {note}" for note in inspected.contents.notes]
    for c in inspected.contents.channels:
        lost = int(np.count_nonzero(~np.isfinite(c.values)))
        if 0 < lost < len(c.values):
            lines.append(
                f"note: {lost} of {len(c.values)} samples of {c.name!r} hold no number (blank, NaN,"
                " OVER, #NV or the like)"
            )
    if "truncated" in inspected.contents.codes:
        lines.append(
            "note: the file ends within a line or a segment: it is cut off, or still being written"
        )
    if "dead_speed" in inspected.contents.codes:
        lines.append("note: a rotor's speed reads zero while there is lift")
    if inspected.doubt:
        lines.append(f"note: {inspected.doubt}")
    if inspected.flight is not None:
        lines.append("note: it is the log of a flight: [flight] cuts it into trials")
    if inspected.ramp is not None:
        lines.append(f"note: the record {inspected.ramp.words}; {CUT}")
    return "\n".join(line.rstrip() for line in lines) + "\n\n" + block(inspected)


def block(inspected: Found) -> str:
    """The tables of a manifest for the file."""
    if inspected.grid is not None:
        return grids.piv_block(inspected.grid, inspected.path)
    if inspected.table is not None:
        return trials_block(inspected.table)
    if inspected.flight is not None:
        records = flight_records(inspected, f"{{record}}{inspected.path.suffix}")
        flight = flight_logs.flight_block(inspected.flight, inspected.contents)
        return f"{records}{flight_logs.RIG}\n{flight}"
    return records_block(inspected)


def flight_records(inspected: Found, files: str) -> str:
    """The [records] table of flight logs."""
    lines = ["[records]", f'reader = "{inspected.reader}"', f"files  = {json.dumps(files)}"]
    if inspected.clock is not None and not inspected.clock.name.endswith(".time"):
        column = json.dumps(inspected.clock.name, ensure_ascii=False)
        lines.append(
            f'time   = {{ column = {column}, unit = "{inspected.clock.unit or "FILL IN"}" }}'
        )
    return "\n".join(lines) + "\n\n"


def trials_block(table: Table) -> str:
    """[trials] of a table of trials, [records] where it holds their mean lifts, and how its columns
    are to be called.
    """
    _, section = table.schedule(table.row_ids(), means=table.means)
    other = [
        f"{table.names[place]} -> {name}"
        for name, (place, _) in table.meant.items()
        if table.names[place] != name
    ]
    what = "FILE" if table.means else "RECORDS FILE"
    how = f"# `nearlift new DIR --from {what}` makes trials.csv of it ({', '.join(other)})\n"
    return f"{MEANS if table.means else ''}\n{how if other else ''}{section}".lstrip()


def records_block(inspected: Found, files: str | None = None) -> str:
    """The [load_cell] and [records] tables of a manifest, with what cannot be known
    marked FILL IN.
    """
    pattern = (
        files
        if files is not None
        else inspected.path.name
        if inspected.reader == "parquet"
        else f"{{{'trial' if inspected.ramp is None else 'record'}}}{inspected.path.suffix}"
    )
    rates = {
        c.rate_Hz
        for c in ([inspected.force] if inspected.force is not None else inspected.contents.channels)
    }
    rate = rates.pop() if len(rates) == 1 else None
    why = "the file does not say" if rates <= {None} else "that of the force: the channels differ"
    doubt = inspected.doubt
    lines = [
        "[load_cell]",
        (
            f'sample_rate = "{rate:.6g} Hz"'
            if rate and not doubt
            else f'sample_rate = "FILL IN Hz"           # {doubt or why}'
        ),
    ]
    lines += [
        (
            'tare        = "FILL IN s"            # rotors-stopped head of every record; "0 s":'
            ' already tared; "none": nobody knows'
        ),
        "",
    ]
    lines += [
        "[records]",
        f'reader = "{inspected.reader}"',
        f"files  = {json.dumps(pattern, ensure_ascii=False)}",
    ]
    if inspected.force is None:
        names = ", ".join(c.name for c in inspected.contents.channels[:8])
        lines.append(
            f'force  = {{ column = "FILL IN", unit = "FILL IN", sign = 1 }}   # one of: {names}'
        )
    else:
        unit = AS_FORCE.get(inspected.force.unit, inspected.force.unit)
        column = json.dumps(inspected.force.name, ensure_ascii=False)
        if unit == "count":
            lines.append(
                f'force  = {{ column = {column}, unit = "count", sign = 1, calibration = {{ gain ='
                ' "FILL IN mN/count", offset = "FILL IN count" } }'
            )
        else:
            remarks = [] if unit in FORCE_UNITS else ["the file does not say the unit"]
            known = inspected.force.values[np.isfinite(inspected.force.values)]
            if len(known) and -float(known.min()) > 3 * abs(float(known.max())):
                remarks.append("sign = -1 if lift makes these numbers negative")
            remark = "   # " + "; ".join(remarks) if remarks else ""
            lines.append(
                f"force  = {{ column = {column}, unit ="
                f' "{unit if unit in FORCE_UNITS else "FILL IN"}", sign = 1 }}{remark}'
            )
    named = {"columns": [c.name for c in inspected.contents.channels]} if inspected.columns else {}
    if dialect := {**inspected.dialect, **named}:
        # texts, whole numbers, booleans and lists of texts are the same in JSON
        items = ", ".join(
            f"{key} = {json.dumps(value, ensure_ascii=False)}" for key, value in dialect.items()
        )
        lines.append(
            f"dialect = {{ {items} }}"
            + ("   # the file names none: FILL IN what they are" if named else "")
        )
    if inspected.clock is not None and inspected.clock is not inspected.force and not doubt:
        # a clock whose unit cannot be right is left out
        seconds = (
            None if inspected.clock.unit else meaning.clock_rate(replace(inspected.clock, unit="s"))
        )
        lines.append(
            f"time   = {{ column = {json.dumps(inspected.clock.name, ensure_ascii=False)}, unit ="
            f' "{inspected.clock.unit or "FILL IN"}" }}'
            + (f"   # in s the rate is {seconds:.6g} Hz" if seconds else "")
        )
    cut = "" if inspected.ramp is None or files is not None else f"\n{inspected.ramp.segments}"
    return "\n".join(lines) + "\n" + cut


def as_json(inspected: Found) -> dict[str, object]:
    """The same for machines."""
    return {
        "file": str(inspected.path),
        "reader": inspected.reader,
        "kind": inspected.contents.kind,
        "bytes": inspected.bytes,
        "codes": list(inspected.contents.codes),
        "notes": list(inspected.contents.notes),
        "channels": [
            {
                "name": c.name,
                "unit": c.unit,
                "samples": len(c.values),
                "rate_Hz": c.rate_Hz,
                "lowest": float(np.nanmin(c.values)) if np.isfinite(c.values).any() else None,
                "highest": float(np.nanmax(c.values)) if np.isfinite(c.values).any() else None,
            }
            for c in inspected.contents.channels
        ],
        "force": inspected.force.name if inspected.force else None,
        "sweep": None if inspected.ramp is None else inspected.ramp.words,
        "piv": None if inspected.grid is None else inspected.grid.format,
        "means": inspected.table is not None and inspected.table.means,
        "records": block(inspected),
    }


@declared("inspect")
@click.argument("file", type=click.Path(path_type=Path))
@DIALECT
def command(call: Call, file: Path, dialect: str) -> None:
    """Channels, sparklines and the block to paste."""
    inspected = inspect(file, dialect_of(dialect))
    call.answer(as_json(inspected), described(inspected))
