"""The streamed average of 150 fields of 128 x 128, and its memory as the number of fields grows.

"numpy" is its mean and variance of the stack in memory, without a missing vector. "nan" is the same
by nanmean and nanvar, with missing vectors. nearlift takes those fields one by one, with their
correlation in time. "stream" averages more and more fields that are made on demand: its memory is
constant.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.harness import Bench, Contestant, Target

FIELDS, NODES, REPEATS = 150, 128, 5


def timed(function: Callable[[], object]) -> dict[str, float]:
    """Least times of a few calls, after one that does not count."""
    found = []
    for _ in range(REPEATS + 1):
        begun = time.perf_counter(), time.process_time()
        function()
        found.append((time.perf_counter() - begun[0], time.process_time() - begun[1]))
    return {"wall_s": min(f[0] for f in found[1:]), "cpu_s": min(f[1] for f in found[1:])}


def stack(missing: float) -> Any:
    import numpy as np

    rng = np.random.default_rng(0)
    whole = rng.standard_normal((FIELDS, 2 * NODES**2))
    return np.where(rng.random(whole.shape) < missing, np.nan, whole) if missing else whole


def field(values: Any) -> Any:
    import numpy as np

    from nearlift.flow.field import VelocityField

    axis = np.linspace(0.0, 0.1, NODES)
    u = values.reshape(2, NODES, NODES)
    return VelocityField(x_m=axis, y_m=axis, vx_m_s=u[0], vy_m_s=u[1])


def bare(_: Path) -> dict[str, float]:
    whole = stack(0.0)
    return timed(lambda: (whole.mean(axis=0), whole.var(axis=0)))


def nan(_: Path) -> dict[str, float]:
    import numpy as np

    holed = stack(0.01)
    return timed(lambda: (np.nanmean(holed, axis=0), np.nanvar(holed, axis=0)))


def average(_: Path) -> dict[str, float]:
    from nearlift.flow.average import average as whole

    fields = [field(row) for row in stack(0.01)]
    return timed(lambda: whole(fields))


def stream(fields: int) -> None:
    """Average fields that are never all in memory."""
    import numpy as np

    from nearlift.flow.average import average as whole

    def made() -> Iterator[Any]:
        rng = np.random.default_rng(0)
        for _ in range(fields):
            yield field(rng.standard_normal(2 * NODES**2))

    whole(made())


def prepare(_: Path, quick: bool) -> str:
    return (
        f"{FIELDS} fields of {NODES} x {NODES} nodes, 1 % of the vectors missing where that is"
        f" borne; least of {REPEATS} calls in a process."
    )


BENCH = Bench(
    title="Average of 150 velocity fields",
    prepare=prepare,
    one="numpy",
    rounds=3,
    contestants=(
        Contestant(name="numpy", title="numpy, mean and variance in memory", run=bare),
        Contestant(name="nan", title="numpy, nanmean and nanvar", run=nan),
        Contestant(
            name="nearlift",
            title="nearlift, with missing vectors and correlation in time, streamed",
            run=average,
        ),
        Contestant(
            name="nearlift-stream",
            title="nearlift, a process that averages 150 fields",
            run=lambda _: stream(FIELDS),
            rounds=1,
        ),
        Contestant(
            name="nearlift-stream-40",
            title="nearlift, a process that averages 6000 fields",
            run=lambda _: stream(40 * FIELDS),
            rounds=1,
        ),
    ),
    targets=(
        Target(
            work="average of velocity fields over numpy's pass in memory",
            ours="nearlift",
            peer="numpy",
            must=2.0,
        ),
        Target(
            work="memory, 6000 velocity fields over 150",
            ours="nearlift-stream-40",
            peer="nearlift-stream",
            quantity="peak_MiB",
            must=1.1,
        ),
    ),
)
