"""The run that brings stale stages up to date, in order, and the plan of it."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from nearlift.run.job import Job, Outcome
from nearlift.run.lock import locked, require_free_space, swept
from nearlift.run.provenance import Provenance
from nearlift.run.registry import STAGES, stage
from nearlift.run.stage import Stage
from nearlift.run.transaction import Transaction

__all__ = ["STAGES", "Stage", "Step", "plan", "run", "stage"]

#: Bytes that figures and page take, and a trial in tables and page, both measured and rounded up.
PAGE_BYTES, TRIAL_BYTES = 12_000_000, 2_000


def _needed(job: Job, wanted: Sequence[Stage]) -> int:
    """Bytes that the stages may write: from the length of the schedule, and twice, since old
    products stand until new ones are whole.
    """
    schedule = job.root / job.campaign.trials.file
    rows = schedule.stat().st_size // 8 if schedule.is_file() else 0
    return 2 * (TRIAL_BYTES * rows + (PAGE_BYTES if any(item.report for item in wanted) else 0))


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """What happened to one stage: `why` it was stale (empty: it was not), and its outcome."""

    stage: Stage
    why: str
    outcome: Outcome
    wall_s: float = 0.0


def plan(job: Job, wanted: Sequence[Stage] = STAGES) -> Iterator[tuple[Stage, str]]:
    """Each stage with the reason for which it is stale, empty if it is up to date; runs nothing."""
    provenance = Provenance.open(job)
    upstream: dict[str, str] = {}
    for item in wanted:
        if not item.configured(job):
            continue
        why = provenance.why_stale(item)
        late = next((upstream[p.file] for p in item.reads if p.file in upstream), "")
        why = why or (f"{late} will run" if late else "")
        if why:
            upstream |= {p.file: item.name for p in item.writes}
        yield item, why


def run(
    job: Job,
    wanted: Sequence[Stage] = STAGES,
    begin: Callable[[Stage, str], None] = lambda s, w: None,
    force: bool = False,
) -> Iterator[Step]:
    """Bring the wanted stages up to date, in order; yields what happened to each."""
    with contextlib.ExitStack() as held:
        yield from _run(job, wanted, begin, force, held)


def _run(
    job: Job,
    wanted: Sequence[Stage],
    begin: Callable[[Stage, str], None],
    force: bool,
    held: contextlib.ExitStack,
) -> Iterator[Step]:
    provenance = Provenance.open(job)
    alone = False
    for item in wanted:
        if not (force or item.configured(job)):
            continue
        why = provenance.why_stale(item) or ("asked for" if force else "")
        if why and not alone:
            require_free_space(job.processed, _needed(job, wanted))
            left = held.enter_context(locked(job.homes))
            alone = True
            # another run may have ended since
            provenance = Provenance.open(job)
            why = provenance.why_stale(item) or ("asked for" if force else "")
            why = f"{why}; {left}" if why and left else why
        if not why:
            record = provenance.ledger.stages[item.name]
            yield Step(
                stage=item,
                why="",
                outcome=Outcome(rejected=record.rejected, notes=record.notes),
            )
            continue
        begin(item, why)
        material = provenance.material(item)
        start = time.perf_counter()
        with Transaction(homes=job.homes) as change:
            outcome = item.run(replace(job, change=change))
            provenance.commit(item, outcome, material, time.perf_counter() - start, change)
        wall_s = time.perf_counter() - start
        yield Step(stage=item, why=why, outcome=outcome, wall_s=wall_s)
    if not alone:
        swept(job.homes)
