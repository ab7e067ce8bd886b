"""The contents of a file: its format, its channels, and which of them may be the force and its
clock.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nearlift import readers
from nearlift.errors import InputRefused
from nearlift.onboarding import headings, tables
from nearlift.onboarding.grids import Grid, grid_of
from nearlift.onboarding.tables import InputTable
from nearlift.readers import guarded
from nearlift.readers.base import Channel, Contents, Reader, RecordsDialect
from nearlift.readers.dialect import NoNames
from nearlift.readers.files import GZIP, content_of, head_of
from nearlift.readers.guarded import Malformed
from nearlift.readers.ramp import Ramp, ramp_of
from nearlift.readers.text import CSV, SHEET, TEXT
from nearlift.reduction.start import RotorStart, start_of
from nearlift.reduction.wrap import wrap_of

#: The first bytes of a DataFlash log: two that begin each message, and the type of its formats.
DATAFLASH = b"\xa3\x95\x80"
HEAD = 1 << 16
#: Covariates of a schedule that a channel of a record may be.
COVARIATES = ("supply", "current", "rpm", "power", "temperature", "pressure", "humidity")


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """One file's contents, the reader that reads it, and what may be the force and its clock.

    `columns` are the names given to the columns of a text that has none. A velocity grid has
    `grid`, a list of trials `table`.
    """

    path: Path
    contents: Contents
    bytes: int
    reader: str = ""
    force: Channel | None = None
    clock: Channel | None = None
    columns: tuple[str, ...] = ()
    dialect: RecordsDialect = field(default_factory=dict)
    grid: Grid | None = None
    table: InputTable | None = None

    @functools.cached_property
    def ramp(self) -> Ramp | None:
        """The sweep of a record of many lifts; None of one trial, or of no record."""
        # where the rate is doubtful, rows are means already
        if self.force is None or self.reader in ("", "parquet") or self.doubt or self.wraps:
            return None
        clocks = [c.name for c in self.contents.channels if headings.is_clock(c.name)]
        return ramp_of(self.force, self.contents.channels, clocks, self.force.rate_Hz)

    @property
    def doubt(self) -> str:
        """The reason why the rate of the force is doubtful; empty where it is not, or unknown."""
        rate = None if self.force is None else self.force.rate_Hz
        return headings.doubtful_rate(rate, self.clock) if rate else ""

    @functools.cached_property
    def wraps(self) -> float | None:
        """The jump of a force that may be a counter that wraps; None where there is none."""
        return None if self.force is None else wrap_of(self.force.values)

    @functools.cached_property
    def start(self) -> RotorStart | None:
        """The start of the rotors, in samples; None where it cannot be seen."""
        if self.force is None or not self.force.rate_Hz or self.ramp is not None:
            return None
        return start_of(self.force.values, self.force.rate_Hz)

    @functools.cached_property
    def further(self) -> Mapping[str, tuple[Channel, str]]:
        """Channels that are covariates of a schedule, with their unit, by its columns' names."""
        unused: dict[str, tuple[Channel, str]] = {}
        for c in self.contents.channels:
            stated = f"{headings.named(c.name)[0]} ({c.unit})" if c.unit else c.name
            name, unit = headings.schedule_column(stated)
            if name in COVARIATES and unit and np.isfinite(c.values).all() and name not in unused:
                unused[name] = c, unit
        return unused

    @property
    def means(self) -> Mapping[str, float]:
        """The mean of each of these channels, once the lift is steady."""
        n = 0 if self.force is None else len(self.force.values)
        first = 0 if self.start is None else self.start.steady_from
        return {
            name: float(np.mean(c.values[first:] if len(c.values) == n else c.values))
            for name, (c, _) in self.further.items()
        }


def inspect(
    path: Path, dialect: RecordsDialect | None = None, *, record: bool = False
) -> Inspection:
    """The contents of a file; `dialect` as ``[records] dialect`` takes it; `record`: it is no
    velocity grid.

    Raises
    ------
    InputRefused
        It is no regular file, is empty, damaged, or of no format known.
    ManifestError
        The dialect has a key that the file's format does not know.
    """
    said, length = dict(dialect or {}), _length(path)
    if not (said or record) and (grid := grid_of(path)) is not None:
        return Inspection(path=path, contents=grid.contents, bytes=length, grid=grid)
    head = head_of(path, HEAD)
    head = guarded.run(content_of, path, HEAD) if head.startswith(GZIP) else head
    if head.startswith(DATAFLASH):
        raise InputRefused(
            str(path),
            "is a DataFlash log (.BIN) of ArduPilot: a flight, and no record of a load cell",
            "name the file that the load cell's logger wrote",
        )
    form = recognised(head, path.name)
    contents, columns = _read(form, path, said)
    channels = [
        c if c.unit else replace(c, unit=headings.named(c.name)[1]) for c in contents.channels
    ]
    force = headings.likely_force(channels)
    clock = headings.likely_clock(channels, force)
    if all(c.rate_Hz is None for c in channels):
        rate = headings.clock_rate(clock)
        channels = [replace(c, rate_Hz=rate) for c in channels]
        force = None if force is None else replace(force, rate_Hz=rate)
    notes = (*contents.notes, *_shared_stamps(channels, clock))
    plain = form is TEXT and not (said or columns) and _plain_csv(path, force or channels[0], clock)
    table = tables.table_of(path, said) if form in (TEXT, SHEET) and not columns else None
    return Inspection(
        path=path,
        reader=CSV.name if plain else form.name,
        contents=replace(contents, channels=tuple(channels), notes=notes),
        force=force,
        clock=clock,
        bytes=length,
        columns=columns,
        dialect=said,
        table=table if table is not None and table.lists_trials else None,
    )


def _length(path: Path) -> int:
    """The length of a plain file with content, bytes; any other is refused."""
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
    return length


def recognised(head: bytes, name: str) -> Reader:
    """The reader of a file; that of text where no other claims it."""
    claims = (r for r in readers.readers() if r.recognises(head, name.casefold()))
    return next(claims, TEXT)


def _read(form: Reader, path: Path, said: RecordsDialect) -> tuple[Contents, tuple[str, ...]]:
    """The channels of a file, and the names given to columns without any."""
    try:
        return _contents(form, path, said), ()
    except NoNames as refusal:
        if (fault := tables.several(path, said)) is not None:
            raise fault from None
        # the file is read by the names that are proposed
        columns = tuple(f"column {i + 1}" for i in range(refusal.columns))
        return _contents(form, path, {**said, "columns": list(columns)}), columns
    except InputRefused as refusal:
        raise (tables.several(path, said) if form is TEXT else None) or refusal from None


def _contents(form: Reader, path: Path, dialect: RecordsDialect) -> Contents:
    try:
        contents = form.open(path, form.checked_dialect(dialect))
    except Malformed as fault:
        raise InputRefused(str(path), str(fault), "copy it again from the rig") from None
    if not contents.channels:
        raise InputRefused(
            str(path), "holds no channel of numbers", "it has a header and no samples, or only text"
        )
    return contents


def _plain_csv(path: Path, force: Channel, clock: Channel | None) -> bool:
    """Whether the stricter and faster reader of plain CSV reads the same numbers."""
    wanted = {c.name: c for c in (force, clock) if c is not None}
    try:
        channels = CSV.open(path, {}, tuple(wanted)).channels
    except InputRefused:
        return False
    return {c.name for c in channels} == set(wanted) and all(
        np.array_equal(c.values, wanted[c.name].values, equal_nan=True) for c in channels
    )


def rows_per_stamp(clock: Channel) -> int:
    """The number of rows that share each time of a clock; 1 where each has its own."""
    times = clock.values[np.isfinite(clock.values)]
    differs = np.flatnonzero(times != times[0]) if len(times) else times
    each = int(differs[0]) if len(differs) else 1
    if each < 2 or len(times) < 2 * each:
        return 1
    groups = times[: len(times) // each * each].reshape(-1, each)
    return each if (groups == groups[:, :1]).mean() > 0.9 else 1


def _shared_stamps(channels: Sequence[Channel], clock: Channel | None) -> list[str]:
    """A note on a clock with several rows to each stamp: rows of several sensors."""
    if clock is None or (rows := rows_per_stamp(clock)) < 2:
        return []
    same = [
        c.name
        for c in channels
        if c.name != clock.name
        and len(c.values) == len(clock.values)
        and len(set(c.values[: 4 * rows].tolist())) == rows
        and (c.values[rows:] == c.values[:-rows]).all()
    ]
    if not same and (clock.values % 1 == 0).all():
        step = clock.values[rows] - clock.values[rows - 1]
        note = f"{clock.name!r} has {rows} rows to each {step:g} {clock.unit}: it is too coarse for"
        return [f"{note} a clock of the samples; state their rate"]
    by = f"{same[0]!r} numbers them" if same else "no column numbers them"
    note = (
        f"each time of {clock.name!r} has {rows} rows: {rows} sensors in one file, and {by}; keep"
        " the rows of one sensor, as a file of its own"
    )
    return [note]
