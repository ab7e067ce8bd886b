"""Peak memory of ingest, and of a fit and a diagnosis, against the campaign's size.

Ingest of a tenth of the paper's campaign, of it, and of ten times it; fit and diagnosis of 12,000
and 36,000 means at one boundary.
"""

from __future__ import annotations

from pathlib import Path

from benchmarks import _means, _paper
from benchmarks.harness import Bench, Contestant, Target

WHICH, MEANS = "memory-campaigns", "memory-means"


def prepare(data: Path, quick: bool) -> str:
    once = _paper.campaign(data, 0.1 if quick else 1.0)
    tenth = _paper.campaign(data, 0.1)
    big = _paper.tenfold(data, once)
    (data / WHICH).write_text("\n".join([tenth.name, once.name, big.name]))
    means = [_means.campaign(data, trials // (10 if quick else 1)) for trials in (12_000, 36_000)]
    for folder in means:
        stage(folder, "ingest")
    (data / MEANS).write_text("\n".join(folder.name for folder in means))
    return (
        _paper.spoken(once)
        + " Ten times it: the same files under ten names each. Means: 20 stations, four throttles,"
        " 12 sessions, nothing wrong."
    )


def ingest(data: Path, which: int) -> None:
    _paper.ingest(data / (data / WHICH).read_text().splitlines()[which])


def stage(folder: Path, name: str) -> None:
    """One stage of a campaign; its products are in the same folder."""
    from nearlift.run.engine import open_job, stage_of
    from nearlift.stages import STAGES

    with open_job(folder, folder.parent, STAGES, "serial", 0) as job:
        stage_of(STAGES, name).run(job)


def means(data: Path, which: int, name: str) -> None:
    stage(data / (data / MEANS).read_text().splitlines()[which], name)


def of_means(which: int, trials: str, name: str) -> Contestant:
    return Contestant(
        name=f"{name}-{trials}",
        title=f"{name}, {trials} trials",
        run=lambda data: means(data, which, name),
        rounds=1,
    )


BENCH = Bench(
    title="Memory against the campaign's size",
    prepare=prepare,
    one="nearlift-once",
    rounds=2,
    contestants=(
        Contestant(name="nearlift-once", title="nearlift, once", run=lambda data: ingest(data, 1)),
        Contestant(
            name="nearlift-tenth", title="nearlift, a tenth", run=lambda data: ingest(data, 0)
        ),
        Contestant(
            name="nearlift-tenfold",
            title="nearlift, ten times",
            run=lambda data: ingest(data, 2),
            rounds=2,
        ),
        *(
            of_means(which, trials, name)
            for which, trials in enumerate(("12000", "36000"))
            for name in ("fit", "diagnose")
        ),
    ),
    targets=(
        Target(
            work="memory at ten times the paper's campaign over once",
            ours="nearlift-tenfold",
            peer="nearlift-once",
            quantity="peak_MiB",
            must=1.25,
        ),
        *(
            Target(
                work=f"{name} of {trials} trials at one boundary",
                ours=f"{name}-{trials}",
                quantity="peak_MiB",
                must=must,
            )
            for trials, must in (("12000", 700.0), ("36000", 2000.0))
            for name in ("fit", "diagnose")
        ),
    ),
)
