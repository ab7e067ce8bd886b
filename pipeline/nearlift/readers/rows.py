"""Records to rows: the task of one worker, and its answer for each record."""

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
from nearlift.errors import InputRefused
from nearlift.readers import segments
from nearlift.readers.base import Record, malformed
from nearlift.readers.files import Piece, source_of
from nearlift.readers.segments import CutPiece
from nearlift.reduction.record import Reduced, reduce_record
from nearlift.reduction.samples import Conditions

#: Columns of trials.parquet that are fields of `Row`, and fields of its reduction.
OF_THE_FILE = ("samples", "source_sha256", "source", "fault")
OF_THE_REDUCTION = ("lift_N", "u_lift_N", "n_eff", "drift_N_s", "sd_N", "n", "n_removed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One trial's numbers; `fault` says what is wrong with a MALFORMED record."""

    reduced: Reduced
    source_sha256: str = ""
    source: str = ""
    samples: int = 0
    fault: str = ""


#: A trial without a record.
MISSING = Row(reduced=Reduced(codes=("MISSING",)))


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordAnswer:
    """A worker's answer for one record: a row, or one for each piece that it was cut into.

    `refusal` is there where it cannot be read in the way that the manifest asks for.
    """

    record: str
    rows: tuple[Row, ...]
    pieces: tuple[CutPiece, ...] = ()
    counts: Counter[str] = field(default_factory=Counter)
    notes: tuple[str, ...] = ()
    refusal: InputRefused | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Task of one worker: a piece of the plan, and the data to reduce it."""

    root: Path
    campaign: Campaign
    piece: Piece
    tare_after_N: Mapping[str, float]
    inputs: Mapping[str, str]


def reduce_piece(task: Task) -> list[RecordAnswer]:
    """Read and reduce the records of one piece; runs in any thread or process.

    Whatever a record holds, its trial has a row: what is raised over one makes it MALFORMED, and
    the next is read.

    Raises
    ------
    NearliftError
        The manifest is at fault.
    OSError, MemoryError
        The machine is at fault.
    """
    root, piece, digests = task.root, task.piece, dict(task.inputs)
    answers: list[RecordAnswer] = []
    try:
        for record in _records(task):
            try:
                # damaged numbers may be anything
                with np.errstate(over="ignore", invalid="ignore"):
                    answers.append(_answer(task, record, digests))
            except Exception as fault:
                bad = malformed(record.trial, root, record.source, fault)
                answers.append(_answer(task, bad, digests))
    except Exception as fault:
        # a file that holds many trials cannot be read
        for trial in piece.trials[len(answers) :]:
            bad = malformed(trial, root, source_of(root, piece.paths[0]), fault)
            answers.append(_answer(task, bad, digests))
    return answers


def _records(task: Task) -> Iterator[Record]:
    campaign, reader = task.campaign, readers.reader(task.campaign.records.reader)
    if not campaign.cuts_records:
        return reader.read_piece(campaign, task.root, task.piece)
    return segments.cutting(reader).read_piece(campaign, task.root, task.piece, whole=True)


def _answer(task: Task, record: Record, digests: dict[str, str]) -> RecordAnswer:
    """The reduced record; `digests` grows by that of its file."""
    campaign = task.campaign
    sha = digest_of(task.root, record.source, digests)
    cell, choice = campaign.load_cell, campaign.quality
    conditions = Conditions(
        rate_Hz=cell.sample_rate or 1.0,
        tare_s=campaign.tare_s,
        settle_s=cell.settle,
        drift=choice.drift,
        missing=choice.missing,
        out_of_range=choice.out_of_range,
        range_N=cell.range,
    )
    after = task.tare_after_N.get(record.trial, np.nan)
    if not campaign.cuts_records or not len(record.force_N):
        reduced = Reduced(codes=record.codes or ("NO_DATA",))
        if not record.fault and not campaign.cuts_records:
            reduced = reduce_record(
                record.force_N,
                conditions,
                time_s=record.time_s,
                tare_after_N=after,
                codes=record.codes,
                where=f"{record.source}, trial {record.trial!r}",
            )
        row = Row(
            reduced=reduced,
            source_sha256=sha,
            source=record.source,
            samples=len(record.force_N),
            fault=record.fault,
        )
        return RecordAnswer(
            record=record.trial, rows=(row,), notes=record.notes, refusal=record.refusal
        )
    whole = segments.cut(campaign, task.root, record)
    rows: list[Row] = []
    for piece in whole.pieces:
        last = piece is whole.pieces[-1]
        tare_s = campaign.tare_s or len(piece.tare_N) / conditions.rate_Hz
        reduced = reduce_record(
            piece.force_N,
            replace(conditions, settle_s=0.0, tare_s=tare_s),
            time_s=piece.time_s,
            tare_after_N=after,
            tare_N=piece.tare_N,
            codes=tuple(c for c in record.codes if c != "truncated" or last),
            where=f"{record.source}, piece {piece.number}",
        )
        rows.append(
            Row(
                reduced=reduced,
                samples=len(piece.force_N),
                source=record.source,
                source_sha256=sha,
            )
        )
    none = Reduced(codes=record.codes or ("NO_DATA",))
    counts = Counter(
        samples=len(record.force_N),
        pieces=len(whole.pieces),
        short=whole.cuts.short,
        settling=whole.cuts.settling,
        between=whole.cuts.between,
        rest=whole.at_rest,
    )
    return RecordAnswer(
        record=record.trial,
        rows=tuple(rows) or (Row(reduced=none, source_sha256=sha, source=record.source),),
        pieces=tuple(piece.without_samples for piece in whole.pieces),
        counts=counts,
        notes=whole.record.notes,
    )


def digest_of(root: Path, source: str, digests: dict[str, str]) -> str:
    """The SHA-256 of a file of the campaign, which `digests` then has."""
    if source not in digests:
        with (root / source).open("rb") as file:
            digests[source] = hashlib.file_digest(file, "sha256").hexdigest()
    return digests[source]


def columns_of(rows: Sequence[Row], further: tuple[str, ...] = ()) -> dict[str, NDArray[Any]]:
    """Columns of trials.parquet; `further` are additional numbers of the reduction."""
    columns: dict[str, NDArray[Any]] = {
        name: np.array([getattr(row.reduced, name) for row in rows])
        for name in (*OF_THE_REDUCTION, *further)
    }
    for name in OF_THE_FILE:
        kind = None if name == "samples" else object
        columns[name] = np.array([getattr(row, name) for row in rows], dtype=kind)
    return columns


def remarks(answers: Sequence[RecordAnswer]) -> list[str]:
    """The records' remarks, each once, with the number of records that it is about."""
    places: dict[str, list[str]] = {}
    for answer in answers:
        for note in answer.notes:
            places.setdefault(note, []).append(answer.rows[0].source)
    return [
        note if len(sources) == 1 else f"{note} ({len(sources)} records, such as {sources[0]})"
        for note, sources in places.items()
    ]
