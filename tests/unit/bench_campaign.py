"""A campaign folder made by hand, one file at a time, for the tests of schedule, readers and
ingest.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.run.engine import Job, Outcome
from nearlift.run.workers import SerialExecutor
from nearlift.stages import ingest

from .manifests import HEAD, LIVE


def write_schedule(folder: Path, text: str) -> Path:
    (folder / "trials.csv").write_text(text)
    return folder


def force_mN(
    lift_mN: float,
    *,
    zero: float = 5.0,
    noise: float = 1.0,
    head: int = HEAD,
    live: int = LIVE,
    seed: int = 0,
) -> np.ndarray:
    samples = zero + noise * np.random.default_rng(seed).standard_normal(head + live)
    samples[head:] += lift_mN
    return samples


def write_record(folder: Path, trial: str, force: np.ndarray) -> None:
    (folder / "trials").mkdir(exist_ok=True)
    (folder / "trials" / f"{trial}.csv").write_text(
        "force\n" + "".join(f"{f:.4f}\n" for f in force)
    )


def small_campaign(
    folder: Path, lifts_mN: tuple[float, ...] = (100.0, 250.0, 400.0, 500.0)
) -> None:
    """Four throttles, near and far, a hundred and some mN each."""
    rows = ["trial,boundary,distance,throttle,supply"]
    for k, distance in enumerate((30, 300)):
        for j, lift in enumerate(lifts_mN):
            trial = f"t{k}{j}"
            rows.append(f"{trial},ground,{distance},{(25, 50, 75, 92)[j]},{4 - 0.1 * j}")
            write_record(
                folder, trial, force_mN(lift * (1.1 if distance == 30 else 1.0), seed=10 * k + j)
            )
    write_schedule(folder, "\n".join(rows) + "\n")


def run_ingest(folder: Path, out: Path, given: Campaign) -> tuple[Outcome, Job]:
    if not (folder / "campaign.toml").exists():
        (folder / "campaign.toml").touch()
    job = Job(
        root=folder,
        campaign=given,
        processed=out / "processed",
        reports=out / "reports",
        executor=SerialExecutor(),
    )
    return ingest.run(job), job
