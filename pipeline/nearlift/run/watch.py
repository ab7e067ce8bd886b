"""A campaign that is still being recorded: stale stages run again whenever its folder has changed.

The folder is looked at by `stat` alone, every `period_s` seconds. A run that is refused (a schedule
half saved, too few trials for a fit yet) is reported, and waits for the next change.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from nearlift.errors import NearliftError
from nearlift.run import engine, tables
from nearlift.run.engine import Busy, Job, Say, Stage, Stamp, silent

#: Seconds between looks.
PERIOD_S = 5.0
#: File of the latest round, with the products; `nearlift serve` shows it.
LATEST = "watch.json"
#: Remark where a schedule is longer than it was: without trials to come, each look has the full
#: rate of false alarms.
GROWS = (
    "the schedule grows with its records: say planned_trials under [diagnose], or every look has"
    " the false-alarm rate of the end"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Round:
    """One look at the campaign.

    Attributes
    ----------
    ran : tuple of str
        Stages that were stale.
    good, scheduled : int
        Trials that take part in fits, and trials in the schedule.
    planned : bool
        Whether the manifest says how long the campaign will be.
    words : str
        One line: progress and results so far, or why the campaign must wait.
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
    stages: Sequence[Stage],
    executor: str,
    seed: int,
    look: Callable[[Job, bool], Round],
    period_s: float = PERIOD_S,
    say: Say = silent,
) -> Iterator[Round]:
    """Rounds without end; one is yielded whenever something was run or refused, or need not wait
    any longer. `look` makes a round of a campaign that is up to date, and gets whether
    anything ran.

    Raises
    ------
    ManifestError
        The manifest is refused before the first round; later it may be corrected.
    """
    from nearlift.campaign import manifest as manifests

    home = out / "processed" / manifests.load(root).name
    seen: dict[str, Stamp] | None = None
    again = waiting = False
    longest = 0
    while True:
        now = _stamps(root)
        if again or now != seen:
            seen, ran, again = now, list[str](), False
            try:
                with engine.open_job(root, out, stages, executor, seed, say=say) as job:
                    for step in engine.run(job):
                        ran += [step.stage.name] if step.why else []
                        # a record was still being written
                        again |= any(why.startswith("PENDING") for _, why in step.outcome.rejected)
                    latest = replace(look(job, bool(ran)), ran=tuple(ran))
            except NearliftError as refusal:
                line = f"waiting: {str(refusal).splitlines()[0]}"
                latest = Round(ran=tuple(ran), words=line, refused=str(refusal))
                again = isinstance(refusal, Busy)
            if 0 < longest < latest.scheduled and not latest.planned:
                latest = replace(latest, words=f"{latest.words}; {GROWS}")
            longest = max(longest, latest.scheduled)
            if latest.ran or latest.refused or waiting:
                tables.write_whole(home / LATEST, tables.json_bytes(latest))
                yield latest
            waiting = bool(latest.refused)
        time.sleep(period_s)


def _stamps(root: Path) -> dict[str, Stamp]:
    """Size and time of last change of every file in the campaign's folder; links are not
    followed.
    """
    stamps = {}
    for path in (Path(folder, name) for folder, _, names in os.walk(root) for name in names):
        try:
            status = path.lstat()
        except FileNotFoundError:
            continue  # renamed meanwhile
        stamps[str(path)] = (status.st_size, status.st_mtime_ns)
    return stamps
