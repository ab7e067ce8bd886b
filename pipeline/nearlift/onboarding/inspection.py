"""Contents of a file: its format, its channels, and which may be the force and its clock."""

from __future__ import annotations

import contextlib
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
from nearlift.readers import parquet
from nearlift.readers.base import SECONDS, Channel, Contents, Reader, RecordsDialect, rate_of
from nearlift.readers.dialect import NoNames
from nearlift.readers.files import GZIP, content_of, head_of
from nearlift.readers.guarded import Malformed
from nearlift.readers.sweep import levels_of
from nearlift.readers.text import CSV, SHEET, TEXT
from nearlift.reduction.start import RotorStart, start_of, wrap_of

#: First bytes of a DataFlash log: two that begin each message, and the type of its formats.
DATAFLASH = b"\xa3\x95\x80"
HEAD = 1 << 16
#: Columns without names that names are proposed for, and what they are called, with a number.
MOST_COLUMNS, UNNAMED = 64, "column"
#: Different codes of a converter that one record has at most.
MOST_CODES = 4
#: Share of a sweep's largest lift that its first level has at rest.
NEAR_ZERO = 0.3
#: Sample rates of load cells, Hz. A lower one is of means of steps, a higher one of another unit.
USUAL_RATES_HZ = (1.0, 2e6)
#: Covariates of a schedule that a channel of a record may be.
COVARIATES = ("supply", "current", "rpm", "power", "temperature", "pressure", "humidity")


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """Contents of one file, its reader, and the channels that may be the force and its clock.

    A velocity grid has `grid`, a list of trials `table`. The `dialect` names the columns of a text
    without a header. `rows_per_stamp` is the number of rows that share each time of the clock.
    `further` are channels that are covariates of a schedule, with their unit, by their names there.

    Of the force: `doubt` is the reason why its rate is doubtful, and `wraps` the jump of a counter
    that may have wrapped. `ramp` is given where the record has many lifts. `starts` (in samples)
    are those of the file's trials, None where one does not begin at rest. `sign` is that of the
    change from rest to lift, 0 where unknown.
    """

    path: Path
    contents: Contents
    reader: str = ""
    dialect: RecordsDialect = field(default_factory=dict)
    grid: Grid | None = None
    table: InputTable | None = None
    force: Channel | None = None
    clock: Channel | None = None
    rows_per_stamp: int = 1
    further: Mapping[str, tuple[Channel, str]] = field(default_factory=dict)
    doubt: str = ""
    wraps: float | None = None
    ramp: Ramp | None = None
    starts: tuple[RotorStart | None, ...] = ()
    sign: int = 0


def inspect(
    path: Path,
    dialect: RecordsDialect | None = None,
    *,
    record: bool = False,
    one_lift: bool = False,
) -> Inspection:
    """Inspect a file; `dialect` as ``[records] dialect`` takes it; `record`: it is no grid.

    `one_lift`: the throttle of the record is known, so that it is no sweep.

    Raises
    ------
    InputRefused
        It is no regular file, is empty, damaged, or of no format known.
    ManifestError
        The dialect has a key that the file's format does not know.
    """
    if not path.is_file():
        what = "is not a regular file" if path.exists() else "is missing"
        remedy = "name files; `nearlift new DIR --from FOLDER` takes them all"
        raise InputRefused(str(path), what, remedy)
    if not path.stat().st_size:
        raise InputRefused(str(path), "is empty", "was the disk full?")
    if not (dialect or record) and (grid := grid_of(path)) is not None:
        return Inspection(path=path, contents=grid.contents, grid=grid)
    reader, stated = _reader_of(path), dict(dialect or {})
    table = tables.table_of(path, stated) if reader in (TEXT, SHEET) else None
    table = table if table is not None and table.lists_trials else None
    is_means = table is not None and table.means
    if table is not None and is_means:
        contents = table.contents
    else:
        contents, stated = _read(reader, path, stated)
    channels = [_with_unit(c) for c in contents.channels]
    clock = _clock(channels, headings.force_channel(channels))
    if all(c.rate_Hz is None for c in channels) and clock and len(clock.values) > 2:
        tick = SECONDS.get(clock.unit)
        channels = [replace(c, rate_Hz=tick and rate_of(tick * clock.values)) for c in channels]
    force = headings.force_channel(channels)
    if reader is TEXT and not stated and contents.kind == "text":
        # plain CSV has a stricter reader
        reader = CSV
    inspected = Inspection(
        path=path,
        contents=replace(contents, channels=tuple(channels)),
        reader="means" if is_means else reader.name,
        dialect=stated,
        table=table,
        force=force,
        clock=clock,
        rows_per_stamp=1 if clock is None else _rows_per_stamp(clock.values),
        further=_covariates(channels),
    )
    if force is None or not np.isfinite(force.values).any():
        return inspected
    return _judged(inspected, force, one_lift)


# ---- reading


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
    if b"\\hline" in head or b"\\begin{tabular" in head:
        raise InputRefused(str(path), "is a table of LaTeX", "export it as CSV")
    name = path.name.casefold()
    return next((r for r in readers.readers() if r.recognises(head, name)), TEXT)


def _read(
    reader: Reader, path: Path, stated: dict[str, object]
) -> tuple[Contents, dict[str, object]]:
    """Channels of a file, and the dialect that reads it: it names columns that have no names."""
    try:
        try:
            contents = reader.open(path, reader.checked_dialect(stated))
        except NoNames as refusal:
            if refusal.columns > MOST_COLUMNS or tables.several(path, stated) is not None:
                raise
            # the file is read by the names that are proposed
            stated = {**stated, "columns": [f"{UNNAMED} {i + 1}" for i in range(refusal.columns)]}
            contents = reader.open(path, reader.checked_dialect(stated))
        if not contents.channels:
            what = "holds no channel of numbers"
            raise InputRefused(str(path), what, "it has a header and no samples, or only text")
    except Malformed as fault:
        raise InputRefused(str(path), str(fault), "copy it again from the rig") from None
    except InputRefused as refusal:
        if head_of(path, 1) in (b"{", b"[", b"<"):
            what = "is JSON, XML or bracketed lists, not a table"
            remedy = "write its numbers as CSV, for example by pandas: read_json(FILE).to_csv(NEW)"
            raise InputRefused(str(path), what, remedy) from None
        raise (tables.several(path, stated) if reader is TEXT else None) or refusal from None
    return contents, stated


# ---- channels


def _with_unit(channel: Channel) -> Channel:
    """The channel with the unit that its name, or a clock's size, states."""
    unit = headings.WORDS["units"].get(channel.unit, channel.unit)
    unit = unit or headings.named(channel.name)[1]
    if not unit and headings.is_clock(channel.name):
        unit = headings.stamp_unit(channel.values)
    return replace(channel, unit=unit)


def _clock(channels: list[Channel], force: Channel | None) -> Channel | None:
    """The channel that may be the clock of the force: of its group before others."""
    group = "" if force is None else force.name.rpartition(".")[0]
    clocks = [c for c in channels if c.unit in ("", *SECONDS) and headings.is_clock(c.name)]
    in_group = [c for c in clocks if c.name.rpartition(".")[0] == group]
    # times of day under another name
    others = [c for c in channels if c.unit == "s" and len(c.values) > 2]
    grow = [c for c in others if (np.diff(c.values) >= 0).all() and c.values[-1] > c.values[0]]
    return next(iter(in_group or clocks or grow), None)


def _rows_per_stamp(times: FloatArray) -> int:
    """Number of rows that share each time; 1 where each has its own."""
    # the last time may be cut
    rows = np.diff(np.flatnonzero(np.diff(times[np.isfinite(times)])), prepend=-1)
    return int(np.median(rows)) if len(rows) and np.mean(rows > 1) > 0.9 else 1


def _covariates(channels: list[Channel]) -> dict[str, tuple[Channel, str]]:
    """Channels that are covariates of a schedule, with their unit, by its columns' names."""
    covariates: dict[str, tuple[Channel, str]] = {}
    for c in channels:
        stated = f"{headings.named(c.name)[0]} ({c.unit})" if c.unit else c.name
        name, unit = headings.schedule_column(stated)
        if name in COVARIATES and unit and np.isfinite(c.values).all():
            covariates.setdefault(name, (c, unit))
    return covariates


# ---- the force


def _judged(inspected: Inspection, force: Channel, one_lift: bool) -> Inspection:
    """The inspection with all that the samples of the force show."""
    rate_Hz, doubt, ramp, sign = force.rate_Hz, "", None, 0
    if rate_Hz and not USUAL_RATES_HZ[0] <= rate_Hz <= USUAL_RATES_HZ[1]:
        doubt = f"the file says {rate_Hz:.6g} Hz, which no load cell has: its clock is in another"
        doubt += " unit, or these are means of steps"
    parts, is_long = [force.values], inspected.reader == parquet.READER.name
    # a table without trials is shown, too
    with contextlib.suppress(InputRefused):
        trials = parquet.trials(inspected.path).values() if is_long else ()
        parts = [force.values[first:end] for first, end in trials] or parts
    wraps = next(filter(None, map(wrap_of, parts)), None)
    # where the rate is doubtful, rows are means already
    if not (one_lift or doubt or wraps or is_long):
        ramp = ramp_of(force, inspected.contents.channels)
    parts = [_without_codes(part) for part in parts]
    # the rate decides when the start is, and not its way
    starts = () if ramp else tuple(start_of(part, rate_Hz or 1.0) for part in parts)
    for start, part in zip(starts, parts, strict=False):
        if start is not None:
            lift = np.median(levels_of(part[start.steady_from :]))
            sign = 1 if lift > np.nanmedian(part[: start.rest_ends]) else -1
            break
    if ramp is not None:
        # a sweep that does not begin near zero shows no rest
        levels = levels_of(parts[0])
        largest = levels[np.abs(levels).argmax()]
        sign = int(np.sign(largest)) if abs(levels[0]) < NEAR_ZERO * abs(largest) else 0
    return replace(
        inspected,
        doubt=doubt,
        wraps=wraps,
        ramp=ramp,
        starts=starts if rate_Hz else (),
        sign=0 if wraps else sign,
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
    return np.interp(at, at[kept], force[kept])
