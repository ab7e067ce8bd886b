"""Products read for forecasts, and files written of them; the forecasts are made in `planning`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from nearlift.errors import UsageError
from nearlift.run import tables
from nearlift.run.engine import Job
from nearlift.stages.diagnose import findings
from nearlift.stages.fit import RESULTS
from nearlift.stages.ingest import TRIALS

if TYPE_CHECKING:
    from nearlift.planning.question import VisitQuestion
    from nearlift.results.answers import DesignOutlook, EffectAccount, NextVisits
    from nearlift.schedule import Schedule

SCHEDULE = "trials.csv"


def design(job: Job, write: Path | None = None) -> DesignOutlook:
    """Forecast of a planned campaign, written with a random schedule: into the file or folder
    `write`, else ``reports/<campaign>/design/trials.csv``.

    Raises
    ------
    UsageError
        There is no plan, or `write` names a file that exists.
    NotConverged
        No boundary has enough planned trials.
    """
    from nearlift.planning.design import design
    from nearlift.planning.plans import plan, schedule_text

    target = job.reports / "design" / SCHEDULE if write is None else _target(write)
    made = plan(job.campaign, _listed(job), job.seed)
    outlook, drawn = design(job.campaign, made, job.seed, str(target))
    tables.write_whole(target, schedule_text(drawn, job.campaign).encode())
    job.put("reports/design/design.json", tables.json_bytes(outlook))
    return outlook


def _listed(job: Job) -> tuple[Schedule, str] | None:
    """Schedule in the campaign's folder and its name; None where it lists no trial."""
    from nearlift.schedule import read_schedule, schedule_file

    path = schedule_file(job.campaign, job.root)
    text = path.read_text(encoding="utf-8-sig", errors="replace") if path.is_file() else ""
    # the first line is the header
    if sum(bool(line.strip()) for line in text.splitlines()) < 2:
        return None
    return read_schedule(job.campaign, job.root), path.name


def _target(write: Path) -> Path:
    """File for the schedule; refused where it exists."""
    path = write / SCHEDULE if write.is_dir() else write
    if path.exists():
        raise UsageError(
            str(path),
            "exists",
            "name another file; a schedule that may have been run is never overwritten",
        )
    return path


def explain(job: Job, name: str) -> EffectAccount:
    """Account of one effect; see `planning.explain.explain`."""
    from nearlift.planning.explain import explain

    trials, diagnoses = job.read(TRIALS), findings(job.processed)
    return explain(name, trials, job.campaign, diagnoses, job.seed)


def next_visits(
    job: Job, asked: VisitQuestion, count: int = 10
) -> tuple[tuple[NextVisits, ...], tuple[str, ...]]:
    """Next visits at each boundary, and reasons where there are none; see
    `planning.next_visits.plan_visits`.
    """
    from nearlift.planning.next_visits import plan_visits
    from nearlift.results.quotation import Results

    quoted = tables.load_if_whole(job.processed / RESULTS.file, Results(boundaries={}))
    trials, diagnoses = job.read(TRIALS), findings(job.processed)
    return plan_visits(asked, trials, job.campaign, diagnoses, quoted, job.seed, count)


def next_rows(job: Job, batches: Sequence[NextVisits]) -> str:
    """Visits as further rows of the campaign's own schedule, CSV."""
    from nearlift.planning.plans import further_rows
    from nearlift.schedule import read_columns

    columns, _ = read_columns(job.campaign, job.root)
    return further_rows(batches, job.read(TRIALS), job.campaign, columns)
