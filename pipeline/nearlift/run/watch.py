"""A campaign that is still being recorded: whatever is stale is run again as often as its folder
has changed.

The folder is looked at by `stat` alone, every `period_s` seconds; no file is opened to find out
whether anything is new. A run that is refused (a schedule half saved, too few trials for a fit yet)
is told, and waits for the next change.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from nearlift.campaign import manifest as manifests
from nearlift.errors import NearliftError
from nearlift.products import DIAGNOSIS, NOT_DIAGNOSED, RESULTS, TRIALS
from nearlift.reduction.quality import rejected
from nearlift.results.diagnosis import NOTHING, BoundaryDiagnosis, DiagnosisResults
from nearlift.results.quotation import Results
from nearlift.run import graph, store
from nearlift.run.job import Job, Say, silent
from nearlift.run.lock import Busy
from nearlift.run.opening import open_job
from nearlift.run.transaction import Homes

if TYPE_CHECKING:
    from nearlift.stages.asked import AskedQuestion

#: Seconds between looks, unless told otherwise.
PERIOD_S = 5.0
#: File of the latest round, among the products; `nearlift serve` shows it.
LATEST = "watch.json"
#: Told where a schedule is longer than it was: with no trial to come, each look has the full rate.
GROWS = (
    "the schedule grows with its records: say planned_trials under [diagnose], or every look has"
    " the false-alarm rate of the end"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Round:
    """One time round.

    Attributes
    ----------
    ran : tuple of str
        Stages that were stale.
    good, scheduled : int
        Trials that take part in fits, and trials in the schedule.
    planned : bool
        Whether the manifest says how long the campaign will be.
    words : str
        One line: how far the campaign is and what it says so far, or why it must wait.
    refused : str
        The refusal, where there was one.
    next : tuple of str
        The next visits, and where to stop, where they were asked for.
    """

    ran: tuple[str, ...] = ()
    good: int = 0
    scheduled: int = 0
    planned: bool = False
    words: str
    refused: str = ""
    next: tuple[str, ...] = ()


def watch(
    root: Path,
    out: Path,
    executor: str,
    seed: int,
    period_s: float = PERIOD_S,
    say: Say = silent,
    stages: Sequence[graph.Stage] = graph.STAGES,
    asked: AskedQuestion | None = None,
) -> Iterator[Round]:
    """Rounds without end; one is yielded whenever something was run or refused, or need not wait
    any longer.

    Raises
    ------
    ManifestError
        The manifest is refused before the first round; later it may be mended.
    """
    home = Homes.within(out, manifests.load(root).name).processed
    seen: dict[str, tuple[int, int]] | None = None
    again = waiting = False
    longest = 0
    while True:
        now = _stamps(root)
        if again or now != seen:
            seen = now
            latest, again = _round(root, out, executor, seed, say, stages, asked)
            if 0 < longest < latest.scheduled and not latest.planned:
                latest = replace(latest, words=f"{latest.words}; {GROWS}")
            longest = max(longest, latest.scheduled)
            if latest.ran or latest.refused or waiting:
                store.write_json(home / LATEST, asdict(latest))
                yield latest
            waiting = bool(latest.refused)
        time.sleep(period_s)


def _stamps(root: Path) -> dict[str, tuple[int, int]]:
    """Size and time of last change of every file in the campaign's folder; links are not
    followed.
    """
    stamps = {}
    for folder, _, names in os.walk(root):
        for name in names:
            path = Path(folder, name)
            try:
                status = path.lstat()
            except FileNotFoundError:
                continue  # renamed meanwhile
            stamps[str(path)] = (status.st_size, status.st_mtime_ns)
    return stamps


def _round(
    root: Path,
    out: Path,
    executor: str,
    seed: int,
    say: Say,
    stages: Sequence[graph.Stage],
    asked: AskedQuestion | None,
) -> tuple[Round, bool]:
    """Run what is stale; the answer, and whether to look again although nothing changes (a record
    was still being written).
    """
    ran: list[str] = []
    pending = False
    try:
        with open_job(root, out, executor, seed, say) as job:
            for step in graph.run(job, stages):
                ran += [step.stage.name] if step.why else []
                pending |= any(reason.startswith("PENDING") for _, reason in step.outcome.rejected)
            quality = job.read(TRIALS)["quality"]
            planned = job.campaign.diagnose.planned_trials is not None
            diagnosis = store.load_if_whole(job.processed / DIAGNOSIS.file, NOTHING)
            quoted = store.load_if_whole(job.processed / RESULTS.file, Results(boundaries={}))
            visits = _next(job, asked) if asked and ran else ()
    except NearliftError as refusal:
        return Round(
            ran=tuple(ran), words=f"waiting: {str(refusal).splitlines()[0]}", refused=str(refusal)
        ), isinstance(refusal, Busy)
    good = len(quality) - int(rejected(quality).sum())
    words = "; ".join([f"{good} of {len(quality)} trials", *_headlines(quoted, diagnosis)])
    done = Round(
        ran=tuple(ran),
        good=good,
        scheduled=len(quality),
        planned=planned,
        words=words,
        next=visits,
    )
    return done, pending


def _next(job: Job, asked: AskedQuestion) -> tuple[str, ...]:
    """What to visit next, or why nobody can say."""
    from nearlift.stages import next_visits

    try:
        batches, elsewhere = next_visits.run(job, asked)
    except NearliftError as refusal:
        return (f"next: {refusal.what}; {refusal.remedy}",)
    return (*(line for batch in batches for line in batch.brief), *elsewhere)


def _headlines(quoted: Results, diagnosis: DiagnosisResults) -> Iterator[str]:
    """Each boundary's first coefficient, as quoted, the verdict behind it, and what a claim needs
    where trials are still to come.
    """
    for boundary, result in quoted.boundaries.items():
        if result.headline:
            yield f"{boundary} {result.headline_text}"
        if result.verdict != NOT_DIAGNOSED:
            diagnosed = diagnosis.boundaries.get(boundary)
            look = diagnosed.look if isinstance(diagnosed, BoundaryDiagnosis) else None
            yield f"{boundary} {result.claim}" + (f" ({look.text})" if look else "")
