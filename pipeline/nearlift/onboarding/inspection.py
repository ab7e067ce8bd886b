"""Contents of a file: its format, its channels, and which may be the force and its clock."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nearlift import readers
from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.onboarding import headings, tables
from nearlift.onboarding.grids import Grid, grid_of
from nearlift.onboarding.ramp import Ramp, ramp_of
from nearlift.onboarding.tables import InputTable
from nearlift.readers.base import Channel, Contents, Reader, RecordsDialect
from nearlift.readers.dialect import NoNames
from nearlift.readers.files import GZIP, content_of, head_of
from nearlift.readers.guarded import Malformed
from nearlift.readers.sweep import levels_of
from nearlift.readers.text import CSV, SHEET, TEXT
from nearlift.reduction.start import RotorStart, start_of, wrap_of

#: First bytes of a DataFlash log: two that begin each message, and the type of its formats.
DATAFLASH = b"\xa3\x95\x80"
HEAD = 1 << 16
#: Columns without names that names are proposed for.
MOST_COLUMNS = 64
#: Different codes of a converter that one record has at most.
MOST_CODES = 4
#: Share of a sweep's largest lift that its first level has at rest.
NEAR_ZERO = 0.3
FOLDERS = "name files; `nearlift new DIR --from FOLDER` takes them all"
#: Covariates of a schedule that a channel of a record may be.
COVARIATES = ("supply", "current", "rpm", "power", "temperature", "pressure", "humidity")


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """Contents of one file, its reader, and the channels that may be the force and its clock.

    `unnamed` marks a text without a header, whose columns the `dialect` names. A velocity grid has
    `grid`, a list of trials `table`. `one_lift`: the throttle of the record is known.
    """

    path: Path
    contents: Contents
    reader: str = ""
    force: Channel | None = None
    clock: Channel | None = None
    dialect: RecordsDialect = field(default_factory=dict)
    unnamed: bool = False
    grid: Grid | None = None
    table: InputTable | None = None
    one_lift: bool = False

    @property
    def doubt(self) -> str:
        """Reason why the rate of the force is doubtful; empty where it is not, or is unknown."""
        rate = None if self.force is None else self.force.rate_Hz
        return headings.doubtful_rate(rate) if rate else ""

    @functools.cached_property
    def wraps(self) -> float | None:
        """Jump of a force that may be a counter that wraps; None where there is none."""
        return None if self.force is None else wrap_of(self.force.values)

    @functools.cached_property
    def ramp(self) -> Ramp | None:
        """Sweep of a record of many lifts; None of one trial, or of no record."""
        # where the rate is doubtful, rows are means already
        if self.force is None or self.reader in ("", "parquet") or self.doubt or self.wraps:
            return None
        if self.one_lift:
            return None
        clocks = [c.name for c in self.contents.channels if headings.is_clock(c.name)]
        return ramp_of(self.force, self.contents.channels, clocks, self.force.rate_Hz)

    @functools.cached_property
    def start(self) -> RotorStart | None:
        """Start of the rotors, in samples; None where it is not detectable."""
        if self.force is None or not self.force.rate_Hz or self.ramp is not None:
            return None
        return start_of(_without_codes(self.force.values), self.force.rate_Hz)

    @property
    def sign(self) -> int:
        """Sign of the change from rest to lift, 1 or -1; 0 where no rest is detectable."""
        if self.force is None or self.wraps:
            return 0
        force = _without_codes(self.force.values)
        # the rate decides when the start is, and not its way
        start = None if self.ramp else start_of(force, self.force.rate_Hz or 1.0)
        levels = levels_of(force if start is None else force[start.steady_from :])
        if start is not None:
            return 1 if np.median(levels) > np.nanmedian(force[: start.rest_ends]) else -1
        # a sweep that does not begin near zero shows no rest
        lift = levels[np.abs(levels).argmax()] if self.ramp else 0.0
        return int(np.sign(lift)) if abs(levels[0]) < NEAR_ZERO * abs(lift) else 0

    @functools.cached_property
    def further(self) -> Mapping[str, tuple[Channel, str]]:
        """Channels that are covariates of a schedule, with their unit, by its columns' names."""
        covariates: dict[str, tuple[Channel, str]] = {}
        for c in self.contents.channels:
            stated = f"{headings.named(c.name)[0]} ({c.unit})" if c.unit else c.name
            name, unit = headings.schedule_column(stated)
            if name in COVARIATES and unit and np.isfinite(c.values).all():
                covariates.setdefault(name, (c, unit))
        return covariates

    @property
    def means(self) -> Mapping[str, float]:
        """Mean of each of these channels, once the lift is steady."""
        n = 0 if self.force is None else len(self.force.values)
        first = 0 if self.start is None else self.start.steady_from
        return {
            name: float(np.mean(c.values[first if len(c.values) == n else 0 :]))
            for name, (c, _) in self.further.items()
        }

    @property
    def rows_per_stamp(self) -> int:
        """Number of rows that share each time of the clock; 1 where each has its own."""
        times = np.empty(0) if self.clock is None else self.clock.values
        # the last time may be cut
        rows = np.diff(np.flatnonzero(np.diff(times[np.isfinite(times)])), prepend=-1)
        return int(np.median(rows)) if len(rows) and np.mean(rows > 1) > 0.9 else 1

    @property
    def shared_stamps(self) -> str:
        """Remark on a clock with several rows to each stamp; empty where each has its own."""
        rows = self.rows_per_stamp
        if self.clock is None or rows < 2:
            return ""
        return (
            f"each time of {self.clock.name!r} has {rows} rows: several sensors in one file, of"
            " which keep one as a file of its own; or the clock is too coarse: state the rate"
        )


def inspect(
    path: Path, dialect: RecordsDialect | None = None, *, record: bool = False
) -> Inspection:
    """Inspect a file; `dialect` as ``[records] dialect`` takes it; `record`: it is no grid.

    Raises
    ------
    InputRefused
        It is no regular file, is empty, damaged, or of no format known.
    ManifestError
        The dialect has a key that the file's format does not know.
    """
    for wrong, what, remedy in (
        (not path.exists(), "is missing", "name a file that an instrument wrote"),
        (not path.is_file(), "is not a regular file", FOLDERS),
        (path.is_file() and not path.stat().st_size, "is empty", "was the disk full?"),
    ):
        if wrong:
            raise InputRefused(str(path), what, remedy)
    if not (dialect or record) and (grid := grid_of(path)) is not None:
        return Inspection(path=path, contents=grid.contents, grid=grid)
    reader = _reader_of(path)
    contents, stated, unnamed = _read(reader, path, dict(dialect or {}))
    channels = [_with_unit(c) for c in contents.channels]
    clock = headings.likely_clock(channels, headings.force_channel(channels))
    if all(c.rate_Hz is None for c in channels):
        channels = [replace(c, rate_Hz=headings.clock_rate(clock)) for c in channels]
    force = headings.force_channel(channels)
    table = tables.table_of(path, stated) if reader in (TEXT, SHEET) and not unnamed else None
    if reader is TEXT and not stated and _plain_csv(path, force or channels[0], clock):
        reader = CSV
    return Inspection(
        path=path,
        reader=reader.name,
        contents=replace(contents, channels=tuple(channels)),
        force=force,
        clock=clock,
        dialect=stated,
        unnamed=unnamed,
        table=table if table is not None and table.lists_trials else None,
    )


def _without_codes(force: FloatArray) -> FloatArray:
    """The force (n,) with a straight line in place of a converter's error codes.

    A code is an extreme farther from all other readings than these are from each other. Extremes
    at either end of the record stay.
    """
    at, kept, ends = np.arange(len(force)), np.isfinite(force), {*force[:5], *force[-5:]}
    for _ in range(MOST_CODES):
        values = np.unique(force[kept])
        if len(values) < 3:
            break
        gaps = np.diff(values)[[0, -1]]
        extreme = values[0] if gaps[0] > gaps[1] else values[-1]
        if gaps.max() < 0.5 * (values[-1] - values[0]) or extreme in ends:
            break
        kept &= force != extreme
    return np.interp(at, at[kept], force[kept]) if kept.any() else force


def _with_unit(channel: Channel) -> Channel:
    """The channel with the unit that its name, or a clock's size, states."""
    unit = headings.WORDS["units"].get(channel.unit, channel.unit)
    unit = unit or headings.named(channel.name)[1]
    if not unit and headings.is_clock(channel.name):
        unit = headings.stamp_unit(channel)
    return replace(channel, unit=unit)


def _reader_of(path: Path) -> Reader:
    """Reader that claims a file; that of text where no other does."""
    head = head_of(path, HEAD)
    if head.startswith(GZIP):
        head = content_of(path, HEAD)
    if head.startswith(DATAFLASH):
        raise InputRefused(
            str(path),
            "is a DataFlash log (.BIN) of ArduPilot: a flight, and no record of a load cell",
            "name the file that the load cell's logger wrote",
        )
    name = path.name.casefold()
    return next((r for r in readers.readers() if r.recognises(head, name)), TEXT)


def _read(
    reader: Reader, path: Path, stated: dict[str, object]
) -> tuple[Contents, dict[str, object], bool]:
    """Channels of a file, the dialect that reads it, and whether its columns had no names."""
    unnamed = False
    try:
        try:
            contents = reader.open(path, reader.checked_dialect(stated))
        except NoNames as refusal:
            if refusal.columns > MOST_COLUMNS or tables.several(path, stated) is not None:
                raise
            # the file is read by the names that are proposed
            unnamed = True
            stated = {**stated, "columns": [f"column {i + 1}" for i in range(refusal.columns)]}
            contents = reader.open(path, reader.checked_dialect(stated))
    except Malformed as fault:
        raise InputRefused(str(path), str(fault), "copy it again from the rig") from None
    except InputRefused as refusal:
        several = tables.several(path, stated) if reader is TEXT else None
        raise _bracketed(path) or several or refusal from None
    if not contents.channels:
        what, remedy = "holds no channel of numbers", "it has a header and no samples, or only text"
        raise _bracketed(path) or InputRefused(str(path), what, remedy)
    return contents, stated, unnamed


def _bracketed(path: Path) -> InputRefused | None:
    """Refusal of a file that begins with a bracket; None of any other."""
    if head_of(path, 1) not in (b"{", b"[", b"<"):
        return None
    remedy = "write its numbers as CSV, for example by pandas: read_json(FILE).to_csv(NEW)"
    return InputRefused(str(path), "is JSON, XML or bracketed lists, not a table", remedy)


def _plain_csv(path: Path, force: Channel, clock: Channel | None) -> bool:
    """Whether the stricter and faster reader of plain CSV reads the same numbers."""
    wanted = {c.name: c.values for c in (force, clock) if c is not None}
    try:
        read = {c.name: c.values for c in CSV.open(path, {}, tuple(wanted)).channels}
    except InputRefused:
        return False
    return read.keys() == wanted.keys() and all(
        np.array_equal(read[name], wanted[name], equal_nan=True) for name in wanted
    )
