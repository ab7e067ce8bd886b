"""A thousand bootstraps of a fit of 1200 trials with their full covariance, compared with a lab's
scripts.

Each contestant fits the same lifts: K_b and an exponent near the ground, and a level for each of
four throttles. The peers whiten by a dense triangle; lmfit and least_squares go campaign by
campaign. Times are of the fits alone; two designs, the paper's stations, and every trial at a
height of its own (as a rig reports that measures where it stopped).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.harness import Bench, Contestant, Target
from benchmarks.posterior import GEOMETRY, curve

DESIGNS = ("stations", "heights")


def prepare(data: Path, quick: bool) -> str:
    import numpy as np

    rng = np.random.default_rng(1)
    stations = np.array([1.14, 1.3, 1.5, 1.8, 2.2, 2.84, 4.0, 6.0, 9.0, 11.5])
    count = 100 if quick else 1000
    for design in DESIGNS:
        z = np.repeat(rng.permutation(np.repeat(stations, 30)), 4)
        if design == "heights":
            z = z * np.exp(0.02 * rng.normal(size=len(z)))
        visit = np.repeat(np.arange(300), 4)
        throttle = np.tile([0.25, 0.5, 0.75, 0.92], 300)
        level = np.log([0.107, 0.239, 0.409, 0.551])[np.tile(np.arange(4), 300)]
        slope = (
            (np.log(curve(z * 1.0001, 2.0, 1.0)) - np.log(curve(z * 0.9999, 2.0, 1.0)))
            / (0.0002 * z)
            / 0.023
        )
        exact = level + np.log(curve(z, 2.0, 1.0))
        errors = rng.normal(0, 0.005, (count, 1200))
        errors = (
            errors
            + 1e-4 * slope * rng.normal(size=(count, 300))[:, visit]
            + 0.002 * rng.normal(size=(count, 1))
        )
        np.savez(
            data / f"fits-{design}.npz",
            z=z,
            throttle=throttle,
            visit=visit,
            variance=np.full(1200, 0.005**2),
            per_visit=1e-4 * slope,
            y=exact + errors,
        )
    return (
        f"1200 trials, four throttles, {count} resampled campaigns; an error of every visit's"
        " height and a gain in common; time of the fits alone."
    )


def loaded(data: Path, design: str) -> dict[str, Any]:
    import numpy as np

    return dict(np.load(data / f"fits-{design}.npz"))


def white(found: dict[str, Any]) -> Any:
    import numpy as np

    same = found["visit"][:, None] == found["visit"]
    covariance = (
        np.diag(found["variance"])
        + same * np.outer(found["per_visit"], found["per_visit"])
        + 0.002**2
    )
    return np.linalg.inv(np.linalg.cholesky(covariance))


def timed(work: Callable[[], Any]) -> dict[str, Any]:
    begun = time.perf_counter(), time.process_time()
    theta = work()
    wall, cpu = time.perf_counter() - begun[0], time.process_time() - begun[1]
    return {
        "wall_s": wall,
        "cpu_s": cpu,
        "mean of K_b": float(theta[:, 0].mean()),
        "sd of K_b": float(theta[:, 0].std()),
    }


def nearlift(data: Path, design: str) -> dict[str, Any]:
    """From resampled lifts to coefficients, the whitening included."""
    import numpy as np

    from nearlift.fit.solver import minimise, system_at
    from nearlift.likelihood.covariance import Covariance
    from nearlift.likelihood.problem import Likelihood
    from nearlift.likelihood.stations import Stations
    from nearlift.models.images import SANCHEZ_CUEVAS_FREE_EXPONENT as MODEL
    from nearlift.results import Observations

    found = loaded(data, design)
    n = len(found["z"])
    zero = np.zeros(n, dtype=np.int64)
    trials = Observations(
        boundary="ground",
        trial=zero.astype(object),
        z_hat=found["z"],
        lift_N=np.exp(found["y"][0]),
        u_lift_N=np.zeros(n),
        n_eff=np.ones(n),
        throttle=found["throttle"],
        visit=found["visit"],
        session=zero,
        radius_m=0.023,
        geometry=GEOMETRY,
    )

    def work(count: int | None = None) -> Any:
        covariance = Covariance(
            variance=found["variance"],
            visit=found["visit"],
            per_visit=found["per_visit"],
            shared=np.full((n, 1), 0.002),
        )
        problem = Likelihood(model=MODEL, data=trials, covariance=covariance)
        start, scale = np.array([2.0, 1.0]), np.array([0.1, 0.05])
        stations = Stations.from_problem(problem, start, scale)
        target = stations.target(found["y"][:count])
        theta = np.tile(start, (len(target), 1))
        for some in stations.batches(len(target)):
            system = system_at(stations, target[some])
            theta[some] = minimise(system, theta[some], MODEL.bounds, scale).theta
        return theta

    # modules are loaded before the clock starts
    work(300)
    return timed(work)


def curve_and_slopes(z: Any, K_b: float, n: float) -> tuple[Any, Any, Any]:
    """Log ratio and its derivatives, by hand."""
    import numpy as np

    b = GEOMETRY["diagonal_hat"]
    log = np.log(curve(z, K_b, 1.0))
    return n * log, n * 2 * z / (b * b + 4 * z * z) ** 1.5 * np.exp(log), log


def scipy(data: Path, design: str) -> dict[str, Any]:
    import numpy as np
    from scipy.optimize import least_squares

    found = loaded(data, design)
    w = white(found)
    levels = (found["throttle"][:, None] == np.unique(found["throttle"])).astype(float)
    w_levels = w @ levels
    start = np.r_[
        2.0,
        1.0,
        [
            float(found["y"].mean(axis=0)[found["throttle"] == t].mean())
            for t in np.unique(found["throttle"])
        ],
    ]

    def one(y: Any) -> Any:
        def jacobian(x: Any) -> Any:
            _, a, b = curve_and_slopes(found["z"], x[0], x[1])
            return -np.column_stack([w @ np.column_stack([a, b]), w_levels])

        def residual(x: Any) -> Any:
            return w @ (y - levels @ x[2:] - curve_and_slopes(found["z"], x[0], x[1])[0])

        return least_squares(
            residual,
            start,
            jac=jacobian,
            method="lm",
        ).x

    return timed(lambda: np.array([one(y) for y in found["y"]]))


def lmfit(data: Path, design: str) -> dict[str, Any]:
    import lmfit as lm
    import numpy as np

    found = loaded(data, design)
    w = white(found)
    index = np.searchsorted(np.unique(found["throttle"]), found["throttle"])
    parameters = lm.Parameters()
    parameters.add("K_b", value=2.0, min=-10, max=20)
    parameters.add("n", value=1.0, min=0.1, max=2.0)
    for k in range(4):
        parameters.add(f"level{k}", value=float(found["y"].mean(axis=0)[index == k].mean()))

    def residuals(p: Any, y: Any) -> Any:
        level = np.array([p[f"level{k}"].value for k in range(4)])[index]
        return w @ (y - level - np.log(curve(found["z"], p["K_b"].value, p["n"].value)))

    def one(y: Any) -> Any:
        fitted = lm.minimize(residuals, parameters, args=(y,))
        return [fitted.params["K_b"].value, fitted.params["n"].value]

    return timed(lambda: np.array([one(y) for y in found["y"]]))


def contestant(
    name: str, title: str, work: Callable[[Path, str], Any], design: str, rounds: int | None = None
) -> Contestant:
    return Contestant(name=name, title=title, run=lambda data: work(data, design), rounds=rounds)


BENCH = Bench(
    title="A thousand bootstraps of a fit, n = 1200",
    prepare=prepare,
    one="lmfit",
    contestants=(
        contestant(
            "lmfit",
            "lmfit, one after the other, every trial at its own height",
            lmfit,
            "heights",
            rounds=3,
        ),
        contestant(
            "scipy", "scipy least_squares with a Jacobian, the same", scipy, "heights", rounds=3
        ),
        contestant("nearlift", "nearlift, the same", nearlift, "heights"),
        contestant("nearlift-stations", "nearlift, at the paper's stations", nearlift, "stations"),
    ),
    targets=(
        Target(
            work="1000 bootstraps, n = 1200, over lmfit",
            ours="nearlift",
            peer="lmfit",
            must=0.036,
            aim=1 / 45,
        ),
        Target(work="the same", ours="nearlift", quantity="peak_MiB", must=95.0),
        Target(
            work="the same at repeated stations",
            ours="nearlift-stations",
            peer="lmfit",
            must=0.036,
            aim=1 / 45,
        ),
    ),
)
