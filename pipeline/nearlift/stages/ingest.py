"""Ingest: records to one row per trial. Every trial of the schedule has a row; a rejected one says
why.
"""

from __future__ import annotations

import difflib
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nearlift import readers
from nearlift.errors import InputRefused, ManifestError, NearliftError
from nearlift.manifest.campaign import Campaign
from nearlift.products import TRIALS
from nearlift.readers.files import source_of
from nearlift.readers.row import Row, row_of
from nearlift.readers.schedule import Schedule, read_schedule, schedule_file
from nearlift.readers.seam import MARK, Piece, Reader
from nearlift.reduction import outliers, plausibility, quality
from nearlift.reduction.conditions import Conditions, Limits
from nearlift.reduction.record import Reduced, prepare
from nearlift.run import copies, intact, store
from nearlift.run.executors import Threads, ordered
from nearlift.run.job import Job, Outcome
from nearlift.stages import sums

#: What a manifest says wrong if all records carry a code.
MISDESCRIBED = {
    "NO_DATA": "; mend tare, settle or sample_rate under [load_cell]",
    "TOO_SHORT": "; mend tare, settle or sample_rate under [load_cell]",
    "TARE": "; is tare too long, or sample_rate wrong, under [load_cell]?",
    "MIXED": "; is tare too short, or sample_rate wrong, under [load_cell]?",
    "SATURATED": "; mend range under [load_cell], or the unit under [records] force",
    "STUCK": (
        '; is force under [records] the right column? a cell that zeroes itself has tare = "0 s",'
        " and settle for its head"
    ),
}
#: Samples of a tare that show whether it is one level.
FEW_OF_TARE = 20
#: Bytes of a record from which on threads are worth their turns.
WORTH_A_THREAD = 1 << 20
#: Characters of a fault that are kept.
LONGEST_FAULT = 300


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """What one worker is sent: a piece of the plan, and what it needs to reduce it."""

    root: Path
    campaign: Campaign
    piece: Piece
    tare_after_N: Mapping[str, float]
    inputs: Mapping[str, str]


class Rows:
    """The answers for n trials, column by column in run order, so that a trial's memory is that of
    its numbers.

    A trial without an answer is MISSING.
    """

    def __init__(self, n: int) -> None:
        self.real = {
            name: np.full(n, np.nan)
            for name in ("lift_N", "u_lift_N", "n_eff", "drift_N_s", "sd_N")
        }
        self.n, self.samples = (np.zeros(n, dtype=np.int64) for _ in range(2))
        self.codes: list[tuple[str, ...]] = [("MISSING",)] * n
        self.source_sha256, self.source, self.fault = (
            np.full(n, "", dtype=object) for _ in range(3)
        )
        #: Each remark with the number of records that it is about, and the first of them.
        self.notes: dict[str, tuple[int, str]] = {}

    def put(self, i: int, row: Row) -> None:
        """The answer for trial i."""
        for name, column in self.real.items():
            column[i] = getattr(row.reduced, name)
        self.n[i], self.samples[i] = row.reduced.n, row.samples
        self.codes[i] = row.reduced.codes
        self.source_sha256[i], self.source[i], self.fault[i] = (
            row.source_sha256,
            row.source,
            row.fault,
        )
        for note in row.notes:
            count, first = self.notes.get(note, (0, row.source))
            self.notes[note] = count + 1, first

    def reject(self, faults: Mapping[str, str]) -> None:
        """Make the trials of these files MALFORMED, with what is wrong with each."""
        for i, source in enumerate(self.source.tolist() if faults else ()):
            if source in faults:
                self.codes[i] = tuple(dict.fromkeys((*self.codes[i], "MALFORMED")))
                self.fault[i] = faults[source]


def inputs(root: Path, campaign: Campaign) -> list[str]:
    """Every file that trials.parquet is made from, relative to the campaign's folder: manifest,
    schedule, lists of sums, records.

    Raises
    ------
    NearliftError
        As `run` does for a manifest or a schedule that cannot be read.
    """
    reader = readers.reader(campaign.records.reader)
    schedule = read_schedule(campaign, root)
    records = reader.files(campaign, root, list(schedule.trial))
    return [
        source_of(root, path)
        for path in (
            root / "campaign.toml",
            schedule_file(campaign, root),
            *sums.files(root, campaign),
            *records,
        )
    ]


def soon(campaign: Campaign, workers: int) -> None:
    """Make ready, while files are digested, what reads the records: machine code, or the processes
    that will, and then what writes tables.
    """
    reader = readers.reader(campaign.records.reader)
    if not reader.series:
        return
    in_child = reader.format is not None and reader.format.child
    if not in_child or reader.reduce_piece is not None:
        prepare()
    if in_child and workers:
        from nearlift.readers import child

        child.start(workers)
        # it begins a thread, after which no copies of this process are made
        store.ready()


def run(job: Job) -> Outcome:
    """Write trials.parquet.

    Raises
    ------
    NearliftError
        The schedule or the records are refused, no trial has a record, or none is good. Nothing is
        written then.
    """
    campaign = job.campaign
    reader = readers.reader(campaign.records.reader)
    intact.not_rotten(job)
    schedule = read_schedule(campaign, job.root)
    _known(campaign.quality.exclude, schedule)
    checked = _checked(job)
    notes = [*schedule.notes, *checked.notes]
    if reader.series:
        rows, more = _from_records(job, reader, schedule)
        notes += more
    else:
        rows = _from_means(job, schedule)
    rows.reject(checked.faults)
    _settle(job, rows)
    table = _table(schedule, rows, campaign)
    notes += _judge(table, campaign)
    if asked := campaign.quality.exclude:
        trials = ", ".join(f"{trial} ({why})" if why else trial for trial, why in asked.items())
        notes.append(f"left out as [quality] exclude asks: {trials}")
    notes += quality.remarks(table["quality"])
    bad = quality.rejected(table["quality"])
    if bad.all():
        # where the unit is at fault, say so, rather than that the cell was at its end
        unit, key = _unit(campaign)
        blank = {**table, "quality": np.full(len(bad), "", dtype=object)}
        plausibility.against_weight(blank, campaign.vehicle.mass * campaign.rig.gravity, unit, key)
        told = Counter(code for text in table["quality"] for code in text.split() if code.isupper())
        reasons = ", ".join(f"{code} {count}" for code, count in told.most_common())
        worst = quality.code(told.most_common(1)[0][0])
        raise InputRefused(
            str(job.root),
            f"all {len(bad)} trials are rejected ({reasons})",
            f"{worst.name}: {worst.meaning}{MISDESCRIBED.get(worst.name, '')}",
        )
    job.write(TRIALS, table)
    faults = np.flatnonzero(quality.faulty(table["quality"]))
    rejected = tuple(
        (str(table["trial"][i]), quality.reason(table["quality"][i], table["fault"][i]))
        for i in faults
    )
    return Outcome(rejected=rejected, notes=tuple(notes))


def _checked(job: Job) -> sums.Checked:
    """What SHA256SUMS says against the files, where there is one."""
    lists = {source_of(job.root, path) for path in sums.files(job.root, job.campaign)}
    if not lists:
        return sums.Checked()
    names = [name for name in inputs(job.root, job.campaign) if name not in lists]
    each = MARK in (job.campaign.records.files or "")
    return sums.check(job, names[:2] if each else names, names[2:] if each else [])


def _known(exclude: Mapping[str, str], schedule: Schedule) -> None:
    """See that every trial that the manifest excludes is in the schedule.

    Raises
    ------
    ManifestError
        One is not; ids like it are proposed.
    """
    ids = schedule.trial.tolist()
    for trial in sorted(exclude.keys() - set(ids)):
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
    """Rows from as many workers as the executor has; a trial without a record has none.

    Raises
    ------
    InputRefused
        No trial has a record, or most records cannot be read for what the manifest says of them:
        the first one's refusal.
    """
    plan = reader.plan(job.campaign, job.root, list(schedule.trial))
    recorded = sum(len(piece.trials) for piece in plan.pieces)
    if not recorded:
        raise InputRefused(
            str(job.root / (job.campaign.records.files or "")),
            f"none of the {len(schedule)} trials has a record",
            f"the first would be that of trial {schedule.trial[0]!r}; check [records] files",
        )
    after = (
        dict(zip(schedule.trial, schedule.covariates["tare_after_N"], strict=True))
        if "tare_after_N" in schedule.covariates
        else {}
    )
    place = {trial: i for i, trial in enumerate(schedule.trial)}
    rows, done = Rows(len(schedule)), 0
    notes, pieces = plan.notes, deque(plan.pieces)
    refusals: list[InputRefused] = []
    # the plan of what is done is not kept beside what was found
    del plan
    for answer in _answers(job, reader, pieces, after):
        for row in answer:
            rows.put(place[row.trial], row)
            refusals += [row.refusal] if row.refusal else []
        done += len(answer)
        # one record is damaged, most of them are misdescribed
        if 2 * len(refusals) > recorded:
            raise refusals[0]
        job.say(f"ingest {done} of {len(schedule)} trials")
        # while others reduce
        store.ready()
    told = [
        note if count == 1 else f"{note} ({count} records, such as {first})"
        for note, (count, first) in rows.notes.items()
    ]
    if job.campaign.load_cell.tare == "none":
        told.append(
            "the records have no tare: the zero of the force is unknown and wants an"
            ' [[uncertainty]] on = "force"'
        )
    samples = round(job.campaign.tare_s * (job.campaign.load_cell.sample_rate or 0.0))
    if 0 < samples < FEW_OF_TARE:
        told.append(
            f"the tares have {samples} samples: too few to show damage of more than one of them"
            f" ({FEW_OF_TARE} would)"
        )
    return rows, [*notes, *told]


def _answers(
    job: Job, reader: Reader, pieces: deque[Piece], after: Mapping[str, float]
) -> Iterator[list[Row]]:
    """The rows of each piece; over small records, threads of one interpreter lose more by taking
    turns than they gain.
    """
    records, size = sum(len(piece.trials) for piece in pieces), sum(piece.bytes for piece in pieces)
    tasks = _tasks(job, pieces, after)
    if (
        not isinstance(job.executor, Threads)
        or reader.reduce_piece is not None
        or size >= WORTH_A_THREAD * records
    ):
        return ordered(job.executor, reduce_piece, tasks)
    return copies.shared_out(
        reduce_piece, list(tasks), job.executor.workers if copies.alone() else 1
    )


def _tasks(job: Job, pieces: deque[Piece], after: Mapping[str, float]) -> Iterator[Task]:
    whole = {
        piece.paths[0]: "" for piece in pieces if len(piece.paths) == 1 and len(piece.trials) > 1
    }
    # a file that many trials share is hashed once, here, and not by every worker
    shared = {
        source: job.inputs.get(source) or store.sha256(path)
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
            if len(rows) == len(task.piece.trials) or not _of_the_record(fault):
                raise
            rows.append(_malformed(task, len(rows), fault, digests))
        piece = _behind(task.piece, len(rows))
    return rows


def _rows(task: Task, piece: Piece, digests: dict[str, str]) -> Iterator[Row]:
    """The rows of a piece, by the process that reads it; `digests` grows by those of its files."""
    campaign, choice = task.campaign, task.campaign.quality
    conditions = Conditions(
        rate_Hz=campaign.load_cell.sample_rate or 1.0,
        tare_s=campaign.tare_s,
        settle_s=campaign.load_cell.settle,
        limits=Limits(
            drift=choice.drift,
            missing=choice.missing,
            out_of_range=choice.out_of_range,
            range_N=campaign.load_cell.range,
        ),
    )
    reader = readers.reader(campaign.records.reader)
    if reader.reduce_piece is not None:
        for row in reader.reduce_piece(campaign, task.root, piece, conditions, task.tare_after_N):
            yield replace(row, source_sha256=_digest(task, row.source, digests))
        return
    for record in reader.read_piece(campaign, task.root, piece):
        if record.sha256 and record.source not in digests:
            digests[record.source] = record.sha256()
        row = row_of(
            record,
            conditions,
            task.tare_after_N.get(record.trial, np.nan),
            _digest(task, record.source, digests),
        )
        yield row


def _digest(task: Task, source: str, digests: dict[str, str]) -> str:
    if source not in digests:
        digests[source] = store.sha256(task.root / source)
    return digests[source]


def _malformed(task: Task, i: int, fault: Exception, digests: dict[str, str]) -> Row:
    """The row of trial i of a piece, over whose record `fault` was raised."""
    path = task.piece.paths[i if len(task.piece.paths) > 1 else 0]
    source = source_of(task.root, path)
    if source not in digests:
        digests[source] = store.sha256(path)
    what = (
        f"{fault.where}: {fault.what}"
        if isinstance(fault, NearliftError)
        else f"{source}: {type(fault).__name__}: {fault}"
    )
    text = " ".join(what.replace(f"{task.root}/", "").split())[:LONGEST_FAULT]
    return Row(
        trial=task.piece.trials[i],
        reduced=Reduced(codes=("MALFORMED",)),
        source_sha256=digests[source],
        source=source,
        fault="".join(c if c.isprintable() else "?" for c in text),
        refusal=fault if isinstance(fault, InputRefused) else None,
    )


def _of_the_record(fault: Exception) -> bool:
    """Whether the bytes of a record are to blame, and not the manifest or the machine (libraries
    call damage an OSError without a number).
    """
    if isinstance(fault, OSError):
        return fault.errno is None
    return isinstance(fault, InputRefused) or not isinstance(fault, (NearliftError, MemoryError))


def _behind(piece: Piece, done: int) -> Piece:
    """What is left of a piece behind so many of its trials."""
    return replace(
        piece,
        trials=piece.trials[done:],
        paths=piece.paths[done:] if len(piece.paths) == len(piece.trials) else piece.paths,
        rows=piece.rows[done:],
    )


def _settle(job: Job, rows: Rows) -> None:
    """Mark the trials of files that were still being written PENDING.

    Raises
    ------
    InputRefused
        The manifest, the schedule or a file of many trials was changed while it was read.
    """
    moving = intact.moving(job)
    asked = {*moving.changed, *moving.young}
    owners: dict[str, list[int]] = {name: [] for name in asked}
    for i, source in enumerate(rows.source.tolist()):
        if source in asked:
            owners[source].append(i)
    for name in moving.changed:
        if len(owners[name]) != 1:
            raise InputRefused(
                str(job.root / name),
                "was changed while it was being read",
                "run again when nobody writes it any more",
            )
    late = {owners[name][0] for name in moving.changed}
    late |= {
        i
        for name in moving.young
        for i in owners[name]
        if not {"truncated", "MALFORMED"}.isdisjoint(rows.codes[i])
    }
    for i in late:
        rows.codes[i] = (*rows.codes[i], "PENDING")


def _from_means(job: Job, schedule: Schedule) -> Rows:
    from nearlift.readers import means

    path = schedule_file(job.campaign, job.root)
    source = path.relative_to(job.root).as_posix()
    lift = means.lift_of(schedule)
    rows = Rows(len(schedule))
    rows.real |= {name: lift[name].astype(float) for name in ("lift_N", "u_lift_N", "sd_N")} | {
        "n_eff": lift["n"].astype(float)
    }
    rows.n, rows.samples = (lift["n"].astype(np.int64) for _ in range(2))
    rows.codes = [()] * len(schedule)
    rows.source[:], rows.source_sha256[:] = source, job.inputs.get(source) or store.sha256(path)
    return rows


def _table(schedule: Schedule, rows: Rows, campaign: Campaign) -> store.Table:
    """The columns of trials.parquet in run order, with the codes that need no other trial and those
    of length.
    """
    codes = [list(own) for own in rows.codes]
    if campaign.records.reader != "means":
        cell = campaign.load_cell
        planned = None
        if cell.record and cell.sample_rate:
            planned = round(cell.record * cell.sample_rate)
            plausibility.planned_length(
                rows.samples, cell.record, cell.sample_rate, campaign.quality.missing
            )
        plausibility.lengths(rows.n, codes, campaign.quality.missing, rows.samples, planned)
        _duplicates(rows, codes)
    if schedule.reached_m is not None:
        off = (
            np.abs(schedule.reached_m - schedule.z_m)
            > campaign.quality.height * campaign.vehicle.rotor_radius
        )
        for own, lost in zip(codes, off, strict=True):
            own += ["HEIGHT"] if lost else []
    for i, trial in enumerate(schedule.trial):
        if trial in campaign.quality.exclude:
            codes[i].append(quality.EXCLUDED)
            rows.fault[i] = "; ".join(
                filter(None, (rows.fault[i], campaign.quality.exclude[trial]))
            )
    texts = [quality.joined(c) for c in codes]
    return {
        "trial": schedule.trial,
        "boundary": schedule.boundary,
        "z_hat": schedule.z_hat,
        "z_m": schedule.z_m,
        "throttle": schedule.throttle,
        **rows.real,
        "n": rows.n,
        "quality": np.array(texts, dtype=object),
        "visit": schedule.visit,
        "source_sha256": rows.source_sha256,
        "source": rows.source,
        "samples": rows.samples,
        "completeness": np.array([quality.completeness(text) for text in texts], dtype=object),
        "fault": rows.fault,
        **schedule.covariates,
    }


def _duplicates(rows: Rows, codes: Sequence[list[str]]) -> None:
    """Reject a trial whose file is that of an earlier one; trials of one long table are told apart
    by their numbers.
    """
    seen: set[tuple[str, float, float]] = set()
    for i in np.flatnonzero(rows.n).tolist():
        key = (rows.source_sha256[i], float(rows.real["lift_N"][i]), float(rows.real["sd_N"][i]))
        if key in seen:
            codes[i].append("DUPLICATE")
        seen.add(key)


def _same(table: store.Table) -> list[str]:
    """Whose record each duplicate is."""
    notes: list[str] = []
    first: dict[tuple[str, float], str] = {}
    for trial, sha, lift, text in zip(
        table["trial"],
        table["source_sha256"],
        table["lift_N"].tolist(),
        table["quality"],
        strict=True,
    ):
        owner = first.setdefault((sha, lift), trial)
        if "DUPLICATE" in text.split():
            notes.append(f"the record of {trial} is that of {owner}, byte for byte")
    return notes


def _mark(table: store.Table, name: str, found: NDArray[np.bool_]) -> None:
    """Add a quality code to the trials found."""
    table["quality"] = np.array(
        [
            quality.joined([*text.split(), name]) if f else text
            for text, f in zip(table["quality"], found, strict=True)
        ],
        dtype=object,
    )


def _unit(campaign: Campaign) -> tuple[str, str]:
    """The unit that forces were read in, and the key where it stands."""
    series = campaign.records.force
    return (
        (series.unit, "records.force.unit")
        if series is not None
        else (campaign.trials.units.get("lift", "N"), "trials.units.lift")
    )


def _judge(table: store.Table, campaign: Campaign) -> list[str]:
    """What only the whole campaign shows: refusals, further codes in `table`, and notes."""
    weight = campaign.vehicle.mass * campaign.rig.gravity
    unit, key = _unit(campaign)
    plausibility.against_weight(table, weight, unit, key)
    _mark(table, "IMPLAUSIBLE", plausibility.implausible(table["lift_N"], weight))
    _mark(table, "NO_LIFT", plausibility.without_lift(table))
    _mark(table, "other_throttle", plausibility.other_throttle(table))
    notes = [
        *_same(table),
        *plausibility.odd_weight(table, weight, unit, key),
        *plausibility.mostly_unsettled(table),
    ]
    notes += plausibility.overstated(table, campaign)
    for side in dict.fromkeys(table["boundary"].tolist()):
        notes += _outlying(table, side)
    for side, lower, upper, below, above in plausibility.not_rising(table):
        here = (table["boundary"] == side) & (table["throttle"] == upper)
        far = here & (table["z_hat"] == table["z_hat"][here].max())
        table["quality"][far] = [
            quality.joined([*text.split(), "not_rising"]) for text in table["quality"][far]
        ]
        place = f"far from the {side}" if side != "none" else "in free air"
        step = f"{below:.4g} N at {100 * lower:.4g} %, {above:.4g} N at {100 * upper:.4g} %"
        notes.append(
            f"{place} the lift does not rise with throttle: {step} (battery, order of the sweep, or"
            " a wrong label?)"
        )
    return notes


def _outlying(table: store.Table, side: str) -> list[str]:
    """Mark the trials at one boundary that repeats and neighbours contradict, and say of each how
    far off it is.
    """
    mine = np.flatnonzero(
        (table["boundary"] == side) & ~quality.rejected(table["quality"]) & (table["lift_N"] > 0)
    )
    z_hat, throttle, visit = (table[name][mine] for name in ("z_hat", "throttle", "visit"))
    found = outliers.screen(np.log(table["lift_N"][mine]), z_hat, throttle, visit)
    mask = np.zeros(len(table["quality"]), dtype=bool)
    mask[mine[found.outlying]] = True
    _mark(table, "outlying", mask)
    return [
        f"{table['trial'][mine[i]]} lifts {100 * np.expm1(found.departure[i]):+.3g} % against its"
        f" repeats and neighbours, {abs(found.sigmas[i]):.0f} times their scatter: noise does not"
        " reach so far; look at its record and its row"
        for i in np.flatnonzero(found.outlying)
    ]
