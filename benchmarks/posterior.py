"""A posterior to 4000 effective draws, whole process, compared with emcee as a lab would write it.

One simulated campaign near the ground (Sanchez-Cuevas with a free exponent, four throttles), its
covariance known. Each contestant runs in a process of its own, imports included, and stops by its
own measure; the bulk effective sample size of what it returns is then taken by one yardstick for
all, outside the clock. Ratios count, times are orientation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.harness import Bench, Contestant, Target

NAMES = ("K_b", "n")
MODEL = "sanchez_cuevas_free_exponent"
GEOMETRY = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}


def write(path: Path) -> None:
    """A campaign of 320 trials: ten stations, eight visits, four throttles, an error of each
    visit's height.
    """
    import numpy as np

    rng = np.random.default_rng(1)
    stations = np.array([1.14, 1.3, 1.5, 1.8, 2.2, 2.84, 4.0, 6.0, 9.0, 11.5])
    z = np.repeat(rng.permutation(np.repeat(stations, 8)), 4)
    throttle = np.tile([0.25, 0.5, 0.75, 0.92], 80)
    level = np.array([0.107, 0.239, 0.409, 0.551])[np.tile(np.arange(4), 80)]
    ratio = curve(z, 2.0, 1.0)
    slope = (
        (np.log(curve(z * 1.0001, 2.0, 1.0)) - np.log(curve(z * 0.9999, 2.0, 1.0)))
        / (0.0002 * z)
        / 0.023
    )
    visit = np.repeat(np.arange(80), 4)
    log = (
        np.log(level * ratio)
        + rng.normal(0, 0.005, 320)
        + 1e-4 * slope * rng.normal(size=80)[visit]
    )
    np.savez(
        path,
        z=z,
        throttle=throttle,
        lift=np.exp(log),
        visit=visit,
        variance=np.full(320, 0.005**2),
        shared=1e-4 * slope,
    )


def curve(z: Any, K_b: Any, n: Any) -> Any:
    """The model, as anyone would write it."""
    d, b = GEOMETRY["spacing_hat"], GEOMETRY["diagonal_hat"]

    def image(h: Any) -> Any:
        return z / (h * h + 4 * z * z) ** 1.5

    return (1 - 1 / (16 * z * z) - image(d) - 0.5 * image(2**0.5 * d) - 2 * K_b * image(b)) ** -n


def nearlift(path: Path, ess: int, chain: bool) -> Any:
    """nearlift: emcee checked by a grid, or the grid alone."""
    import numpy as np

    from nearlift.fit import posterior
    from nearlift.fit.density import Density
    from nearlift.likelihood.covariance import Covariance
    from nearlift.likelihood.problem import Likelihood
    from nearlift.models.images import SANCHEZ_CUEVAS_FREE_EXPONENT as model
    from nearlift.results import Observations

    found = dict(np.load(path))
    n = len(found["z"])
    zero = np.zeros(n, dtype=np.int64)
    data = Observations(
        boundary="ground",
        trial=zero.astype(object),
        z_hat=found["z"],
        lift_N=found["lift"],
        u_lift_N=np.zeros(n),
        n_eff=np.ones(n),
        throttle=found["throttle"],
        visit=found["visit"],
        session=zero,
        radius_m=0.023,
        geometry=GEOMETRY,
    )
    covariance = Covariance(
        variance=found["variance"],
        visit=found["visit"],
        per_visit=found["shared"],
        shared=np.zeros((n, 0)),
    )
    density = Density(
        problem=Likelihood(model=model, data=data, covariance=covariance),
        centre=np.array([p.value for p in model.parameters]),
    )
    return posterior.sample(density, 1, ess=ess, chain=chain).theta


def whitener(found: dict[str, Any]) -> Any:
    import numpy as np

    same = found["visit"][:, None] == found["visit"]
    return np.linalg.cholesky(
        np.diag(found["variance"]) + same * np.outer(found["shared"], found["shared"])
    )


def log_prior(theta: Any) -> Any:
    """Of K_b and n, (m,)."""
    import numpy as np

    K_b, n = theta[:, 0], theta[:, 1]
    inside = (K_b > -10) & (K_b < 20) & (n > 0.1) & (n < 2)
    return np.where(inside, -0.5 * ((K_b - 2) / 4) ** 2 - 0.5 * ((n - 0.8) / 0.4) ** 2, -np.inf)


def vectorised(path: Path, ess: int, eliminate: bool) -> Any:
    """emcee, all walkers at once, differential evolution; L_inf sampled with the rest, or
    eliminated beforehand.
    """
    import emcee
    import numpy as np

    found = dict(np.load(path))
    white = np.linalg.inv(whitener(found))
    level = (found["throttle"][:, None] == np.unique(found["throttle"])).astype(float)
    y = white @ np.log(found["lift"])
    x = white @ level
    if eliminate:
        q = np.linalg.qr(x)[0]
        white, y = white - q @ (q.T @ white), y - q @ (q.T @ y)

    def log_prob(theta: Any) -> Any:
        prior = log_prior(theta)
        with np.errstate(invalid="ignore"):
            model = np.log(curve(found["z"], theta[:, :1], theta[:, 1:2]))
        r = y - np.nan_to_num(model) @ white.T
        if not eliminate:
            r = r - theta[:, 2:] @ x.T
        return prior - 0.5 * np.einsum("ij,ij->i", r, r)

    rng = np.random.default_rng(1)
    p = 2 if eliminate else 6
    start = np.array([2.0, 1.0, *np.log([0.107, 0.239, 0.409, 0.551])])[
        :p
    ] + 0.01 * rng.standard_normal((128, p))
    moves = [(emcee.moves.DEMove(), 0.8), (emcee.moves.DESnookerMove(), 0.2)]
    sampler = emcee.EnsembleSampler(128, p, log_prob, moves=moves, vectorize=True)
    return until(sampler, start, ess)


def scalar(path: Path, ess: int) -> Any:
    """What a lab would write: one parameter vector at a time, stretch moves, the covariance solved
    for each.
    """
    import emcee
    import numpy as np
    from scipy.linalg import cho_solve

    found = dict(np.load(path))
    factor = (whitener(found), True)
    index = np.searchsorted(np.unique(found["throttle"]), found["throttle"])
    log_lift = np.log(found["lift"])

    def log_prob(theta: Any) -> float:
        prior = float(log_prior(theta[None])[0])
        if not math.isfinite(prior):
            return -math.inf
        r = log_lift - theta[2:][index] - np.log(curve(found["z"], theta[0], theta[1]))
        value = prior - 0.5 * float(r @ cho_solve(factor, r))
        return value if math.isfinite(value) else -math.inf

    rng = np.random.default_rng(1)
    start = np.array(
        [2.0, 1.0, *np.log([0.107, 0.239, 0.409, 0.551])]
    ) + 0.01 * rng.standard_normal((32, 6))
    return until(emcee.EnsembleSampler(32, 6, log_prob), start, ess)


def until(sampler: Any, start: Any, ess: int) -> Any:
    """Go on until emcee's own autocorrelation time says that there are `ess` draws and the chain is
    50 times as long.
    """
    state = start
    while True:
        state = sampler.run_mcmc(state, 500, skip_initial_state_check=True)
        steps = sampler.iteration
        tau = float(sampler.get_autocorr_time(tol=0, quiet=True)[:2].max())
        burn = int(5 * tau)
        if steps > 50 * tau and (steps - burn) * sampler.nwalkers / tau >= ess:
            return sampler.get_chain(discard=burn)[:, :, :2].swapaxes(0, 1)
        if steps > 200_000:
            raise SystemExit("no convergence in 200000 steps")


ESS = 4000
DATA = "posterior.npz"


def prepare(data: Path, quick: bool) -> str:
    write(data / DATA)
    return (
        "320 trials near the ground, Sanchez-Cuevas with a free exponent, four throttles, the"
        f" covariance known, to {ESS} draws; whole process."
    )


def contestant(
    name: str, title: str, draw: Callable[[Path, int], Any], rounds: int | None = None
) -> Contestant:
    def run(data: Path) -> Callable[[], dict[str, float]]:
        draws = draw(data / DATA, ESS)

        def yardstick() -> dict[str, float]:
            from nearlift.fit.posterior import effective_draws

            size = effective_draws(draws[:, :, :1].swapaxes(0, 1))[0]
            return {
                "ESS of K_b": float(round(size)),
                "sd of K_b": float(draws[:, :, 0].std()),
            }

        return yardstick

    return Contestant(name=name, title=title, run=run, rounds=rounds)


BENCH = Bench(
    title="A posterior to 4000 effective draws",
    prepare=prepare,
    one="vectorised",
    rounds=3,
    contestants=(
        contestant(
            "vectorised",
            "emcee vectorised, DE + snooker, `L_inf` sampled",
            lambda p, e: vectorised(p, e, eliminate=False),
        ),
        contestant(
            "eliminated",
            "the same, `L_inf` eliminated beforehand",
            lambda p, e: vectorised(p, e, eliminate=True),
        ),
        contestant(
            "nearlift",
            "nearlift, emcee, checked by a grid",
            lambda p, e: nearlift(p, e, chain=True),
        ),
        contestant(
            "nearlift-grid",
            "nearlift, exact grid",
            lambda p, e: nearlift(p, e, chain=False),
        ),
        contestant(
            "scalar",
            "emcee scalar, stretch moves, a solve for each, as a lab would write it",
            scalar,
            rounds=1,
        ),
    ),
    targets=(
        Target(
            work="posterior to ESS 4000 over vectorised emcee",
            ours="nearlift",
            peer="vectorised",
            must=0.5,
            aim=0.5,
        ),
    ),
    note=(
        "Each stops by its own measure; the effective draws of what it returns are by"
        " emcee's autocorrelation time, one yardstick for all, outside the clock. The exact"
        " standard deviation of `K_b` is 0.118."
    ),
)
