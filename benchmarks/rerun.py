"""A rerun of an unchanged campaign, compared with its first run; and the check that nothing has
changed since ingest, at the paper's size.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from benchmarks import _paper
from benchmarks.harness import Bench, Contestant, Target, command_line

WHICH = "rerun-campaigns"


def prepare(data: Path, quick: bool) -> str:
    small, whole = _paper.campaign(data, 0.1), _paper.campaign(data, 0.1 if quick else 1.0)
    (data / WHICH).write_text("\n".join([small.name, whole.name]))
    shutil.rmtree(data / "rerun-out", ignore_errors=True)
    count = len((small / "trials.csv").read_text().splitlines()) - 1
    return f"All stages of {count} trials; ingest alone of {_paper.spoken(whole)}"


def command(data: Path, words: str, whole: bool, again: bool) -> list[str]:
    """A first run begins with nothing; the next finds what it left."""
    campaign = data / (data / WHICH).read_text().splitlines()[whole]
    out = data / "rerun-out" / ("ingest" if whole else "run")
    if not again:
        shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True, exist_ok=True)
    return command_line(*words.split(), str(campaign), "--out", str(out), "-q")


def contestant(name: str, title: str, words: str, whole: bool, again: bool) -> Contestant:
    return Contestant(
        name=name, title=title, command=lambda data: command(data, words, whole, again), rounds=3
    )


BENCH = Bench(
    title="Rerun of an unchanged campaign",
    prepare=prepare,
    one="nearlift-first",
    rounds=3,
    contestants=(
        contestant("nearlift-first", "first run, all stages", "run", whole=False, again=False),
        contestant("nearlift-again", "rerun, all stages", "run", whole=False, again=True),
        contestant("nearlift-ingest", "first ingest", "ingest", whole=True, again=False),
        contestant(
            "nearlift-stale",
            "what is stale after that ingest",
            "run --dry-run",
            whole=True,
            again=True,
        ),
    ),
    targets=(
        Target(
            work="rerun of an unchanged campaign over its first run",
            ours="nearlift-again",
            peer="nearlift-first",
            must=0.1,
            aim=0.05,
        ),
        Target(
            work="finding what is stale, paper's size, over its first ingest",
            ours="nearlift-stale",
            peer="nearlift-ingest",
            must=0.5,
            aim=0.1,
        ),
    ),
)
