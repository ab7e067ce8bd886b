"""Peak memory of ingest at a tenth of the paper's campaign, at its size, and at ten times it."""

from __future__ import annotations

from pathlib import Path

from benchmarks import _paper
from benchmarks.harness import Bench, Contestant, Target

WHICH = "memory-campaigns"


def prepare(data: Path, quick: bool) -> str:
    once = _paper.campaign(data, 0.1 if quick else 1.0)
    tenth = _paper.campaign(data, 0.1)
    big = _paper.tenfold(data, once)
    (data / WHICH).write_text("\n".join([tenth.name, once.name, big.name]))
    return _paper.spoken(once) + " Ten times it: the same files under ten names each."


def ingest(data: Path, which: int) -> None:
    _paper.ingest(data / (data / WHICH).read_text().splitlines()[which])


BENCH = Bench(
    title="Memory against the campaign's size",
    prepare=prepare,
    one="nearlift-once",
    rounds=2,
    contestants=(
        Contestant(name="nearlift-once", title="nearlift, once", run=lambda data: ingest(data, 1)),
        Contestant(name="nearlift-tenth", title="nearlift, a tenth", run=lambda data: ingest(data, 0)),
        Contestant(name="nearlift-tenfold", title="nearlift, ten times", run=lambda data: ingest(data, 2), rounds=2),
    ),
    targets=(
        Target(
            work="memory at ten times the paper's campaign over once", ours="nearlift-tenfold", peer="nearlift-once", quantity="peak_MiB", must=1.25
        ),
    ),
)
