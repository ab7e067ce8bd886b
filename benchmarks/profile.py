"""Time of `nearlift run` at the paper's size: the whole first run, then each stage in a process.

Each stage's process starts Python, reads the manifest, looks at every raw file's stamp, and finds
what is stale, which the whole run does once; `plan` does that and no more. Ingest that is run again
hashes what it reads twice, so that bits that flipped on the disk show.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from benchmarks import _paper
from benchmarks.harness import Bench, Contestant, command_line

WHICH = "profile-campaign"
STAGES = ("ingest", "reduce", "fit", "diagnose", "report")


def prepare(data: Path, quick: bool) -> str:
    folder = _paper.campaign(data, 0.1 if quick else 1.0)
    (data / WHICH).write_text(folder.name)
    shutil.rmtree(data / "profile-out", ignore_errors=True)
    return _paper.spoken(folder)


def command(data: Path, verb: str) -> list[str]:
    campaign, out = data / (data / WHICH).read_text(), data / "profile-out"
    if verb == "run":
        shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True, exist_ok=True)
    return command_line(verb, str(campaign), "--out", str(out), "-q")


def contestant(verb: str, title: str) -> Contestant:
    return Contestant(
        name=f"nearlift-{verb}", title=title, command=lambda data: command(data, verb), rounds=1
    )


BENCH = Bench(
    title="Where a run's time goes",
    prepare=prepare,
    one="nearlift-run",
    rounds=1,
    contestants=(
        contestant("run", "run, all of it"),
        contestant("plan", "plan: starting, and finding what is stale"),
        *(contestant(s, s) for s in STAGES),
    ),
)
