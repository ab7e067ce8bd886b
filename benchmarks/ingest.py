"""Ingest of the paper's whole campaign (3600 CSV files, 43 M samples) beside pyarrow's bare parse of the same files.

    python benchmarks/ingest.py [--scale 1.0] [--threads 2] [--keep DIR] [--columns 1|2]

Each contestant runs in a process of its own, imports included, page cache warm, and prints wall and processor time and peak resident memory.
pyarrow only parses: no tare, no statistics, no hash, no checks. "flat" compares nearlift's peak at a tenth of the scale.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TRIALS, RATE, TARE, RECORD = 3600, 1000.0, 2.0, 10.0


def write(folder: Path, scale: float, columns: int) -> None:
    """The campaign: distinct records (a few written out, the rest made of them by a shift), as a lab's logger prints them."""
    import numpy as np

    from nearlift.declare import Boundary
    from nearlift.synthetic import demo
    from nearlift.synthetic.design import randomised
    from nearlift.synthetic.presets import PERCENT_DIAMETER, TABLE_1
    from nearlift.synthetic.records import Bench, Form, manifest, record, schedule, simulate

    visits = max(round(15 * scale), 1)
    stations: dict[Boundary, np.ndarray] = {side: PERCENT_DIAMETER.recorded_m(side) for side in TABLE_1}
    plan = randomised(stations, seed=1, visits=visits)
    truths = {side: dataclasses.replace(truth, effects=()) for side, truth in demo.truths().items()}
    bench = Bench(rate_Hz=RATE, tare_s=TARE, record_s=RECORD)
    quantum = next(iter(truths.values())).noise.quantum_N
    true = simulate(plan, truths, bench=bench, seed=1)
    (folder / "trials").mkdir(parents=True)
    form: Form = "csv" if columns == 1 else "csv_with_time"
    (folder / "campaign.toml").write_text(manifest("paper", "Simulated, for timing.", bench, form, quantum, plan))
    (folder / "trials.csv").write_text(schedule(plan, bench))
    clock = [f"{i / RATE:.3f}," for i in range(round((TARE + RECORD) * RATE))]
    for i, trial in enumerate(plan.trial):
        counts = record(str(trial), float(true.lift_N[i]), float(plan.throttle[i]), truths[plan.boundary[i]], bench, 1)
        force = [f"{f:.4f}" for f in (1e3 * quantum * counts).tolist()]
        lines = ["force", *force] if columns == 1 else ["t,force", *(t + f for t, f in zip(clock, force, strict=True))]
        (folder / "trials" / f"{trial}.csv").write_text("\n".join(lines) + "\n")


def nearlift(folder: Path, threads: int) -> None:
    from nearlift import campaign, executors
    from nearlift.stages import ingest
    from nearlift.stages.job import Job

    with tempfile.TemporaryDirectory() as out, executors.open_executor(f"threads:{threads}") as executor:
        manifest = campaign.load(folder)
        job = Job(root=folder, campaign=manifest, processed=Path(out), reports=Path(out), executor=executor)
        outcome = ingest.run(job)
    if outcome.rejected:
        raise SystemExit(f"{len(outcome.rejected)} trials rejected: {outcome.rejected[0]}")


def pyarrow(folder: Path, threads: int) -> None:
    from concurrent.futures import ThreadPoolExecutor

    import pyarrow as pa
    import pyarrow.csv as pc

    pa.set_cpu_count(1)
    options = pc.ReadOptions(use_threads=False)

    def parse(path: str) -> int:
        return int(pc.read_csv(path, read_options=options).num_rows)

    with ThreadPoolExecutor(threads) as pool:
        sum(pool.map(parse, [e.path for e in os.scandir(folder / "trials")]))


def contest(name: str, folder: Path, threads: int) -> tuple[float, float, float]:
    """Wall time in s of a whole process, its processor time in s, and its peak resident memory in MiB."""
    start = time.perf_counter()
    command = [sys.executable, __file__, "--contestant", name, "--folder", str(folder), "--threads", str(threads)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    wall = time.perf_counter() - start
    told = json.loads(done.stdout.splitlines()[-1])
    return wall, told["cpu_s"], told["peak_MiB"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scale", type=float, default=1.0)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--columns", type=int, choices=(1, 2), default=2)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--contestant")
    parser.add_argument("--folder", type=Path)
    given = parser.parse_args()
    if given.contestant:
        {"nearlift": nearlift, "pyarrow": pyarrow}[given.contestant](given.folder, given.threads)
        used = resource.getrusage(resource.RUSAGE_SELF)
        print(json.dumps({"peak_MiB": used.ru_maxrss / 1024, "cpu_s": used.ru_utime + used.ru_stime}))
        return
    with tempfile.TemporaryDirectory() as temporary:
        base = given.keep or Path(temporary)
        folders = {scale: base / f"paper-{scale:g}-{given.columns}" for scale in (given.scale, given.scale / 10)}
        for scale, folder in folders.items():
            if not folder.exists():
                write(folder, scale, given.columns)
        whole = folders[given.scale]
        files = list((whole / "trials").iterdir())
        size = sum(f.stat().st_size for f in files)
        samples = len(files) * round((TARE + RECORD) * RATE) / 1e6
        print(f"{len(files)} files, {samples:.1f} M samples, {size / 1e6:.0f} MB, {given.threads} threads, best of {given.rounds}")
        # the first call compiles the scanner and warms the page cache
        contest("nearlift", whole, given.threads)
        found: dict[str, list[tuple[float, float, float]]] = {"pyarrow": [], "nearlift": []}
        for _ in range(given.rounds):
            for name, runs in found.items():
                runs.append(contest(name, whole, given.threads))
        bare_wall, bare_cpu = (min(run[i] for run in found["pyarrow"]) for i in (0, 1))
        for name, runs in found.items():
            wall, cpu, peak = (min(run[i] for run in runs) for i in range(3))
            print(
                f"{name:10s} {wall:6.2f} s = {wall / bare_wall:5.2f} x pyarrow   processor {cpu:6.2f} s = {cpu / bare_cpu:5.2f} x   "
                f"peak {peak:4.0f} MiB   wall of each {' '.join(f'{run[0]:.2f}' for run in runs)}"
            )
        small = contest("nearlift", folders[given.scale / 10], given.threads)
        print(f"flat       nearlift at a tenth of the scale: peak {small[2]:.0f} MiB")


if __name__ == "__main__":
    main()
