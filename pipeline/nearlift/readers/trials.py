"""Records to one row for every trial of the schedule; a rejected one says why."""

from __future__ import annotations

import contextlib
import difflib
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import readers
from nearlift.campaign.manifest import Campaign
from nearlift.campaign.rig import RECORD_MARK
from nearlift.errors import InputRefused, ManifestError, NearliftError
from nearlift.readers import means, ramp, segments
from nearlift.readers.base import Reader
from nearlift.readers.files import MARK, Piece, per_trial, source_of
from nearlift.readers.guarded import Malformed
from nearlift.readers.rows import (
    MISSING,
    RecordAnswer,
    Row,
    Task,
    columns_of,
    digest_of,
    reduce_piece,
    remarks,
)
from nearlift.readers.segment_schedule import schedule_of_trials
from nearlift.reduction import judge, quality
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


Spread = Callable[[Callable[[Task], Any], Iterable[Task]], Iterator[Any]]


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
    spread: Spread
    say: Callable[[str, float | None], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReducedTrials:
    """Columns of all trials, the rejected ones with the reason, and notes."""

    table: dict[str, NDArray[Any]]
    rejected: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


def reduced_trials(recorded: Recorded) -> ReducedTrials:
    """A row for every trial.

    Raises
    ------
    NearliftError
        The schedule or the records are refused, no trial has a record, or none is good.
    """
    campaign = recorded.campaign
    reader = readers.reader(campaign.records.reader)
    schedule = read_schedule(campaign, recorded.root)
    notes, sweeps = list(schedule.notes), list[str]()
    if not campaign.cuts_records:
        _require_known(campaign.quality.exclude, schedule)
    if reader.contents is None:
        columns = means.columns_of(schedule, *_listing(recorded))
        codes: list[tuple[str, ...]] = [()] * len(schedule)
    else:
        schedule, rows, more = _from_records(recorded, reader, schedule)
        columns = columns_of(rows, ("u_zero_N",) if campaign.cuts_records else ())
        codes = [row.reduced.codes for row in rows]
        if campaign.cuts_records:
            _require_known(campaign.quality.exclude, schedule, by_record=True)
        else:
            sweeps = _mark_sweeps(recorded, reader, schedule, columns, codes)
        notes += [*more, *_remarks_on_tare(campaign), *sweeps]
    _mark_pending(recorded, columns["source"].tolist(), codes)
    table, duplicates = _table(schedule, columns, codes, campaign)
    notes += [*duplicates, *judge.judge(table, campaign)]
    if asked := campaign.quality.exclude:
        trials = ", ".join(f"{trial} ({why})" if why else trial for trial, why in asked.items())
        notes.append(f"left out as [quality] exclude asks: {trials}")
    notes += quality.remarks(table["quality"])
    if quality.rejected(table["quality"]).all():
        raise _all_rejected(recorded, table, sweeps)
    rejected = tuple(
        (str(table["trial"][i]), quality.reason(table["quality"][i], table["fault"][i]))
        for i in np.flatnonzero(quality.faulty(table["quality"]))
    )
    return ReducedTrials(table=table, rejected=rejected, notes=tuple(notes))


def _listing(recorded: Recorded) -> tuple[str, str]:
    """The schedule's file, relative to the folder, and its SHA-256."""
    source = source_of(recorded.root, schedule_file(recorded.campaign, recorded.root))
    return source, digest_of(recorded.root, source, dict(recorded.digests))


def _all_rejected(
    recorded: Recorded, table: dict[str, NDArray[Any]], sweeps: list[str]
) -> InputRefused:
    """The refusal of a campaign without a good trial, by its commonest code; raised as such where
    the unit of force is at fault.
    """
    campaign = recorded.campaign
    blank = {**table, "quality": np.full(len(table["quality"]), "", dtype=object)}
    judge.against_weight(blank, campaign)
    counts = Counter(code for text in table["quality"] for code in text.split() if code.isupper())
    reasons = ", ".join(f"{code} {count}" for code, count in counts.most_common())
    worst = counts.most_common(1)[0][0]
    # the fault of the first record says more than the meaning of the code
    fault = next((f for f in table["fault"] if f), "") if worst == "MALFORMED" else ""
    meaning = f"{worst}: {fault or quality.CODES[worst]}{MISDESCRIBED.get(worst, '')}"
    return InputRefused(
        str(recorded.root),
        f"all {len(table['quality'])} trials are rejected ({reasons})",
        *(sweeps or [meaning]),
    )


def _table(
    schedule: Schedule,
    columns: dict[str, NDArray[Any]],
    of_records: Sequence[tuple[str, ...]],
    campaign: Campaign,
) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Columns of trials.parquet in run order, with the codes that each trial has by itself; and
    notes on duplicates.
    """
    codes = [list(trial_codes) for trial_codes in of_records]
    owners = schedule.covariates[RECORD_COLUMN] if campaign.cuts_records else schedule.trial
    notes = judge.record_codes(columns, codes, owners, campaign)
    if schedule.reached_m is not None:
        off = np.abs(schedule.reached_m - schedule.z_m)
        lost = off > campaign.quality.height * campaign.vehicle.rotor_radius
        for k in np.flatnonzero(lost).tolist():
            codes[k].append("HEIGHT")
    excluded, fault = campaign.quality.exclude, columns["fault"]
    for i, (trial, record) in enumerate(zip(schedule.trial, owners, strict=True)):
        if (named := trial if trial in excluded else record) in excluded:
            codes[i].append(quality.EXCLUDED)
            fault[i] = "; ".join(filter(None, (fault[i], excluded[named])))
    texts = [quality.joined(c) for c in codes]
    table = {
        **schedule.settings,
        **columns,
        "quality": np.array(texts, dtype=object),
        "visit": schedule.visit,
        "completeness": np.array([quality.completeness(text) for text in texts], dtype=object),
        **schedule.covariates,
    }
    return table, notes


def _require_known(exclude: Mapping[str, str], schedule: Schedule, by_record: bool = False) -> None:
    """Refuse a manifest that excludes a trial that is not in the schedule; propose ids like it."""
    ids = schedule.trial.tolist()
    # a whole record may be left out as well
    records = schedule.covariates["record"].tolist() if by_record else []
    for trial in sorted(exclude.keys() - {*ids, *records}):
        near = difflib.get_close_matches(trial, ids, n=3)
        remedy = (
            f"did you mean {', '.join(map(repr, near))}?"
            if near
            else f"the schedule's first is {ids[0]!r}"
        )
        raise ManifestError(
            "quality.exclude", f"no trial of the schedule is called {trial!r}", remedy
        )


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
    campaign, ids = recorded.campaign, schedule.trial.tolist()
    noun = "records" if campaign.cuts_records else "trials"
    reader = segments.cutting(reader) if campaign.cuts_records else reader
    pieces, notes = reader.plan(campaign, recorded.root, ids)
    count = sum(len(piece.trials) for piece in pieces)
    if not count:
        raise InputRefused(
            str(recorded.root / (campaign.records.files or "")),
            f"none of the {len(ids)} {noun} has a record",
            f"the first would be that of {ids[0]!r}; check [records] files",
        )
    answers: dict[str, RecordAnswer] = {}
    refusals: list[InputRefused] = []
    for done in recorded.spread(reduce_piece, _tasks(recorded, pieces, schedule)):
        answers |= {answer.record: answer for answer in done}
        refusals += [answer.refusal for answer in done if answer.refusal]
        if 2 * len(refusals) > count:
            raise refusals[0]
        recorded.say(f"ingest {len(answers)} of {count} {noun}", len(answers) / count)
    if campaign.cuts_records:
        cut = {record: answer.pieces for record, answer in answers.items()}
        schedule = schedule_of_trials(campaign, recorded.root, cut)
        notes += _remarks_on_cuts([*answers.values()])
    rows = [row for i in ids for row in (answers[i].rows if i in answers else (MISSING,))]
    in_order = [answers[i] for i in ids if i in answers]
    return schedule, rows, [*notes, *remarks(in_order)]


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
    columns: Mapping[str, NDArray[Any]],
    codes: list[tuple[str, ...]],
) -> list[str]:
    """Remark on records that sweep the throttle but are given as one trial each, with the lines
    that would cut them. Their codes become MIXED.
    """
    campaign = recorded.campaign
    if MARK not in campaign.records.pattern:
        return []
    wide = columns["sd_N"] > SWEEP * np.abs(columns["lift_N"])
    place = {str(schedule.trial[i]): i for i in np.flatnonzero(wide).tolist()}
    sweeps: dict[str, ramp.Ramp] = {}
    for k, (trial, (path, _)) in enumerate(per_trial(campaign, recorded.root, [*place]).items()):
        if k == FEW_SWEEPS and not sweeps:
            break
        with contextlib.suppress(NearliftError, Malformed):
            swept = ramp.of_file(campaign, reader, trial, path)
            sweeps |= {} if swept is None else {trial: swept}
    if not sweeps:
        return []
    for i in (place[trial] for trial in sweeps):
        codes[i] = tuple(dict.fromkeys((*codes[i], "MIXED")))
    trial, first = next(iter(sweeps.items()))
    more = f" (and {len(sweeps) - 1} more like it)" if len(sweeps) > 1 else ""
    remark = (
        f"the record of {trial}{more} {first.words}; to cut it into trials write {RECORD_MARK} for"
        f" {MARK} in [records] files, call the column of ids in {campaign.trials.file} record,"
        f" and add\n{first.segments}`nearlift inspect --cuts CAMPAIGN` then draws where it is cut"
    )
    return [remark]


def _remarks_on_tare(campaign: Campaign) -> list[str]:
    """Remarks on the tare that the manifest declares."""
    remarks = []
    if campaign.load_cell.tare == "none":
        remarks.append(
            "the records have no tare: the zero of the force is unknown and wants an"
            ' [[uncertainty]] on = "force"'
        )
    samples = round(campaign.tare_s * (campaign.load_cell.sample_rate or 0.0))
    if 0 < samples < FEW_OF_TARE:
        remarks.append(
            f"the tares have {samples} samples: too few to show damage of more than one of them"
            f" ({FEW_OF_TARE} would)"
        )
    return remarks


def _tasks(recorded: Recorded, pieces: Sequence[Piece], schedule: Schedule) -> Iterator[Task]:
    """A task for each piece."""
    tares = schedule.covariates.get("tare_after_N")
    after = {} if tares is None else dict(zip(schedule.trial, tares, strict=True))
    root, known = recorded.root, dict(recorded.digests)
    # a file that many trials share is hashed once, here, and not by every worker
    for path in {p.paths[0] for p in pieces if len(p.trials) > len({*p.paths})}:
        digest_of(root, source_of(root, path), known)
    for piece in pieces:
        names = [source_of(root, path) for path in piece.paths]
        yield Task(
            root=root,
            campaign=recorded.campaign,
            piece=piece,
            tare_after_N={trial: after[trial] for trial in piece.trials if trial in after},
            inputs={name: known[name] for name in names if name in known},
        )


def _mark_pending(recorded: Recorded, sources: Sequence[str], codes: list[tuple[str, ...]]) -> None:
    """Mark the trials of files that were still being written PENDING; refuse what many trials rest
    on where it was changed while it was read.
    """
    changed, young = _moving(recorded)
    owners: dict[str, list[int]] = {name: [] for name in (*changed, *young)}
    for i, source in enumerate(sources):
        if source in owners:
            owners[source].append(i)
    for name in changed:
        if len(owners[name]) != 1 and not (owners[name] and recorded.campaign.cuts_records):
            raise InputRefused(
                str(recorded.root / name),
                "was changed while it was being read",
                "run again when it is complete",
            )
    late = {i for name in changed for i in owners[name]}
    cut = {"truncated", "MALFORMED"}
    late |= {i for name in young for i in owners[name] if not cut.isdisjoint(codes[i])}
    for i in late:
        codes[i] = (*codes[i], "PENDING")


def _moving(recorded: Recorded) -> tuple[list[str], list[str]]:
    """Files that changed since they were hashed, and those so young that they may still grow."""
    changed, young = [], []
    now, folder = time.time_ns(), recorded.root.as_posix()
    for name, stamp in recorded.stamps.items():
        try:
            status = os.stat(f"{folder}/{name}")  # noqa: PTH116 - paths made one by one take longer
        except OSError:
            changed.append(name)
            continue
        if (status.st_size, status.st_mtime_ns) != stamp:
            changed.append(name)
        elif abs(now - status.st_mtime_ns) < WRITING_NS:
            young.append(name)
    return changed, young
