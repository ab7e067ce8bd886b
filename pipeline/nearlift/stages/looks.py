"""Results of a campaign in a line, for `run` of many campaigns and for `run --watch`."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from nearlift.errors import NearliftError
from nearlift.planning.question import VisitQuestion
from nearlift.reduction.quality import rejected
from nearlift.report.phrases import claim, coefficient_text
from nearlift.results.diagnosis import NOTHING, BoundaryDiagnosis, DiagnosisResults
from nearlift.results.quotation import Results
from nearlift.run import tables
from nearlift.run.engine import Job
from nearlift.run.watch import Round
from nearlift.stages.diagnose import DIAGNOSIS, NOT_DIAGNOSED
from nearlift.stages.fit import RESULTS
from nearlift.stages.forecasts import next_visits
from nearlift.stages.ingest import TRIALS


def verdicts(job: Job) -> str:
    """The verdict of each boundary, with the explanation."""
    diagnosed = tables.load_if_whole(job.processed / DIAGNOSIS.file, NOTHING).boundaries
    quoted = tables.load_if_whole(job.processed / RESULTS.file, Results(boundaries={})).boundaries
    return ", ".join(f"{b} {claim(quoted[b], diagnosed.get(b))}" for b in quoted)


def snapshot(job: Job) -> dict[str, str]:
    """Answers of the products on disk in words, for comparison with a later run: accepted trials,
    and by boundary the first coefficient and the verdict.
    """
    words = {}
    # a table that is missing or damaged is about to be written again
    with contextlib.suppress(NearliftError):
        quality = job.read(TRIALS)["quality"]
        good = len(quality) - int(rejected(quality).sum())
        words["trials"] = f"{good} of {len(quality)} accepted"
    diagnosed = tables.load_if_whole(job.processed / DIAGNOSIS.file, NOTHING).boundaries
    quoted = tables.load_if_whole(job.processed / RESULTS.file, Results(boundaries={})).boundaries
    for boundary, result in quoted.items():
        verdict = claim(result, diagnosed.get(boundary))
        name = result.headline
        number = [coefficient_text(result.coefficients[name], name)] if name else []
        words[boundary] = ", ".join([*number, verdict])
    return words


def look(asked: VisitQuestion | None, job: Job, fresh: bool) -> Round:
    """A round of `run.watch`: trials so far, what is quoted of them, and the next visits where they
    are `asked` for and results are `fresh`.
    """
    quality = job.read(TRIALS)["quality"]
    diagnosis = tables.load_if_whole(job.processed / DIAGNOSIS.file, NOTHING)
    quoted = tables.load_if_whole(job.processed / RESULTS.file, Results(boundaries={}))
    good = len(quality) - int(rejected(quality).sum())
    return Round(
        good=good,
        scheduled=len(quality),
        planned=job.campaign.diagnose.planned_trials is not None,
        words="; ".join([f"{good} of {len(quality)} trials", *headlines(quoted, diagnosis)]),
        next=visits(asked, job) if asked and fresh else (),
    )


def headlines(quoted: Results, diagnosis: DiagnosisResults) -> Iterator[str]:
    """Each boundary's first coefficient, as quoted, the verdict behind it, and the threshold of a
    claim where trials are still to come.
    """
    for boundary, result in quoted.boundaries.items():
        if name := result.headline:
            yield f"{boundary} {coefficient_text(result.coefficients[name], name)}"
        if result.verdict != NOT_DIAGNOSED:
            diagnosed = diagnosis.boundaries.get(boundary)
            interim = diagnosed.look if isinstance(diagnosed, BoundaryDiagnosis) else None
            words = claim(result, diagnosed)
            yield f"{boundary} {words}" + (f" ({interim.text})" if interim else "")


def visits(asked: VisitQuestion, job: Job) -> tuple[str, ...]:
    """The next visits, or why there are none to propose."""
    from nearlift.report import visits as visits_text

    try:
        batches, elsewhere = next_visits(job, asked)
    except NearliftError as refusal:
        return (f"next: {refusal.what}; {refusal.remedy}",)
    return (*(line for batch in batches for line in visits_text.brief(batch)), *elsewhere)
