"""What a file holds: its format, its channels, and which of them may be the force and its clock."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nearlift import readers
from nearlift.commands import grids, meaning, tables
from nearlift.commands.grids import Grid
from nearlift.commands.tables import Table
from nearlift.errors import InputRefused
from nearlift.readers import csv_trial, guarded
from nearlift.readers.channel import Channel, Contents, Malformed, RecordsDialect
from nearlift.readers.dialect import NoNames
from nearlift.readers.per_file import Format
from nearlift.readers.ramp import Ramp, ramp_of
from nearlift.readers.text import TEXT

HEAD = 1 << 16


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """One file's contents, the reader that reads it, and what may be the force and its clock;
    `columns` of a text that names none; `grid` where it is a velocity grid, `table` where it
    lists trials.
    """

    path: Path
    contents: Contents
    bytes: int
    reader: str = ""
    force: Channel | None = None
    clock: Channel | None = None
    columns: int = 0
    dialect: RecordsDialect = field(default_factory=dict)
    grid: Grid | None = None
    table: Table | None = None

    @functools.cached_property
    def ramp(self) -> Ramp | None:
        """What it is where it holds many lifts; None where it is one trial, or no record."""
        # where the rate cannot be meant, rows are means already
        if self.force is None or self.reader in ("", "parquet") or self.doubt:
            return None
        clocks = [c.name for c in self.contents.channels if meaning.is_clock(c.name)]
        return ramp_of(self.force, self.contents.channels, clocks, self.force.rate_Hz)

    @property
    def doubt(self) -> str:
        """Why the rate of the force cannot be meant; empty where it can, or is not known."""
        rate = None if self.force is None else self.force.rate_Hz
        return meaning.doubtful_rate(rate, self.clock) if rate else ""


def inspect(
    path: Path, dialect: RecordsDialect | None = None, *, record: bool = False
) -> Inspection:
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
        return Inspection(path=path, contents=grid.contents, bytes=length, grid=grid)
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
    return Inspection(
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
        contents = guarded.contents(form, path, form.checked_dialect(dialect), None)
    except Malformed as fault:
        raise InputRefused(str(path), str(fault), "copy it anew from the rig") from None
    if not contents.channels:
        raise InputRefused(
            str(path), "holds no channel of numbers", "it has a header and no samples, or only text"
        )
    return contents
