"""Results of a campaign in a line, for `run` of one or many campaigns and for `run --watch`."""

from __future__ import annotations

import contextlib

from nearlift.errors import NearliftError
from nearlift.planning.question import VisitQuestion
from nearlift.reduction.quality import rejected
from nearlift.report.phrases import claim, coefficient_text
from nearlift.results.diagnosis import NOTHING, BoundaryDiagnosis
from nearlift.results.quotation import Results
from nearlift.run import tables
from nearlift.run.engine import Job
from nearlift.run.watch import Round
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import RESULTS
from nearlift.stages.forecasts import next_visits
from nearlift.stages.ingest import TRIALS


def answers(job: Job) -> dict[str, str]:
    """Answers of the products on disk, in words: accepted trials, then for each boundary its first
    coefficient and verdict.

    Where trials are still to come, the threshold of a claim is added.
    """
    words = {}
    # a table that is missing or damaged is about to be written again
    with contextlib.suppress(NearliftError):
        good, scheduled = _trials(job)
        words["trials"] = f"{good} of {scheduled} accepted"
    diagnosed = tables.load_if_whole(job.processed / DIAGNOSIS.file, NOTHING).boundaries
    quoted = tables.load_if_whole(job.processed / RESULTS.file, Results(boundaries={})).boundaries
    for boundary, result in quoted.items():
        at, name = diagnosed.get(boundary), result.headline
        number = [coefficient_text(result.coefficients[name], name)] if name else []
        interim = at.look if isinstance(at, BoundaryDiagnosis) else None
        verdict = claim(result, at) + (f" ({interim.text})" if interim else "")
        words[boundary] = ", ".join([*number, verdict])
    return words


def line(job: Job) -> str:
    """One line with these answers."""
    return "; ".join(f"{name} {answer}" for name, answer in answers(job).items())


def look(asked: VisitQuestion | None, job: Job, fresh: bool) -> Round:
    """A round of `run.watch`: trials so far, what is quoted of them, and the next visits where they
    are `asked` for and results are `fresh`.
    """
    good, scheduled = _trials(job)
    return Round(
        good=good,
        scheduled=scheduled,
        planned=job.campaign.diagnose.planned_trials is not None,
        words=line(job),
        next=visits(asked, job) if asked and fresh else (),
    )


def _trials(job: Job) -> tuple[int, int]:
    """Number of accepted trials, and of all."""
    quality = job.read(TRIALS)["quality"]
    return len(quality) - int(rejected(quality).sum()), len(quality)


def visits(asked: VisitQuestion, job: Job) -> tuple[str, ...]:
    """The next visits, or why there are none to propose."""
    from nearlift.report import visits as visits_text

    try:
        batches, elsewhere = next_visits(job, asked)
    except NearliftError as refusal:
        return (f"next: {refusal.what}; {refusal.remedy}",)
    return (*(text for batch in batches for text in visits_text.brief(batch)), *elsewhere)
