"""The paper's campaign as files, whole (3600 records of 12 s at 1 kHz, 43.2 M samples) or in part;
what several benchmarks run over.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path

RATE, TARE, RECORD = 1000.0, 2.0, 10.0
VISITS = 15
COLUMNS = """\
reader = "csv"
files  = "trials/{trial}.csv"
force  = { column = "force", unit = "mN", sign = 1 }
"""


def campaign(data: Path, scale: float, form: str = "csv_with_time", sagging: bool = False) -> Path:
    """The folder of the campaign at that scale, written if it is not there; `form` is csv (force
    alone) or csv_with_time.

    `sagging`: with the demo's battery above the ground, its voltage logged everywhere; else nothing
    is wrong.
    """
    folder = (
        data
        / f"paper-{scale:g}-{ {'csv': '1', 'csv_with_time': '2'}.get(form, form) }{'-sagging' if sagging else ''}"
    )
    if not folder.exists():
        unfinished = folder.with_name(folder.name + ".unfinished")
        shutil.rmtree(unfinished, ignore_errors=True)
        write(unfinished, scale, form, sagging)
        unfinished.rename(folder)
    return folder


def write(folder: Path, scale: float, form: str, sagging: bool) -> None:
    """Write records as a lab's logger prints them: force to 0.1 uN, clock in ms."""
    import dataclasses

    import numpy as np

    from nearlift.declare import Boundary
    from nearlift.synthetic import demo
    from nearlift.synthetic.records import SimulatedBench, manifest, record, schedule, simulate
    from nearlift.synthetic.table_1 import TABLE_1, stations_m
    from nearlift.synthetic.trial_schedule import battery_V, bench_V, randomised

    stations: dict[Boundary, np.ndarray] = {side: stations_m(side) for side in TABLE_1}
    plan = randomised(stations, seed=1, visits=max(round(VISITS * scale), 1))
    truths = {
        side: truth if sagging and side == "ground" else dataclasses.replace(truth, effects=())
        for side, truth in demo.truths().items()
    }
    if sagging:
        volts = np.where(plan.boundary == "ground", battery_V(plan, seed=1), bench_V(plan, seed=1))
        plan = dataclasses.replace(plan, further={"supply_V": volts})
    bench = SimulatedBench(rate_Hz=RATE, tare_s=TARE, record_s=RECORD)
    quantum = next(iter(truths.values())).noise.quantum_N
    true = simulate(plan, truths, bench=bench, seed=1)
    (folder / "trials").mkdir(parents=True)
    clocked = form == "csv_with_time"
    records = COLUMNS + ('time   = { column = "t", unit = "s" }\n' if clocked else "")
    (folder / "campaign.toml").write_text(
        manifest("paper", "Simulated, for timing.", bench, records, plan)
    )
    (folder / "trials.csv").write_text(schedule(plan))
    clock = [f"{i / RATE:.3f}," for i in range(round((TARE + RECORD) * RATE))]
    for i, trial in enumerate(plan.trial):
        counts = record(
            str(trial),
            float(true.lift_N[i]),
            float(plan.throttle[i]),
            truths[plan.boundary[i]],
            bench,
            1,
        )
        # a converter's counts repeat: each is written once
        count, which = np.unique(counts, return_inverse=True)
        said = [f"{f:.4f}" for f in (1e3 * quantum * count).tolist()]
        force = [said[k] for k in which.tolist()]
        lines = ["t,force", *map(str.__add__, clock, force)] if clocked else ["force", *force]
        (folder / "trials" / f"{trial}.csv").write_text("\n".join(lines) + "\n")


def tenfold(data: Path, folder: Path) -> Path:
    """Ten times that campaign, its files nine times more under other names (hard links: the disk
    holds them once).
    """
    big = folder.with_name(folder.name + "-tenfold")
    if big.exists():
        return big
    unfinished = big.with_name(big.name + ".unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    (unfinished / "trials").mkdir(parents=True)
    shutil.copy(folder / "campaign.toml", unfinished)
    head, *rows = (folder / "trials.csv").read_text().splitlines()
    place = head.split(",").index("trial")
    lines = [head]
    for k in range(10):
        for row in rows:
            cells = row.split(",")
            name = cells[place]
            cells[place] = f"{name}-{k}"
            lines.append(",".join(cells))
            os.link(folder / "trials" / f"{name}.csv", unfinished / "trials" / f"{name}-{k}.csv")
    (unfinished / "trials.csv").write_text("\n".join(lines) + "\n")
    unfinished.rename(big)
    return big


def spoken(folder: Path) -> str:
    """How much that is."""
    files = list((folder / "trials").iterdir())
    size = sum(f.stat().st_size for f in files) / 1e6
    samples = len(files) * round((TARE + RECORD) * RATE) / 1e6
    return (
        f"{len(files)} CSV files (`t,force`), {samples:.1f} M samples, {size:.0f} MB, page cache"
        " warm, two threads."
    )


def ingest(folder: Path, threads: int = 2) -> None:
    """What the stage does, of a campaign never seen before."""
    import tempfile

    from nearlift.campaign import manifest as manifests
    from nearlift.run import workers
    from nearlift.run.engine import Job
    from nearlift.stages import ingest as stage

    with (
        tempfile.TemporaryDirectory() as out,
        workers.open_executor(f"threads:{threads}") as executor,
    ):
        job = Job(
            root=folder,
            campaign=manifests.load(folder),
            processed=Path(out),
            reports=Path(out),
            executor=executor,
        )
        stage.run(job)
