"""The streamed average of 150 fields of 128 x 128 beside numpy's mean and variance of the stack in memory; and its memory as fields grow.

    python benchmarks/flow.py [--fields 150] [--nodes 128] [--rounds 7]

"pass" is numpy's own mean and variance of the whole stack, without a missing vector (it could not bear one); "nan pass" the same by
nanmean and nanvar. The accumulator takes the same stack, 1 % of it missing. "stream" averages ever more fields that are made as they are
asked for and prints the peak memory of the process: flat, however large the set.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np


def best(function: Callable[[], object], rounds: int) -> float:
    """Least wall time in ms."""
    found = []
    for _ in range(rounds):
        start = time.perf_counter()
        function()
        found.append(time.perf_counter() - start)
    return 1e3 * min(found)


def stream(fields: int, nodes: int) -> None:
    """Average fields that are never all in memory; prints the process's peak."""
    from nearlift.flow.average import average
    from nearlift.flow.field import Field

    axis = np.linspace(0.0, 0.1, nodes)

    def made() -> Iterator[Field]:
        rng = np.random.default_rng(0)
        for _ in range(fields):
            u = rng.standard_normal((2, nodes, nodes))
            yield Field(x_m=axis, y_m=axis, vx_m_s=u[0], vy_m_s=u[1])

    average(made())
    print(f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fields", type=int, default=150)
    parser.add_argument("--nodes", type=int, default=128)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--stream", type=int)
    given = parser.parse_args()
    if given.stream:
        stream(given.stream, given.nodes)
        return
    from nearlift.flow.average import BATCH, Moments, average
    from nearlift.flow.field import Field

    rng = np.random.default_rng(0)
    stack = rng.standard_normal((given.fields, 2 * given.nodes**2))
    holed = np.where(rng.random(stack.shape) < 0.01, np.nan, stack)
    axis = np.linspace(0.0, 0.1, given.nodes)
    shape = (2, given.nodes, given.nodes)
    fields = [Field(x_m=axis, y_m=axis, vx_m_s=f[0], vy_m_s=f[1]) for f in (row.reshape(shape) for row in holed)]

    def accumulate() -> Moments:
        moments = Moments(stack.shape[1])
        for i in range(0, len(holed), BATCH):
            moments.add(holed[i : i + BATCH])
        return moments

    print(f"{given.fields} fields of {given.nodes} x {given.nodes}, {stack.nbytes / 1e6:.0f} MB, best of {given.rounds}")
    contestants = (
        ("pass", lambda: (stack.mean(axis=0), stack.var(axis=0))),
        ("nan pass", lambda: (np.nanmean(holed, axis=0), np.nanvar(holed, axis=0))),
        ("mean and variance, streamed", accumulate),
        ("all of average()", lambda: average(fields)),
    )
    # in turn, so that what else the machine does hits all alike
    walls = {name: best(function, 1) for name, function in contestants}
    for _ in range(given.rounds - 1):
        walls = {name: min(walls[name], best(function, 1)) for name, function in contestants}
    for name, wall in walls.items():
        print(f"{name:30s} {wall:7.1f} ms = {wall / walls['pass']:5.2f} x pass")
    for n in (given.fields, 10 * given.fields, 40 * given.fields):
        command = [sys.executable, __file__, "--stream", str(n), "--nodes", str(given.nodes)]
        peak = subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
        print(f"stream of {n:6d} fields ({n * 2 * given.nodes**2 * 8 / 1e6:6.0f} MB)   peak {peak} MiB")


if __name__ == "__main__":
    main()
