"""Where outside formats meet nearlift: a reader is a frozen value that turns files into records.

A reader first *plans* (which trials stand in which files, and in which rows of them) without
reading samples, then reads one `Piece` of the plan at a time. Pieces are small values that can be
sent to another process, and no two of them share state: `stages.ingest` maps them over an executor.
A new format is one file with one `Reader` in it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np

from nearlift import units
from nearlift.declare import FloatArray
from nearlift.readers.channel import RecordsDialect

if TYPE_CHECKING:
    from nearlift.campaign.manifest import Campaign
    from nearlift.readers.per_file import Format

#: What stands for a trial's id in ``[records] files``.
MARK = "{trial}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Record:
    """The load-cell series of one trial.

    Attributes
    ----------
    trial : str
        Id, as in the schedule.
    force_N : (n,) float array
        Lift in N, up positive: sign and calibration applied, tare *not* removed. NaN where the file
        holds no number.
    time_s : (n,) float array or None
        The clock column, where the manifest names one.
    source : str
        File, relative to the campaign's folder.
    codes : tuple of str
        What the reader noticed (names in `reduction.quality.CODES`).
    notes : tuple of str
        Remarks for the user, without the file's name: alike ones of many records are told once.
    fault : str
        What is wrong with a MALFORMED record, in words.
    """

    trial: str
    force_N: FloatArray = field(default_factory=lambda: np.empty(0))
    source: str
    time_s: FloatArray | None = None
    codes: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    fault: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Piece:
    """What one task reads: some trials, their files, and (where a file holds many trials) their
    rows.

    `paths` has one entry per trial, or a single one for all; `rows` one (first, end) pair per
    trial, or none. `bytes` is what the task will read, so that a reader may choose its means.
    """

    trials: tuple[str, ...]
    paths: tuple[Path, ...]
    rows: tuple[tuple[int, int], ...] = ()
    bytes: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingPlan:
    """The pieces of a campaign, and notes on the files. Trials in no piece have no record."""

    pieces: tuple[Piece, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """One outside format.

    Attributes
    ----------
    name, title : str
        What ``[records] reader`` says, and one line for the catalogue.
    files : callable
        ``files(campaign, root, trials)``: every record file there is, checked to be a regular file
        under `root`. Staleness is judged by these.
    plan : callable
        ``plan(campaign, root, trials)``: the `ReadingPlan`; reads no samples.
    read_piece : callable
        ``read_piece(campaign, root, piece)``: the piece's records in the plan's order, one in
        memory at a time.
    series : bool
        False for a format without samples (`means`), which takes its lift from the schedule.
    format : Format or None
        Of a reader that was made by `per_file.reader_of`: how one file becomes channels, which
        `inspect` shows.
    """

    name: str
    title: str
    files: Callable[[Campaign, Path, Sequence[str]], list[Path]]
    plan: Callable[[Campaign, Path, Sequence[str]], ReadingPlan]
    read_piece: Callable[[Campaign, Path, Piece], Iterator[Record]]
    series: bool = True
    format: Format | None = None

    def read(self, campaign: Campaign, root: Path, trials: Sequence[str]) -> Iterator[Record]:
        """Every record of these trials, streamed, in the plan's order."""
        for piece in self.plan(campaign, root, trials).pieces:
            yield from self.read_piece(campaign, root, piece)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelSpec:
    """What the manifest says of a record's channels, in plain values that can be sent to another
    process.

    Lift in N is ``factor * (number - zero)``; the clock's numbers times `tick` are seconds. A rate,
    Hz, is what a file's own is held against.
    """

    column: str
    unit: str
    factor: float
    zero: float
    clock: str | None
    clock_unit: str
    tick: float
    rate_Hz: float | None
    dialect: RecordsDialect

    @classmethod
    def from_manifest(cls, campaign: Campaign) -> Self:
        """What a campaign's manifest says."""
        force, clock = campaign.records.force, campaign.records.time
        # by the manifest's own check
        assert force is not None
        factor, zero = force.linear()
        dialect = campaign.records.dialect
        return cls(
            column=force.column,
            unit=force.unit,
            factor=factor,
            zero=zero,
            clock=clock.column if clock else None,
            clock_unit=clock.unit if clock else "s",
            tick=units.to_si(clock.unit, "time", "records.time.unit")[0] if clock else 1.0,
            rate_Hz=None if dialect.get("ignore_rate") else campaign.load_cell.sample_rate,
            dialect=dict(dialect),
        )

    def of_trial(self, trial: str) -> tuple[str, str | None]:
        """Columns of force and clock of one trial, where the files carry its id in their names."""
        clock = None if self.clock is None else self.clock.replace(MARK, trial)
        return self.column.replace(MARK, trial), clock

    def lift_N(self, numbers: FloatArray) -> FloatArray:
        """Lift from the force channel's numbers, in an array of its own."""
        return self.factor * (numbers - self.zero if self.zero else numbers)
