"""Records to one row for every trial of the schedule; a rejected one says why."""

from __future__ import annotations

import contextlib
import difflib
import hashlib
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import readers
from nearlift.campaign.manifest import Campaign
from nearlift.campaign.rig import RECORD_MARK
from nearlift.errors import InputRefused, ManifestError, NearliftError
from nearlift.readers import means, ramp, segments
from nearlift.readers.base import Reader, Record, malformed
from nearlift.readers.files import MARK, Piece, source_of
from nearlift.readers.guarded import Malformed
from nearlift.readers.segments import CutPiece
from nearlift.reduction import quality
from nearlift.reduction.record import Reduced, reduce_record
from nearlift.reduction.samples import Conditions
from nearlift.schedule import RECORD_COLUMN, Schedule, read_schedule, schedule_file

#: What a manifest says wrong if all records carry a code.
MISDESCRIBED = {
    "NO_DATA": "; correct tare, settle or sample_rate under [load_cell]",
    "TOO_SHORT": "; correct tare, settle or sample_rate under [load_cell]",
    "TARE": "; is tare too long, or sample_rate wrong, under [load_cell]?",
    "MIXED": "; is tare too short, or sample_rate wrong, under [load_cell]?",
    "SATURATED": "; correct range under [load_cell], or the unit under [records] force",
    "STUCK": (
        '; is force under [records] the right column? a cell that zeroes itself has tare = "0 s",'
        " and settle for its head"
    ),
}
#: A record whose samples scatter by more than this part of its lift may be a sweep; where the
#: first few are none, no more are looked at.
SWEEP, FEW_SWEEPS = 0.1, 3
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
    reduce = partial(reduce_record, tare_after_N=after)
    # without a sample, or cut into no piece
    reduced = [Reduced(codes=record.codes or ("NO_DATA",))]
    samples = [len(record.force_N)]
    if campaign.cuts_records:
        whole = segments.cut(campaign, task.root, record)
        samples = [len(piece.force_N) for piece in whole.pieces] or [0]
        uncut = tuple(c for c in record.codes if c != "truncated")
        reduced = [
            reduce(
                piece.force_N,
                replace(
                    conditions,
                    settle_s=0.0,
                    tare_s=campaign.tare_s or len(piece.tare_N) / conditions.rate_Hz,
                ),
                time_s=piece.time_s,
                tare_N=piece.tare_N,
                codes=record.codes if piece is whole.pieces[-1] else uncut,
                where=f"{record.source}, piece {piece.number}",
            )
            for piece in whole.pieces
        ] or reduced
    elif not record.fault:
        where = f"{record.source}, trial {record.trial!r}"
        codes, time_s = record.codes, record.time_s
        reduced = [reduce(record.force_N, conditions, time_s=time_s, codes=codes, where=where)]
    of_the_file = {"source_sha256": sha256, "source": record.source, "fault": record.fault}
    return RecordAnswer(
        record=record.trial,
        rows=tuple(
            {**asdict(one), "samples": n, **of_the_file}
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
        notes=whole.record.notes,
        refusal=record.refusal,
    )


def digest_of(root: Path, source: str, digests: dict[str, str]) -> str:
    """The SHA-256 of a file of the campaign, which `digests` then has."""
    if source not in digests:
        with (root / source).open("rb") as file:
            digests[source] = hashlib.file_digest(file, "sha256").hexdigest()
    return digests[source]


# ---- the whole campaign


@dataclass(frozen=True, slots=True, kw_only=True)
class Recorded:
    """A campaign as it was recorded.

    Attributes
    ----------
    digests : mapping of str to str
        SHA-256 of each raw file, by its path under `root`.
    stamps : mapping of str to (int, int)
        Size and time of last change of each file when it was hashed.
    spread : callable
        Results of a function over tasks, in order, by as many workers as there are.
    say : callable
        Hears what is being done, and the share that is done.
    """

    root: Path
    campaign: Campaign
    digests: Mapping[str, str]
    stamps: Mapping[str, tuple[int, int]]
    spread: Callable[[Callable[[Task], Any], Iterable[Task]], Iterator[Any]]
    say: Callable[[str, float | None], None]


def reduced_trials(recorded: Recorded) -> tuple[Columns, list[tuple[str, str]], list[str]]:
    """A row for every trial, the rejected ones with the reason, and notes.

    Raises
    ------
    NearliftError
        The schedule or the records are refused, no trial has a record, or none is good.
    """
    # with it come pandas and scipy, which no worker needs
    from nearlift.reduction import judge

    campaign, root = recorded.campaign, recorded.root
    cell, excluded = campaign.load_cell, campaign.quality.exclude
    reader = readers.reader(campaign.records.reader)
    schedule = read_schedule(campaign, root)
    notes, sweeps = list(schedule.notes), list[str]()
    if reader.contents is None:
        listing = source_of(root, schedule_file(campaign, root))
        sha256 = digest_of(root, listing, dict(recorded.digests))
        columns = means.columns_of(schedule, listing, sha256)
        codes: list[list[str]] = [[] for _ in schedule.trial]
    else:
        schedule, rows, more = _from_records(recorded, reader, schedule)
        codes = [list(row["codes"]) for row in rows]
        columns = {
            name: np.array([row[name] for row in rows], object if value == "" else None)
            for name, value in MISSING.items()
            if name != "codes"
        }
        if not campaign.cuts_records:
            del columns["u_zero_N"]
            sweeps = _mark_sweeps(recorded, reader, schedule, columns, codes)
        if cell.tare == "none":
            more.append(
                "the records have no tare: the zero of the force is unknown and wants an"
                ' [[uncertainty]] on = "force"'
            )
        if 0 < (samples := round(campaign.tare_s * (cell.sample_rate or 0.0))) < FEW_OF_TARE:
            more.append(
                f"the tares have {samples} samples: too few to show damage of more than one of"
                f" them ({FEW_OF_TARE} would)"
            )
        notes += [*more, *sweeps]
    _mark_pending(recorded, columns["source"].tolist(), codes)
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
        raise _all_rejected(recorded, table, sweeps)
    rejected = [
        (str(table["trial"][i]), quality.reason(table["quality"][i], table["fault"][i]))
        for i in np.flatnonzero(quality.rejected(table["quality"], quality.EXCLUDED))
    ]
    return table, rejected, notes


def _all_rejected(recorded: Recorded, table: Columns, sweeps: list[str]) -> InputRefused:
    """The refusal of a campaign without a good trial, by its commonest code."""
    counts = Counter(code for text in table["quality"] for code in text.split() if code.isupper())
    reasons = ", ".join(f"{code} {count}" for code, count in counts.most_common())
    worst = counts.most_common(1)[0][0]
    # the fault of the first record says more than the meaning of the code
    fault = next((f for f in table["fault"] if f), "") if worst == "MALFORMED" else ""
    meaning = f"{worst}: {fault or quality.CODES[worst]}{MISDESCRIBED.get(worst, '')}"
    what = f"all {len(table['quality'])} trials are rejected ({reasons})"
    return InputRefused(str(recorded.root), what, *(sweeps or [meaning]))


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
        near = difflib.get_close_matches(trial, ids, n=3)
        raise ManifestError(
            "quality.exclude",
            f"no trial of the schedule is called {trial!r}",
            f"did you mean {', '.join(map(repr, near))}?"
            if near
            else f"the schedule's first is {ids[0]!r}",
        )
    for i, (trial, record) in enumerate(zip(schedule.trial, owners, strict=True)):
        if (named := trial if trial in excluded else record) in excluded:
            codes[i].append(quality.EXCLUDED)
            fault[i] = "; ".join(filter(None, (fault[i], excluded[named])))
    texts = [quality.joined(c) for c in codes]
    return {
        **schedule.settings,
        **columns,
        "quality": np.array(texts, dtype=object),
        "visit": schedule.visit,
        "completeness": np.array([quality.completeness(text) for text in texts], dtype=object),
        **schedule.covariates,
    }


def _from_records(
    recorded: Recorded, reader: Reader, schedule: Schedule
) -> tuple[Schedule, list[Row], list[str]]:
    """The schedule of all trials (of pieces, where records are cut), their rows, and notes.

    Raises
    ------
    InputRefused
        No trial has a record, or most records are refused, by the first refusal: one record is
        damaged, most of them are misdescribed.
    """
    root, campaign, ids = recorded.root, recorded.campaign, schedule.trial.tolist()
    noun = "records" if campaign.cuts_records else "trials"
    reader = segments.cutting(reader) if campaign.cuts_records else reader
    pieces, notes = reader.plan(campaign, root, ids)
    count = sum(len(piece.trials) for piece in pieces)
    if not count:
        raise InputRefused(
            str(root / (campaign.records.files or "")),
            f"none of the {len(ids)} {noun} has a record",
            f"the first would be that of {ids[0]!r}; check [records] files",
        )
    digests, tares = dict(recorded.digests), schedule.covariates.get("tare_after_N")
    after = {} if tares is None else dict(zip(ids, tares, strict=True))
    # a file that many trials share is hashed once, here, and not by every worker
    for path in {p.paths[0] for p in pieces if len(p.trials) > len({*p.paths})}:
        digest_of(root, source_of(root, path), digests)
    tasks = (
        Task(
            root=root,
            campaign=campaign,
            piece=piece,
            tare_after_N={trial: after[trial] for trial in piece.trials if trial in after},
            digests={
                name: digests[name]
                for name in (source_of(root, path) for path in piece.paths)
                if name in digests
            },
        )
        for piece in pieces
    )
    answers: dict[str, RecordAnswer] = {}
    refusals: list[InputRefused] = []
    for done in recorded.spread(reduce_piece, tasks):
        answers |= {answer.record: answer for answer in done}
        refusals += [answer.refusal for answer in done if answer.refusal]
        if 2 * len(refusals) > count:
            raise refusals[0]
        recorded.say(f"ingest {len(answers)} of {count} {noun}", len(answers) / count)
    if campaign.cuts_records:
        cut = {record: answer.pieces for record, answer in answers.items()}
        schedule = segments.schedule_of_trials(campaign, root, cut)
        notes += _remarks_on_cuts([*answers.values()])
    # each remark once, with the number of records that it is about
    places: dict[str, list[str]] = {}
    for answer in (answers[i] for i in ids if i in answers):
        for note in answer.notes:
            places.setdefault(note, []).append(answer.rows[0]["source"])
    notes += [
        note if len(sources) == 1 else f"{note} ({len(sources)} records, such as {sources[0]})"
        for note, sources in places.items()
    ]
    rows = [row for i in ids for row in (answers[i].rows if i in answers else (MISSING,))]
    return schedule, rows, notes


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


def _mark_sweeps(
    recorded: Recorded,
    reader: Reader,
    schedule: Schedule,
    columns: Columns,
    codes: list[list[str]],
) -> list[str]:
    """Remark on records that sweep the throttle but are given as one trial each, with the lines
    that would cut them. Their codes become MIXED.
    """
    campaign, root = recorded.campaign, recorded.root
    wide = columns["sd_N"] > SWEEP * np.abs(columns["lift_N"])
    place = {str(schedule.trial[i]): i for i in np.flatnonzero(wide).tolist()}
    if MARK not in campaign.records.pattern or not place:
        return []
    sweeps: dict[str, ramp.Ramp] = {}
    for k, (trial, (path, _)) in enumerate(reader.places(campaign, root, [*place]).items()):
        if k == FEW_SWEEPS and not sweeps:
            break
        with contextlib.suppress(NearliftError, Malformed):
            swept = ramp.of_file(campaign, reader, trial, path)
            sweeps |= {} if swept is None else {trial: swept}
    if not sweeps:
        return []
    for i in (place[trial] for trial in sweeps):
        codes[i].append("MIXED")
    trial, first = next(iter(sweeps.items()))
    more = f" (and {len(sweeps) - 1} more like it)" if len(sweeps) > 1 else ""
    remark = (
        f"the record of {trial}{more} {first.words}; to cut it into trials write {RECORD_MARK} for"
        f" {MARK} in [records] files, call the column of ids in {campaign.trials.file} record,"
        f" and add\n{first.segments}`nearlift inspect --cuts CAMPAIGN` then draws where it is cut"
    )
    return [remark]


def _mark_pending(recorded: Recorded, sources: Sequence[str], codes: list[list[str]]) -> None:
    """Mark the trials of files that were still being written PENDING; refuse what many trials rest
    on where it was changed while it was read.
    """
    owners: dict[str, list[int]] = {}
    for i, source in enumerate(sources):
        owners.setdefault(source, []).append(i)
    now, folder = time.time_ns(), recorded.root.as_posix()
    for name, stamp in recorded.stamps.items():
        mine = owners.get(name, [])
        try:
            status = os.stat(f"{folder}/{name}")  # noqa: PTH116 - paths made one by one take longer
        except OSError:
            status = None
        if status is None or (status.st_size, status.st_mtime_ns) != stamp:
            if len(mine) != 1 and not (mine and recorded.campaign.cuts_records):
                raise InputRefused(
                    str(recorded.root / name),
                    "was changed while it was being read",
                    "run again when it is complete",
                )
        elif abs(now - status.st_mtime_ns) < WRITING_NS:
            # so young that it may still grow
            mine = [i for i in mine if not {"truncated", "MALFORMED"}.isdisjoint(codes[i])]
        else:
            continue
        for i in mine:
            codes[i].append("PENDING")
