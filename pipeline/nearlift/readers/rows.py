"""Records to rows: the task of one worker, its answer for each trial or each record that is cut,
and the rows of all trials.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import readers
from nearlift.campaign.manifest import Campaign
from nearlift.errors import InputRefused, NearliftError
from nearlift.readers import segments
from nearlift.readers.base import Record
from nearlift.readers.files import Piece, source_of
from nearlift.readers.segments import CutPiece, Segmented
from nearlift.reduction.conditions import Conditions
from nearlift.reduction.record import Reduced, reduce_record

#: Characters of a fault that are kept.
LONGEST_FAULT = 300
#: Columns that are fields of `Row`; the others are fields of its reduction.
OF_THE_FILE = {"samples", "source_sha256", "source", "fault"}
#: Further numbers of the pieces of a record.
OF_PIECES = ("u_zero_N",)


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
        self.columns: dict[str, NDArray[Any]] = {
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
            if len(rows) == len(task.piece.trials) or not _is_of_the_record(fault):
                raise
            rows.append(_malformed(task, len(rows), fault, digests))
        piece = _behind(task.piece, len(rows))
    return rows


def _conditions(campaign: Campaign) -> Conditions:
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
    campaign, conditions = task.campaign, _conditions(task.campaign)
    reader = readers.reader(campaign.records.reader)
    for record in reader.read_piece(campaign, task.root, piece):
        reduced = reduce_record(
            record.force_N,
            conditions,
            time_s=record.time_s,
            tare_after_N=task.tare_after_N.get(record.trial, np.nan),
            codes=record.codes,
            where=f"{record.source}, trial {record.trial!r}",
        )
        yield _row(task, record, record.trial, reduced, digests)


def _row(task: Task, record: Record, trial: str, reduced: Reduced, digests: dict[str, str]) -> Row:
    """The answer for a trial that is a whole record."""
    return Row(
        trial=trial,
        reduced=reduced,
        source_sha256=digest_of(task.root, record.source, digests),
        source=record.source,
        samples=len(record.force_N),
        notes=record.notes,
        fault=record.fault,
    )


def digest_of(root: Path, source: str, digests: dict[str, str]) -> str:
    """The SHA-256 of a file of the campaign, which `digests` then has."""
    if source not in digests:
        with (root / source).open("rb") as file:
            digests[source] = hashlib.file_digest(file, "sha256").hexdigest()
    return digests[source]


def _malformed(task: Task, i: int, fault: Exception, digests: dict[str, str]) -> Row:
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
        source_sha256=digest_of(task.root, source, digests),
        source=source,
        fault="".join(c if c.isprintable() else "?" for c in text),
        refusal=fault if isinstance(fault, InputRefused) else None,
    )


def _is_of_the_record(fault: Exception) -> bool:
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


# ---- records that are cut


@dataclass(frozen=True, slots=True, kw_only=True)
class CutRecord:
    """Answer of one worker for one record: a row for each piece, or one where there is none.

    It also has the counts, and why the record cannot be read as the manifest asks.
    """

    record: str
    rows: Rows
    pieces: tuple[CutPiece, ...] = ()
    counts: Counter[str] = field(default_factory=Counter)
    refusal: InputRefused | None = None


def cut_piece(task: Task) -> list[CutRecord]:
    """The answer for each record of a task; a MALFORMED row where something is raised over it.

    Runs in any thread or process, and raises as `reduce_piece`.
    """
    answers, digests = list[CutRecord](), dict(task.inputs)
    for i, record in enumerate(task.piece.trials):
        try:
            answers.append(_answer(task, i, digests))
        except Exception as fault:
            if not _is_of_the_record(fault):
                raise
            row = _malformed(task, i, fault, digests)
            rows = Rows.gathered([row])
            answers.append(CutRecord(record=record, rows=rows, refusal=row.refusal))
    return answers


@np.errstate(over="ignore", invalid="ignore")
def _answer(task: Task, i: int, digests: dict[str, str]) -> CutRecord:
    campaign, record = task.campaign, task.piece.trials[i]
    reader = readers.reader(campaign.records.reader)
    whole = segments.read(campaign, task.root, reader, record, task.piece.paths[i])
    if not whole.pieces:
        none = Reduced(codes=whole.record.codes or ("NO_DATA",))
        rows = [_row(task, whole.record, record, none, digests)]
        return CutRecord(record=record, rows=Rows.gathered(rows), counts=_counts(whole))
    conditions = replace(_conditions(campaign), settle_s=0.0)
    sha = digest_of(task.root, whole.record.source, digests)
    rows = []
    for piece in whole.pieces:
        last = piece is whole.pieces[-1]
        reduced = reduce_record(
            piece.force_N,
            replace(conditions, tare_s=campaign.tare_s or len(piece.tare_N) / conditions.rate_Hz),
            time_s=piece.time_s,
            tare_after_N=task.tare_after_N.get(record, np.nan),
            tare_N=piece.tare_N,
            codes=tuple(c for c in whole.record.codes if c != "truncated" or last),
            where=f"{whole.record.source}, piece {piece.number}",
        )
        rows.append(
            Row(
                trial=f"{record}#{piece.number}",
                reduced=reduced,
                samples=len(piece.force_N),
                notes=whole.record.notes if last else (),
                source=whole.record.source,
                source_sha256=sha,
            )
        )
    return CutRecord(
        record=record,
        rows=Rows.gathered(rows, OF_PIECES),
        pieces=tuple(piece.without_samples for piece in whole.pieces),
        counts=_counts(whole),
    )


def _counts(whole: Segmented) -> Counter[str]:
    return Counter(
        samples=len(whole.record.force_N),
        pieces=len(whole.pieces),
        short=whole.cuts.short,
        settling=whole.cuts.settling,
        between=whole.cuts.between,
        rest=whole.at_rest,
    )
