"""Records to rows: what a worker is sent, what it answers for each trial, and all the answers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from nearlift import readers
from nearlift.campaign.manifest import Campaign
from nearlift.errors import InputRefused, NearliftError
from nearlift.readers.base import Record
from nearlift.readers.files import Piece, source_of
from nearlift.reduction.conditions import Conditions
from nearlift.reduction.record import Reduced, reduce_record
from nearlift.run.tables import Table, sha256

#: Characters of a fault that are kept.
LONGEST_FAULT = 300
#: Columns that stand in a `Row` itself; the others stand in its reduction.
OF_THE_FILE = {"samples", "source_sha256", "source", "fault"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A worker's answer for one trial.

    `fault` says what is wrong with a MALFORMED record; `refusal` is there where it cannot be read
    in the way that the manifest asks for.
    """

    trial: str
    reduced: Reduced
    source_sha256: str = ""
    source: str = ""
    samples: int = 0
    notes: tuple[str, ...] = ()
    fault: str = ""
    refusal: InputRefused | None = None


def row_of(
    record: Record, conditions: Conditions, tare_after_N: float = math.nan, source_sha256: str = ""
) -> Row:
    """A record reduced; raises as `reduce_record` does."""
    reduced = reduce_record(
        record.force_N,
        conditions,
        time_s=record.time_s,
        tare_after_N=tare_after_N,
        codes=record.codes,
        where=f"{record.source}, trial {record.trial!r}",
    )
    return Row(
        trial=record.trial,
        reduced=reduced,
        source_sha256=source_sha256,
        source=record.source,
        samples=len(record.force_N),
        notes=record.notes,
        fault=record.fault,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Task of one worker: a piece of the plan, and the data to reduce it."""

    root: Path
    campaign: Campaign
    piece: Piece
    tare_after_N: Mapping[str, float]
    inputs: Mapping[str, str]


class Rows:
    """Rows of n trials in run order, as `columns` of trials.parquet, and the codes of each.

    A trial without an answer is MISSING. `further` are additional numbers of `Reduced`.
    """

    def __init__(self, n: int, further: tuple[str, ...] = ()) -> None:
        real = ("lift_N", "u_lift_N", "n_eff", "drift_N_s", "sd_N", *further)
        self.columns: Table = {
            **{name: np.full(n, np.nan) for name in real},
            **{name: np.zeros(n, dtype=np.int64) for name in ("n", "n_removed", "samples")},
            **{name: np.full(n, "", dtype=object) for name in ("source_sha256", "source", "fault")},
        }
        self.codes: list[tuple[str, ...]] = [("MISSING",)] * n
        #: Each remark with the number of records that it is about, and the first of them.
        self.notes: dict[str, tuple[int, str]] = {}

    def put(self, i: int, row: Row) -> None:
        """The answer for trial i."""
        for name, column in self.columns.items():
            column[i] = getattr(row if name in OF_THE_FILE else row.reduced, name)
        self.codes[i] = row.reduced.codes
        for note in row.notes:
            count, first = self.notes.get(note, (0, row.source))
            self.notes[note] = count + 1, first

    @classmethod
    def gathered(cls, answers: Sequence[Row], further: tuple[str, ...] = ()) -> Rows:
        """The answers of one worker, in order."""
        rows = cls(len(answers), further)
        for i, row in enumerate(answers):
            rows.put(i, row)
        return rows

    def put_all(self, at: int, rows: Rows) -> None:
        """The answers of one worker, from trial `at` on; those without a number stay without."""
        span = slice(at, at + len(rows.codes))
        for name in self.columns.keys() & rows.columns.keys():
            self.columns[name][span] = rows.columns[name]
        self.codes[span] = rows.codes
        for note, (more, place) in rows.notes.items():
            count, first = self.notes.get(note, (0, place))
            self.notes[note] = count + more, first

    def remarks(self) -> list[str]:
        """The remarks, each once."""
        return [
            note if count == 1 else f"{note} ({count} records, such as {first})"
            for note, (count, first) in self.notes.items()
        ]


def reduce_piece(task: Task) -> list[Row]:
    """Read and reduce the trials of one piece; runs in any thread or process.

    Whatever a record holds, its trial has a row: what is raised over one makes it MALFORMED, and
    the next is read.

    Raises
    ------
    NearliftError
        The manifest is at fault.
    OSError, MemoryError
        The machine is at fault.
    """
    piece, digests = task.piece, dict(task.inputs)
    rows: list[Row] = []
    while len(rows) < len(task.piece.trials):
        try:
            # damaged numbers may be anything
            with np.errstate(over="ignore", invalid="ignore"):
                for row in _rows(task, piece, digests):
                    rows.append(row)
            break
        except Exception as fault:
            if len(rows) == len(task.piece.trials) or not is_of_the_record(fault):
                raise
            rows.append(malformed(task, len(rows), fault, digests))
        piece = _behind(task.piece, len(rows))
    return rows


def conditions_of(campaign: Campaign) -> Conditions:
    """Conditions of every record of a campaign."""
    choice = campaign.quality
    return Conditions(
        rate_Hz=campaign.load_cell.sample_rate or 1.0,
        tare_s=campaign.tare_s,
        settle_s=campaign.load_cell.settle,
        drift=choice.drift,
        missing=choice.missing,
        out_of_range=choice.out_of_range,
        range_N=campaign.load_cell.range,
    )


def _rows(task: Task, piece: Piece, digests: dict[str, str]) -> Iterator[Row]:
    """The rows of a piece, by the process that reads it; `digests` grows by those of its files."""
    campaign, conditions = task.campaign, conditions_of(task.campaign)
    reader = readers.reader(campaign.records.reader)
    for record in reader.read_piece(campaign, task.root, piece):
        tare_after_N = task.tare_after_N.get(record.trial, np.nan)
        sha = digest_of(task, record.source, digests)
        yield row_of(record, conditions, tare_after_N, sha)


def digest_of(task: Task, source: str, digests: dict[str, str]) -> str:
    """The SHA-256 of a file of the campaign, which `digests` then has."""
    if source not in digests:
        digests[source] = sha256(task.root / source)
    return digests[source]


def malformed(task: Task, i: int, fault: Exception, digests: dict[str, str]) -> Row:
    """The row of trial i of a piece, over whose record `fault` was raised."""
    path = task.piece.paths[i if len(task.piece.paths) > 1 else 0]
    source = source_of(task.root, path)
    what = (
        f"{fault.where}: {fault.what}"
        if isinstance(fault, NearliftError)
        else f"{source}: {type(fault).__name__}: {fault}"
    )
    text = " ".join(what.replace(f"{task.root}/", "").split())[:LONGEST_FAULT]
    return Row(
        trial=task.piece.trials[i],
        reduced=Reduced(codes=("MALFORMED",)),
        source_sha256=digest_of(task, source, digests),
        source=source,
        fault="".join(c if c.isprintable() else "?" for c in text),
        refusal=fault if isinstance(fault, InputRefused) else None,
    )


def is_of_the_record(fault: Exception) -> bool:
    """Whether the bytes of a record are to blame, and not the manifest or the machine (libraries
    call damage an OSError without a number).
    """
    if isinstance(fault, OSError):
        return fault.errno is None
    return isinstance(fault, InputRefused) or not isinstance(fault, (NearliftError, MemoryError))


def _behind(piece: Piece, done: int) -> Piece:
    """Rest of a piece after so many of its trials."""
    return replace(
        piece,
        trials=piece.trials[done:],
        paths=piece.paths[done:] if len(piece.paths) == len(piece.trials) else piece.paths,
        rows=piece.rows[done:],
    )
