"""Many campaigns of 1200 trials in one go, record by record to the report: what one costs, and
whether the hundredth costs more than the first.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks import _paper
from benchmarks.harness import Bench, Contestant, Target, command_line

WHICH = "campaigns-pool"
FEW, MANY, HUNDRED = 4, 12, 100
WORKERS = 2
SIDES = ("ground", "ceiling", "sidewall")
THROTTLES = 4
#: Of the pool's visits to each station, this part is in each campaign.
TAKEN = 5 / 6


def prepare(data: Path, quick: bool) -> str:
    pool = _paper.campaign(data, 0.4 if quick else 1.2, sagging=True)
    (data / WHICH).write_text(pool.name)
    folder = campaign(data, 0)
    records = len((folder / "trials.csv").read_text().splitlines()) - 1
    size = sum(f.stat().st_size for f in (folder / "trials").iterdir()) / 1e6
    return (
        f"Campaigns of {records} CSV records (12 s at 1 kHz, {size:.0f} MB) at one boundary each,"
        f" ground, ceiling and sidewall in turn, every stage, processes:{WORKERS}, page cache warm."
        " Each has 5 in 6 of the visits of a common pool, drawn again, so that trials differ while"
        " the disk holds every record once. Above the ground a battery sags, elsewhere nothing is"
        " wrong."
    )


def campaign(data: Path, k: int) -> Path:
    """Campaign number k, written if it is not there: trials of one boundary in the pool's order,
    its records hard links.
    """
    import numpy as np

    pool = data / (data / WHICH).read_text()
    folder = data / f"{pool.name}-campaigns" / f"{k:03d}"
    if folder.exists():
        return folder
    unfinished = folder.with_name(folder.name + ".unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    (unfinished / "trials").mkdir(parents=True)
    head, *rows = (pool / "trials.csv").read_text().splitlines()
    name, boundary, distance = (head.split(",").index(c) for c in ("trial", "boundary", "distance"))
    mine = [row for row in rows if row.split(",")[boundary] == SIDES[k % len(SIDES)]]
    visits = [mine[i : i + THROTTLES] for i in range(0, len(mine), THROTTLES)]
    station = np.array([visit[0].split(",")[distance] for visit in visits])
    rng = np.random.default_rng(k)
    taken = np.zeros(len(visits), dtype=bool)
    for s in np.unique(station):
        there = np.flatnonzero(station == s)
        taken[rng.choice(there, round(TAKEN * len(there)), replace=False)] = True
    kept = [row for visit, inside in zip(visits, taken, strict=True) if inside for row in visit]
    for row in kept:
        file = f"{row.split(',')[name]}.csv"
        os.link(pool / "trials" / file, unfinished / "trials" / file)
    (unfinished / "trials.csv").write_text("\n".join([head, *kept]) + "\n")
    manifest = (pool / "campaign.toml").read_text()
    (unfinished / "campaign.toml").write_text(
        manifest.replace('name   = "paper"', f'name   = "paper-{k:03d}"')
    )
    unfinished.rename(folder)
    return folder


def run(data: Path, n: int) -> dict[str, Any]:
    """What one of n campaigns costs, by quarters of the order too; peak memory is that of the
    process that needed most.
    """
    import resource

    roots = [str(campaign(data, k)) for k in range(n)]
    with tempfile.TemporaryDirectory() as out:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        begin = time.perf_counter()
        options = ["--out", out, "--executor", f"processes:{WORKERS}", "--json"]
        done = subprocess.run(
            command_line("run", *roots, *options),
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            check=False,
        )
        wall = time.perf_counter() - begin
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
    ends = json.loads(done.stdout)["campaigns"]
    if done.returncode or len(ends) != n:
        raise SystemExit(f"exit code {done.returncode}: {ends}")
    quarters = [ends[i * n // 4 : (i + 1) * n // 4] for i in range(4)]
    by_quarter = [sum(end["cpu_s"] for end in quarter) / len(quarter) for quarter in quarters]
    return {
        "wall_s": wall / n,
        "cpu_s": (used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime) / n,
        "campaigns": n,
        "processor in each quarter, s": ", ".join(f"{s:.1f}" for s in by_quarter),
        "all of them, s": round(wall),
    }


BENCH = Bench(
    title="Many campaigns",
    prepare=prepare,
    one="nearlift-few",
    rounds=1,
    contestants=(
        Contestant(
            name="nearlift-few", title=f"one of {FEW}", run=lambda data: run(data, FEW), rounds=1
        ),
        Contestant(
            name="nearlift-many", title=f"one of {MANY}", run=lambda data: run(data, MANY), rounds=1
        ),
        Contestant(
            name="nearlift-hundred",
            title=f"one of {HUNDRED}",
            run=lambda data: run(data, HUNDRED),
            rounds=1,
            full=True,
        ),
    ),
    targets=(
        Target(
            work=f"one campaign of {MANY}, whole, on {WORKERS} cores",
            ours="nearlift-many",
            must=36.0,
        ),
        Target(
            work=f"one campaign of {MANY} over one of {FEW}",
            ours="nearlift-many",
            peer="nearlift-few",
            quantity="cpu_s",
            must=1.1,
        ),
        Target(
            work=f"one campaign of {MANY} over one of {FEW}",
            ours="nearlift-many",
            peer="nearlift-few",
            quantity="peak_MiB",
            must=1.1,
        ),
        Target(
            work=f"one campaign of {HUNDRED}, whole, on {WORKERS} cores",
            ours="nearlift-hundred",
            must=36.0,
        ),
        Target(
            work=f"one campaign of {HUNDRED} over one of {FEW}",
            ours="nearlift-hundred",
            peer="nearlift-few",
            quantity="cpu_s",
            must=1.1,
        ),
        Target(
            work=f"one campaign of {HUNDRED} over one of {FEW}",
            ours="nearlift-hundred",
            peer="nearlift-few",
            quantity="peak_MiB",
            must=1.1,
        ),
    ),
)
