"""Records to one row for every trial of the schedule; a rejected one says why."""

from __future__ import annotations

import contextlib
import difflib
import os
import time
from collections import Counter, deque
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from nearlift import readers
from nearlift.campaign.manifest import Campaign
from nearlift.campaign.rig import RECORD_MARK
from nearlift.errors import InputRefused, ManifestError, NearliftError
from nearlift.readers import ramp
from nearlift.readers.base import Reader
from nearlift.readers.files import MARK, Piece, per_trial, source_of
from nearlift.readers.guarded import Malformed
from nearlift.reduction import plausibility, quality
from nearlift.run.engine import Job, Outcome
from nearlift.run.tables import Table, sha256
from nearlift.run.workers import ordered
from nearlift.schedule import Schedule, read_schedule, schedule_file
from nearlift.stages import judge, segments
from nearlift.stages.rows import Rows, Task, reduce_piece

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


def inputs(root: Path, campaign: Campaign) -> list[str]:
    """Every file that trials.parquet is made from, relative to the campaign's folder: schedule and
    records.

    Raises
    ------
    NearliftError
        The schedule cannot be read.
    """
    reader = readers.reader(campaign.records.reader)
    schedule = read_schedule(campaign, root)
    trials = list(schedule.trial)
    records = (
        [path for path, _ in per_trial(campaign, root, trials).values()]
        if campaign.cuts_records
        else reader.files(campaign, root, trials)
    )
    return [source_of(root, path) for path in (schedule_file(campaign, root), *records)]


def reduced_records(job: Job) -> tuple[Table, Outcome]:
    """The table of trials, with those that are rejected and notes.

    Raises
    ------
    NearliftError
        The schedule or the records are refused, no trial has a record, or none is good.
    """
    campaign = job.campaign
    reader = readers.reader(campaign.records.reader)
    schedule = read_schedule(campaign, job.root)
    if not campaign.cuts_records:
        _known(campaign.quality.exclude, schedule)
    notes = list(schedule.notes)
    swept: list[str] = []
    if reader.series:
        if not campaign.cuts_records:
            rows, more = _from_records(job, reader, schedule)
        else:
            schedule, rows, more = segments.from_records(job, reader, schedule)
            _known(campaign.quality.exclude, schedule, by_record=True)
        notes += [*more, *_of_the_tare(campaign), *(swept := _swept(job, reader, schedule, rows))]
    else:
        rows = _from_means(job, schedule)
    _settle(job, rows)
    table = judge.table_of(schedule, rows, campaign)
    notes += judge.judge(table, campaign)
    if asked := campaign.quality.exclude:
        trials = ", ".join(f"{trial} ({why})" if why else trial for trial, why in asked.items())
        notes.append(f"left out as [quality] exclude asks: {trials}")
    notes += quality.remarks(table["quality"])
    bad = quality.rejected(table["quality"])
    if bad.all():
        # where the unit is at fault, say so, rather than that the cell was at its end
        unit, key = judge.unit_of(campaign)
        blank = {**table, "quality": np.full(len(bad), "", dtype=object)}
        weight = campaign.vehicle.mass * campaign.rig.gravity
        plausibility.against_weight(blank, weight, unit, key)
        counts = Counter(
            code for text in table["quality"] for code in text.split() if code.isupper()
        )
        reasons = ", ".join(f"{code} {count}" for code, count in counts.most_common())
        worst = quality.code(counts.most_common(1)[0][0])
        remedy = MISDESCRIBED.get(worst.name, "")
        # what is wrong with the first says more than what the code means
        fault = next((f for f in table["fault"] if f), "") if worst.name == "MALFORMED" else ""
        raise InputRefused(
            str(job.root),
            f"all {len(bad)} trials are rejected ({reasons})",
            *(swept or [f"{worst.name}: {fault or worst.meaning}{remedy}"]),
        )
    rejected = tuple(
        (str(table["trial"][i]), quality.reason(table["quality"][i], table["fault"][i]))
        for i in np.flatnonzero(quality.faulty(table["quality"]))
    )
    return table, Outcome(rejected=rejected, notes=tuple(notes))


def _known(exclude: Mapping[str, str], schedule: Schedule, by_record: bool = False) -> None:
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


def _from_records(job: Job, reader: Reader, schedule: Schedule) -> tuple[Rows, list[str]]:
    """Rows from as many workers as the executor has. Refused where no trial has a record, or where
    most cannot be read for what the manifest says of them: the first one's refusal.
    """
    plan = reader.plan(job.campaign, job.root, list(schedule.trial))
    recorded = sum(len(piece.trials) for piece in plan.pieces)
    if not recorded:
        raise InputRefused(
            str(job.root / (job.campaign.records.files or "")),
            f"none of the {len(schedule)} trials has a record",
            f"the first would be that of trial {schedule.trial[0]!r}; check [records] files",
        )
    tares = schedule.covariates.get("tare_after_N")
    after = {} if tares is None else dict(zip(schedule.trial, tares, strict=True))
    place = {trial: i for i, trial in enumerate(schedule.trial)}
    rows, done = Rows(len(schedule)), 0
    notes, pieces = plan.notes, deque(plan.pieces)
    refusals: list[InputRefused] = []
    # the plan of what is done is not kept beside what was found
    del plan
    for answer in ordered(job.executor, reduce_piece, _tasks(job, pieces, after)):
        for row in answer:
            rows.put(place[row.trial], row)
            refusals += [row.refusal] if row.refusal else []
        done += len(answer)
        # one record is damaged, most of them are misdescribed
        if 2 * len(refusals) > recorded:
            raise refusals[0]
        job.say(f"ingest {done} of {len(schedule)} trials", done / len(schedule))
    return rows, [*notes, *rows.remarks()]


def _swept(job: Job, reader: Reader, schedule: Schedule, rows: Rows) -> list[str]:
    """Remark on records that sweep the throttle but are given as one trial each, with the lines
    that would cut them. Their rows become MIXED.
    """
    if job.campaign.cuts_records or job.campaign.records.pattern.find(MARK) < 0:
        return []
    wide = rows.columns["sd_N"] > SWEEP * np.abs(rows.columns["lift_N"])
    place = {str(schedule.trial[i]): i for i in np.flatnonzero(wide).tolist()}
    sweeps: dict[str, ramp.Ramp] = {}
    for k, (trial, (path, _)) in enumerate(per_trial(job.campaign, job.root, [*place]).items()):
        if k == FEW_SWEEPS and not sweeps:
            break
        with contextlib.suppress(NearliftError, Malformed):
            swept = ramp.of_file(job.campaign, reader, trial, path)
            sweeps |= {} if swept is None else {trial: swept}
    if not sweeps:
        return []
    for i in (place[trial] for trial in sweeps):
        rows.codes[i] = tuple(dict.fromkeys((*rows.codes[i], "MIXED")))
    trial, first = next(iter(sweeps.items()))
    more = f" (and {len(sweeps) - 1} more like it)" if len(sweeps) > 1 else ""
    remark = (
        f"the record of {trial}{more} {first.words}; to cut it into trials write {RECORD_MARK} for"
        f" {MARK} in [records] files, call the column of ids in {job.campaign.trials.file} record,"
        f" and add\n{first.segments}`nearlift inspect --cuts CAMPAIGN` then draws where it is cut"
    )
    return [remark]


def _of_the_tare(campaign: Campaign) -> list[str]:
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


def _tasks(job: Job, pieces: deque[Piece], after: Mapping[str, float]) -> Iterator[Task]:
    whole = {
        piece.paths[0]: "" for piece in pieces if len(piece.paths) == 1 and len(piece.trials) > 1
    }
    # a file that many trials share is hashed once, here, and not by every worker
    shared = {
        source: job.inputs.get(source) or sha256(path)
        for path in whole
        for source in [source_of(job.root, path)]
    }
    while pieces:
        piece = pieces.popleft()
        sources = [source_of(job.root, path) for path in piece.paths]
        yield Task(
            root=job.root,
            campaign=job.campaign,
            piece=piece,
            tare_after_N={trial: after[trial] for trial in piece.trials if trial in after},
            inputs={s: digest for s in sources if (digest := shared.get(s) or job.inputs.get(s))},
        )


def _settle(job: Job, rows: Rows) -> None:
    """Mark the trials of files that were still being written PENDING; refuse what many trials rest
    on where it was changed while it was read.
    """
    changed, young = _moving(job)
    asked = {*changed, *young}
    owners: dict[str, list[int]] = {name: [] for name in asked}
    for i, source in enumerate(rows.columns["source"].tolist()):
        if source in asked:
            owners[source].append(i)
    for name in changed:
        one = len(owners[name]) == 1 or (owners[name] and job.campaign.cuts_records)
        if not one:
            raise InputRefused(
                str(job.root / name),
                "was changed while it was being read",
                "run again when it is complete",
            )
    late = {i for name in changed for i in owners[name]}
    late |= {
        i
        for name in young
        for i in owners[name]
        if not {"truncated", "MALFORMED"}.isdisjoint(rows.codes[i])
    }
    for i in late:
        rows.codes[i] = (*rows.codes[i], "PENDING")


def _moving(job: Job) -> tuple[list[str], list[str]]:
    """Files that changed since they were hashed, and those so young that they may still grow."""
    changed, young = [], []
    now, folder = time.time_ns(), job.root.as_posix()
    for name, stamp in job.stamps.items():
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


def _from_means(job: Job, schedule: Schedule) -> Rows:
    from nearlift.readers import means

    path = schedule_file(job.campaign, job.root)
    source = path.relative_to(job.root).as_posix()
    lift = means.lift_of(schedule)
    rows = Rows(len(schedule))
    rows.columns |= {
        **{name: lift[name].astype(float) for name in ("lift_N", "u_lift_N", "sd_N")},
        "n_eff": lift["n"].astype(float),
        **{name: lift["n"].astype(np.int64) for name in ("n", "samples")},
    }
    rows.columns["source"][:] = source
    rows.columns["source_sha256"][:] = job.inputs.get(source) or sha256(path)
    rows.codes = [()] * len(schedule)
    return rows
