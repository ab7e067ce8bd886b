"""Records to one row for every trial of the schedule; a rejected one says why."""

from __future__ import annotations

import difflib
import hashlib
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import readers
from nearlift.campaign.manifest import Campaign
from nearlift.campaign.rig import RECORD_MARK
from nearlift.errors import InputRefused, ManifestError, did_you_mean
from nearlift.readers import means, segments
from nearlift.readers.base import Reader, Record, malformed
from nearlift.readers.files import MARK, Piece, head_of, packing, source_of
from nearlift.readers.segments import CutPiece
from nearlift.readers.sweep import is_sweep
from nearlift.reduction import quality
from nearlift.reduction.record import Reduced, reduce_record
from nearlift.reduction.samples import Conditions
from nearlift.schedule import RECORD_COLUMN, SETTINGS, Schedule, read_schedule, schedule_file

#: What a manifest says wrong if all records carry a code.
_LENGTHS = "; correct tare, settle or sample_rate under [load_cell]"
MISDESCRIBED = {
    "NO_DATA": _LENGTHS,
    "TOO_SHORT": _LENGTHS,
    "TARE": "; is tare too long, or sample_rate wrong, under [load_cell]?",
    "MIXED": "; is tare too short, or sample_rate wrong, under [load_cell]?",
    "SATURATED": "; correct range under [load_cell], or the unit under [records] force",
    "STUCK": (
        '; is force under [records] the right column? a cell that zeroes itself has tare = "0 s",'
        " and settle for its head"
    ),
}
#: A record whose samples scatter by more than this part of its lift may be a sweep.
SWEEP = 0.1
SWEPT = (
    "the record takes many lifts: it is a sweep of the throttle, not one trial. To cut it, write"
    f" {RECORD_MARK} for {MARK} in [records] files, call the schedule's column of ids record,"
    " and add the [segments] that `nearlift inspect FILE` proposes for the record"
)
#: First bytes of a file that show its format.
HEAD = 1 << 16
#: Samples of a tare that show whether it is one level.
FEW_OF_TARE = 20
#: A cut file younger than this may be one that an instrument is still writing, ns.
WRITING_NS = 10_000_000_000

#: Columns of trials.parquet by their names.
Columns = dict[str, NDArray[Any]]
#: One trial's values of those columns that its record gives, and its quality codes as `codes`.
Row = Mapping[str, Any]
#: A trial without a record.
MISSING: Row = {
    **asdict(Reduced(codes=("MISSING",))),
    "samples": 0,
    "source_sha256": "",
    "source": "",
    "fault": "",
}


# ---- in a worker


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordAnswer:
    """A worker's answer for one record: a row, or one for each piece that it was cut into.

    `counts` are of the samples and pieces of a record that was cut. `refusal` is there where it
    cannot be read in the way that the manifest asks for.
    """

    record: str
    rows: tuple[Row, ...]
    pieces: tuple[CutPiece, ...] = ()
    counts: Counter[str] = field(default_factory=Counter)
    notes: tuple[str, ...] = ()
    refusal: InputRefused | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """Task of one worker: a piece of the plan, zero readings after trials, and known digests."""

    root: Path
    campaign: Campaign
    piece: Piece
    tare_after_N: Mapping[str, float]
    digests: Mapping[str, str]


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
    root, campaign, piece, digests = task.root, task.campaign, task.piece, dict(task.digests)
    reader, cut = readers.reader(campaign.records.reader), campaign.cuts_records
    reader = segments.cutting(reader) if cut else reader
    answers: list[RecordAnswer] = []
    try:
        for record in reader.read_piece(campaign, root, piece, whole=cut):
            sha = digest_of(root, record.source, digests)
            try:
                # damaged numbers may be anything
                with np.errstate(over="ignore", invalid="ignore"):
                    answers.append(_answer(task, record, sha))
            except Exception as fault:
                bad = malformed(record.trial, root, record.source, fault)
                answers.append(_answer(task, bad, sha))
    except Exception as fault:
        # a file that holds many trials cannot be read
        source = source_of(root, piece.paths[0])
        sha = digest_of(root, source, digests)
        for trial in piece.trials[len(answers) :]:
            answers.append(_answer(task, malformed(trial, root, source, fault), sha))
    return answers


def _answer(task: Task, record: Record, sha256: str) -> RecordAnswer:
    """The reduced record."""
    campaign, whole = task.campaign, segments.Segmented(record=record)
    cell, limits = campaign.load_cell, campaign.quality
    conditions = Conditions(
        rate_Hz=cell.sample_rate or 1.0,
        tare_s=campaign.tare_s,
        settle_s=cell.settle,
        drift=limits.drift,
        missing=limits.missing,
        out_of_range=limits.out_of_range,
        range_N=cell.range,
    )
    after = task.tare_after_N.get(record.trial, np.nan)
    # without a sample, or cut into no piece
    reduced, notes = [Reduced(codes=record.codes or ("NO_DATA",))], record.notes
    if campaign.cuts_records:
        whole = segments.cut(campaign, task.root, record)
        notes = whole.record.notes
        uncut = tuple(c for c in record.codes if c != "truncated")
        reduced = [
            reduce_record(
                piece.force_N,
                replace(
                    conditions,
                    settle_s=0.0,
                    tare_s=campaign.tare_s or len(piece.tare_N) / conditions.rate_Hz,
                ),
                time_s=piece.time_s,
                tare_after_N=after,
                tare_N=piece.tare_N,
                codes=record.codes if piece is whole.pieces[-1] else uncut,
                where=f"{record.source}, piece {piece.number}",
            )
            for piece in whole.pieces
        ] or reduced
    elif not record.fault:
        one = reduce_record(
            record.force_N,
            conditions,
            time_s=record.time_s,
            tare_after_N=after,
            codes=record.codes,
            where=f"{record.source}, trial {record.trial!r}",
        )
        may_sweep = MARK in campaign.records.pattern and one.sd_N > SWEEP * abs(one.lift_N)
        if may_sweep and is_sweep(record.force_N[round(campaign.tare_s * conditions.rate_Hz) :]):
            one, notes = replace(one, codes=(*one.codes, "MIXED")), (*notes, SWEPT)
        reduced = [one]
    samples = [len(piece.force_N) for piece in whole.pieces] or [
        0 if campaign.cuts_records else len(record.force_N)
    ]
    of_the_file = {"source_sha256": sha256, "source": record.source, "fault": record.fault}
    return RecordAnswer(
        record=record.trial,
        rows=tuple(
            {name: getattr(one, name) for name in Reduced.__slots__} | {"samples": n, **of_the_file}
            for one, n in zip(reduced, samples, strict=True)
        ),
        pieces=tuple(
            replace(piece, force_N=segments.NO_SAMPLES, time_s=None, tare_N=segments.NO_SAMPLES)
            for piece in whole.pieces
        ),
        counts=Counter(
            samples=len(record.force_N),
            pieces=len(whole.pieces),
            short=whole.cuts.short,
            settling=whole.cuts.settling,
            between=whole.cuts.between,
            rest=whole.at_rest,
        ),
        notes=notes,
        refusal=record.refusal,
    )


def digest_of(root: Path, source: str, digests: dict[str, str]) -> str:
    """The SHA-256 of a file of the campaign, which `digests` then has."""
    if source not in digests:
        with (root / source).open("rb") as file:
            digests[source] = hashlib.file_digest(file, "sha256").hexdigest()
    return digests[source]


# ---- the whole campaign

#: Results of a function over tasks, in order, by as many workers as there are.
Spread = Callable[[Callable[[Task], Any], Iterable[Task]], Iterator[Any]]
#: Callback for progress: the activity in words, and the share that is done.
Say = Callable[[str, float | None], None]


def reduced_trials(
    campaign: Campaign,
    root: Path,
    digests: Mapping[str, str],
    stamps: Mapping[str, tuple[int, int]],
    spread: Spread,
    say: Say,
) -> tuple[Columns, list[tuple[str, str]], list[str]]:
    """A row for every trial, the rejected ones with the reason, and notes.

    Parameters
    ----------
    digests : mapping of str to str
        SHA-256 of raw files, by their paths under `root`.
    stamps : mapping of str to (int, int)
        Size and time of last change of each file when it was hashed.

    Raises
    ------
    NearliftError
        The schedule or the records are refused, no trial has a record, or none is good.
    """
    cell, excluded = campaign.load_cell, campaign.quality.exclude
    reader = readers.reader(campaign.records.reader)
    schedule = read_schedule(campaign, root)
    notes = list(schedule.notes)
    if reader.contents is None:
        listing = source_of(root, schedule_file(campaign, root))
        sha256 = digest_of(root, listing, dict(digests))
        columns = means.columns_of(schedule, listing, sha256)
        codes: list[list[str]] = [[] for _ in schedule.trial]
    else:
        schedule, rows, more = _from_records(campaign, root, reader, schedule, digests, spread, say)
        codes = [list(row["codes"]) for row in rows]
        columns = {
            name: np.array([row[name] for row in rows], object if value == "" else None)
            for name, value in MISSING.items()
            if name != "codes"
        }
        notes += more
        if cell.tare == "none":
            notes.append(
                "the records have no tare: the zero of the force is unknown and needs an"
                ' [[uncertainty]] on = "force"'
            )
        if 0 < (samples := round(campaign.tare_s * (cell.sample_rate or 0.0))) < FEW_OF_TARE:
            notes.append(
                f"the tares have {samples} samples: too few to show damage of more than one of"
                f" them ({FEW_OF_TARE} would)"
            )
    # with it come pandas and scipy, which no worker needs
    from nearlift.reduction import judge

    if reader.contents is not None and not campaign.cuts_records:
        judge.mark_constant_tares(columns, codes)
        del columns["u_zero_N"]
    _mark_pending(campaign, root, stamps, columns["source"].tolist(), codes)
    owners = schedule.covariates[RECORD_COLUMN] if campaign.cuts_records else schedule.trial
    notes += judge.record_codes(columns, codes, owners, campaign)
    table = _table(schedule, columns, codes, owners, campaign)
    notes += judge.judge(table, campaign)
    if excluded:
        trials = ", ".join(f"{trial} ({why})" if why else trial for trial, why in excluded.items())
        notes.append(f"left out as [quality] exclude asks: {trials}")
    notes += quality.remarks(table["quality"])
    if quality.rejected(table["quality"]).all():
        # as such where the unit of force is at fault
        blank = np.full(len(table["quality"]), "", dtype=object)
        judge.against_weight({**table, "quality": blank}, campaign)
        counts = Counter(c for text in table["quality"] for c in text.split() if c.isupper())
        reasons = ", ".join(f"{code} {count}" for code, count in counts.most_common())
        worst = counts.most_common(1)[0][0]
        # the fault of the first record says more than the meaning of the code
        fault = next((f for f in table["fault"] if f), "") if worst == "MALFORMED" else ""
        meaning = f"{worst}: {fault or quality.CODES[worst]}{MISDESCRIBED.get(worst, '')}"
        what = f"all {len(table['quality'])} trials are rejected ({reasons})"
        swept = next((note for note in notes if note.startswith(SWEPT)), meaning)
        raise InputRefused(str(root), what, swept)
    rejected = [
        (str(table["trial"][i]), quality.reason(table["quality"][i], table["fault"][i]))
        for i in np.flatnonzero(quality.rejected(table["quality"], quality.EXCLUDED))
    ]
    return table, rejected, notes


def _table(
    schedule: Schedule,
    columns: Columns,
    codes: list[list[str]],
    owners: NDArray[np.object_],
    campaign: Campaign,
) -> Columns:
    """Columns of trials.parquet in run order, with the codes that each trial has by itself."""
    if schedule.reached_m is not None:
        off = np.abs(schedule.reached_m - schedule.z_m)
        lost = off > campaign.quality.height * campaign.vehicle.rotor_radius
        for k in np.flatnonzero(lost).tolist():
            codes[k].append("HEIGHT")
    excluded, fault = campaign.quality.exclude, columns["fault"]
    # a whole record may be left out as well
    ids = [*dict.fromkeys([*schedule.trial.tolist(), *owners])]
    for trial in sorted(excluded.keys() - {*ids}):
        near = ", ".join(map(repr, difflib.get_close_matches(trial, ids, n=3)))
        remedy = f"did you mean {near}?" if near else f"the schedule's first is {ids[0]!r}"
        what = f"no trial of the schedule is called {trial!r}"
        raise ManifestError("quality.exclude", what, remedy)
    for i, (trial, record) in enumerate(zip(schedule.trial, owners, strict=True)):
        if (named := trial if trial in excluded else record) in excluded:
            codes[i].append(quality.EXCLUDED)
            fault[i] = "; ".join(filter(None, (fault[i], excluded[named])))
    texts = [quality.joined(c) for c in codes]
    return {
        **{name: getattr(schedule, name) for name in SETTINGS},
        **columns,
        "quality": np.array(texts, dtype=object),
        "visit": schedule.visit,
        "completeness": np.array([quality.completeness(text) for text in texts], dtype=object),
        **schedule.covariates,
    }


def _from_records(
    campaign: Campaign,
    root: Path,
    reader: Reader,
    schedule: Schedule,
    digests: Mapping[str, str],
    spread: Spread,
    say: Say,
) -> tuple[Schedule, list[Row], list[str]]:
    """The schedule of all trials (of pieces, where records are cut), their rows, and notes.

    Raises
    ------
    InputRefused
        No trial has a record, or most records are refused. It is then the first record's refusal:
        one refused record is damaged, most of them are misdescribed.
    """
    ids, noun = schedule.trial.tolist(), "records" if campaign.cuts_records else "trials"
    reader = segments.cutting(reader) if campaign.cuts_records else reader
    pieces, notes = reader.plan(campaign, root, ids)
    count = sum(len(piece.trials) for piece in pieces)
    if not count:
        where, pattern = root / (campaign.records.files or ""), campaign.records.pattern
        there = [source_of(root, path) for path in root.glob(pattern.replace(MARK, "*"))]
        first = pattern.replace(MARK, ids[0])
        hint = did_you_mean(first, there) if MARK in pattern else next(iter(notes), "")
        remedy = f"the first, {ids[0]!r}, would be in {first}: {hint or 'check [records] files'}"
        raise InputRefused(str(where), f"none of the {len(ids)} {noun} has a record", remedy)
    known, tares = dict(digests), schedule.covariates.get("tare_after_N")
    after = {} if tares is None else dict(zip(ids, tares, strict=True))
    # a file that many trials share is hashed once, here, and not by every worker
    for path in {p.paths[0] for p in pieces if len(p.trials) > len({*p.paths})}:
        digest_of(root, source_of(root, path), known)
    tasks = (
        Task(
            root=root,
            campaign=campaign,
            piece=piece,
            tare_after_N={trial: after[trial] for trial in piece.trials if trial in after},
            digests={s: known[s] for p in piece.paths if (s := source_of(root, p)) in known},
        )
        for piece in pieces
    )
    answers: dict[str, RecordAnswer] = {}
    refused, refusals = list[str](), list[InputRefused]()
    for done in spread(reduce_piece, tasks):
        answers |= {answer.record: answer for answer in done}
        refused += [answer.rows[0]["source"] for answer in done if answer.refusal]
        refusals += [answer.refusal for answer in done if answer.refusal]
        if 2 * len(refusals) > count:
            raise _of_another_format(root / refused[0], reader) or refusals[0]
        say(f"ingest {len(answers)} of {count} {noun}", len(answers) / count)
    if campaign.cuts_records:
        cut = {record: answer.pieces for record, answer in answers.items()}
        schedule = segments.schedule_of_trials(campaign, root, cut)
        notes += _remarks_on_cuts([*answers.values()])
    # each remark once, with the number of records that it is about
    places: dict[str, list[str]] = {}
    for answer in (answers[i] for i in ids if i in answers):
        for note in answer.notes:
            places.setdefault(note, []).append(answer.rows[0]["source"])
    for note, sources in places.items():
        more = f"{len(sources)} records, such as " if len(sources) > 1 else ""
        about = more or note == SWEPT
        notes.append(f"{note} ({more}{sources[0]})" if about else note)
    rows = [row for i in ids for row in (answers[i].rows if i in answers else (MISSING,))]
    return schedule, rows, notes


def _of_another_format(path: Path, reader: Reader) -> InputRefused | None:
    """Refusal of a binary file by whose first bytes another reader recognises it."""
    head, name = head_of(path, HEAD), path.name.casefold()
    binary = [] if packing(path) else [r for r in readers.readers() if r.guarded and r != reader]
    for other in binary:
        if other.recognises(head, name):
            remedy = f'[records] reader = "{other.name}" reads {other.title}'
            return InputRefused(str(path), f"is no file for reader = {reader.name!r}", remedy)
    return None


def _remarks_on_cuts(answers: Sequence[RecordAnswer]) -> list[str]:
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


def _mark_pending(
    campaign: Campaign,
    root: Path,
    stamps: Mapping[str, tuple[int, int]],
    sources: Sequence[str],
    codes: list[list[str]],
) -> None:
    """Mark the trials of files that were still being written PENDING; refuse what many trials rest
    on where it was changed while it was read.
    """
    owners: dict[str, list[int]] = {}
    for i, source in enumerate(sources):
        owners.setdefault(source, []).append(i)
    now, folder = time.time_ns(), root.as_posix()
    for name, stamp in stamps.items():
        mine = owners.get(name, [])
        try:
            status = os.stat(f"{folder}/{name}")  # noqa: PTH116 - paths made one by one take longer
        except OSError:
            status = None
        if status is None or (status.st_size, status.st_mtime_ns) != stamp:
            if len(mine) != 1 and not (mine and campaign.cuts_records):
                what, remedy = "was changed while it was being read", "run again when it is"
                raise InputRefused(str(root / name), what, f"{remedy} complete")
        elif abs(now - status.st_mtime_ns) < WRITING_NS:
            # so young that it may still grow
            mine = [i for i in mine if not {"truncated", "MALFORMED"}.isdisjoint(codes[i])]
        else:
            continue
        for i in mine:
            codes[i].append("PENDING")
