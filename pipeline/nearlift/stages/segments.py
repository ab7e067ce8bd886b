"""Records of many trials to rows: each is read once, cut, and reduced piece by piece. The pieces
make the schedule of trials.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from nearlift import readers
from nearlift.errors import InputRefused
from nearlift.readers import files, segments
from nearlift.readers.base import Reader
from nearlift.readers.files import per_trial, unlisted
from nearlift.readers.segment_schedule import schedule_of_trials
from nearlift.readers.segments import Pieces, Segmented
from nearlift.reduction.record import Reduced, reduce_record
from nearlift.run.engine import Job
from nearlift.run.workers import ordered
from nearlift.schedule import Schedule
from nearlift.stages.rows import (
    Row,
    Rows,
    Task,
    conditions_of,
    digest_of,
    is_of_the_record,
    malformed,
)

#: What rows of pieces have beside the usual numbers.
FURTHER = ("u_zero_N",)


@dataclass(frozen=True, slots=True, kw_only=True)
class CutRecord:
    """Answer of one worker for one record: a row for each piece, or one where there is none.

    It also has the counts, and why the record cannot be read as the manifest asks.
    """

    record: str
    rows: Rows
    pieces: Pieces = field(default_factory=Pieces)
    counts: Counter[str] = field(default_factory=Counter)
    refusal: InputRefused | None = None


def from_records(job: Job, reader: Reader, schedule: Schedule) -> tuple[Schedule, Rows, list[str]]:
    """The schedule of all pieces, their rows, and notes.

    Raises
    ------
    InputRefused
        No record is there, or most cannot be read or cut as the manifest says: the first one's
        refusal.
    """
    answers = _answers(job, reader, schedule)
    pieces = {record: answer.pieces for record, answer in answers.items()}
    ids = schedule.trial.tolist()
    trials = schedule_of_trials(job.campaign, job.root, pieces)
    rows, at = Rows(len(trials), FURTHER), 0
    for record in ids:
        # a record that is not there has a row that is MISSING
        if record in answers:
            rows.put_all(at, answers[record].rows)
        at += len(answers[record].rows.codes) if record in answers else 1
    notes = [*unlisted(job.campaign, job.root, ids), *_counted(list(answers.values()))]
    return trials, rows, [*notes, *rows.remarks()]


def _answers(job: Job, reader: Reader, schedule: Schedule) -> dict[str, CutRecord]:
    """The answer for each record that is there; raises as `from_records`."""
    campaign, ids = job.campaign, schedule.trial.tolist()
    segments.cutting(reader).checked_dialect(campaign.records.dialect)
    there = per_trial(campaign, job.root, ids)
    if not there:
        raise InputRefused(
            str(job.root / (campaign.records.files or "")),
            f"none of the {len(ids)} records of the schedule is there",
            f"the first would be {ids[0]!r}; check [records] files",
        )
    answers: dict[str, CutRecord] = {}
    refusals: list[InputRefused] = []
    for portion in ordered(job.executor, each_record, _tasks(job, there, schedule)):
        answers |= {answer.record: answer for answer in portion}
        refusals += [answer.refusal for answer in portion if answer.refusal]
        if 2 * len(refusals) > len(there):
            raise refusals[0]
        job.say(f"ingest {len(answers)} of {len(there)} records")
    return answers


def _tasks(job: Job, there: Mapping[str, tuple[Path, int]], schedule: Schedule) -> Iterator[Task]:
    after = schedule.covariates.get("tare_after_N")
    zero = dict(zip(schedule.trial, after, strict=True)) if after is not None else {}
    for piece in files.pieces(there):
        yield Task(
            root=job.root,
            campaign=job.campaign,
            piece=piece,
            tare_after_N={trial: zero[trial] for trial in piece.trials if trial in zero},
            inputs=job.inputs,
        )


def each_record(task: Task) -> list[CutRecord]:
    """The answer for each record of a task; of one over which something is raised, a MALFORMED row.

    Runs in any thread or process, and raises as `reduce_piece`.
    """
    answers, digests = list[CutRecord](), dict(task.inputs)
    for i, record in enumerate(task.piece.trials):
        try:
            answers.append(_answer(task, i, digests))
        except Exception as fault:
            if not is_of_the_record(fault):
                raise
            row = malformed(task, i, fault, digests)
            rows = Rows.gathered([row])
            answers.append(CutRecord(record=record, rows=rows, refusal=row.refusal))
    return answers


@np.errstate(over="ignore", invalid="ignore")
def _answer(task: Task, i: int, digests: dict[str, str]) -> CutRecord:
    campaign, record = task.campaign, task.piece.trials[i]
    reader = readers.reader(campaign.records.reader)
    whole = segments.read(campaign, task.root, reader, record, task.piece.paths[i])
    source, sha = whole.record.source, digest_of(task, whole.record.source, digests)
    if not whole.pieces:
        codes = whole.record.codes or ("NO_DATA",)
        row = Row(
            trial=record,
            reduced=Reduced(codes=codes),
            samples=len(whole.record.force_N),
            notes=whole.record.notes,
            fault=whole.record.fault,
            source=source,
            source_sha256=sha,
        )
        return CutRecord(record=record, rows=Rows.gathered([row]), counts=_counts(whole))
    conditions = replace(conditions_of(campaign), settle_s=0.0)
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
                source=source,
                source_sha256=sha,
            )
        )
    return CutRecord(
        record=record,
        rows=Rows.gathered(rows, FURTHER),
        pieces=whole.without_samples,
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


def _counted(answers: list[CutRecord]) -> list[str]:
    """Shares of samples that were kept and left out, in one line."""
    total: Counter[str] = sum((a.counts for a in answers), Counter())
    if not total["pieces"]:
        return []
    share = {k: 100 * total[k] / total["samples"] for k in ("settling", "between")}
    records = sum(a.counts["pieces"] > 0 for a in answers)
    kept = f"{records} record{'s' * (records != 1)} cut into {total['pieces']} trials"
    settling = f"{share['settling']:.3g} % of the samples are settling"
    short = f"{share['between']:.3g} % are in {total['short']} pieces that are too short"
    return [f"{kept}; {settling}, {short}, {total['rest']} pieces are at rest"]
