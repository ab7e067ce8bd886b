"""Ensemble sampling by emcee with differential-evolution moves, all walkers evaluated at once.

The length of a chain follows from its autocorrelation time tau (Goodman and Weare 2010, as in
emcee). The effective sample size is steps times walkers over tau.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit.density import Density

#: Steps between two assessments.
BLOCK = 200
#: Approximate lattice points per standard deviation for the walkers' starts: a power of two.
LATTICE = 4096
#: Length of a chain in tau from which emcee's documentation trusts the estimate of tau.
LENGTHS = 50
#: Burn-in in tau; emcee's tutorial takes 2 to 5.
BURN = 10
#: Effective draws at the ends of the 90 % interval, as a fraction of those of the mean.
TAIL = 0.5
#: Share of moves along the whole difference of two walkers, by which they change between modes
#: (ter Braak 2006, Stat. Comput. 16, 239).
JUMPS = 0.1


@dataclass(frozen=True, kw_only=True)
class ThinnedChain:
    """A converged ensemble: thinned draws (w, n, p), log_prob (w, n), sampler statistics.

    `ess` and `ess_tail` (p,) are the effective draws of the mean and of the ends of the 90 %
    interval.
    """

    theta: FloatArray
    log_prob: FloatArray
    tau: FloatArray
    ess: FloatArray
    ess_tail: FloatArray
    acceptance: float
    steps: int


def walkers(p: int, wanted: int) -> int:
    """Number of walkers for `wanted` independent draws in `LENGTHS` autocorrelation times."""
    return max(2 * math.ceil(1.25 * wanted / LENGTHS / 2), 2 * (p + 1), 32)


def begin(density: Density, rng: np.random.Generator, count: int) -> FloatArray:
    """Starting points of the walkers about the fit, (w, p), twice as wide as the first order.

    They are on a lattice: walkers move by each other's differences, so that rounding errors of the
    starts would grow until they changed every walker.
    """
    mean, spread = density.peak, density.spread()
    root = 2 * np.linalg.cholesky(spread)
    step = 2.0 ** np.round(np.log2(np.sqrt(np.diag(spread)))) / LATTICE
    p = len(mean)
    places = np.empty((0, p))
    for attempt in range(200):
        some = step * np.round(
            (mean + rng.standard_normal((count, p)) @ root.T / (1 + attempt / 10)) / step
        )
        places = np.vstack([places, some[np.isfinite(density(some))]])
        if len(places) >= count:
            return places[:count]
    raise NotConverged(
        f"posterior of {density.problem.model.name}",
        "no place near the fit has a finite density to start walkers from",
        "look at the fit and its bounds",
    )


def effective_draws(steps: FloatArray) -> FloatArray:
    """Effective sample size of each quantity of steps (t, w, q), (q,); all if one is constant."""
    size = steps.shape[0] * steps.shape[1]
    return np.asarray(size / autocorrelation_time(steps), dtype=np.float64)


def autocorrelation_time(steps: FloatArray) -> FloatArray:
    """Integrated autocorrelation time by emcee of steps (t, w, q), (q,); 1 if one is constant."""
    from emcee.autocorr import integrated_time

    tau = np.ones(steps.shape[2])
    for i, each in enumerate(np.moveaxis(steps, 2, 0)):
        # the autocorrelation of a walker that never moves is 0 / 0
        moving = each[:, np.ptp(each, axis=0) > 0]
        if moving.size:
            tau[i] = max(float(integrated_time(moving[:, :, None], tol=0, quiet=True)[0]), 1.0)
    return tau


def run(
    density: Density,
    rng: np.random.Generator,
    wanted: int,
    longest: int,
    least: int = 0,
    progress: Callable[[int], None] = lambda _: None,
) -> ThinnedChain:
    """Sample until every parameter has `wanted` effective draws, half as many in the tails.

    Parameters
    ----------
    rng : Generator
        Places the walkers and seeds emcee.
    wanted, longest, least : int
        Effective sample size, and the most and fewest steps.
    progress : callable
        Called with the number of steps so far.

    Raises
    ------
    NotConverged
        `longest` steps were too few; the message has the number that would have been enough.
    """
    import emcee

    p = len(density.centre)
    count = walkers(p, wanted)
    start = begin(density, rng, count)
    generator = np.random.RandomState(int(rng.integers(2**32)))
    moves = [(emcee.moves.DEMove(), 1 - JUMPS), (emcee.moves.DEMove(gamma0=1.0), JUMPS)]
    sampler = emcee.EnsembleSampler(count, p, density, moves=moves, vectorize=True)
    # emcee's wrapper prints a traceback where a run is interrupted
    sampler.log_prob_fn = density
    state = emcee.State(start, random_state=generator.get_state())
    while True:
        state = sampler.run_mcmc(state, BLOCK)
        steps = sampler.iteration
        progress(steps)
        if steps < least:
            continue
        theta = sampler.get_chain()
        tau = autocorrelation_time(theta[steps // 4 :])
        slowest = float(tau.max())
        burn = min(math.ceil(BURN * slowest), steps - 1)
        need = math.ceil(max(LENGTHS, 1.1 * wanted / count) * slowest) + burn
        late = theta[burn:]
        ess, tail = late.shape[0] * count / tau, np.zeros(p)
        if steps >= need:
            ends = np.quantile(late, [0.05, 0.95], axis=(0, 1))
            tail = np.min([effective_draws((late <= end).astype(float)) for end in ends], axis=0)
            if ess.min() >= wanted and tail.min() >= TAIL * wanted:
                # thinning by tau / 2 costs few effective draws and saves most of the file
                thin = max(int(slowest / 2), 1)
                return ThinnedChain(
                    theta=late[::thin].transpose(1, 0, 2),
                    log_prob=sampler.get_log_prob()[burn::thin].T,
                    tau=tau,
                    ess=ess,
                    ess_tail=tail,
                    acceptance=float(np.mean(sampler.acceptance_fraction)),
                    steps=steps,
                )
            short = max(wanted / ess.min(), TAIL * wanted / max(float(tail.min()), 1.0))
            need = math.ceil(steps * max(1.2, 1.1 * short))
        if steps >= longest:
            raise NotConverged(
                f"posterior of {density.problem.model.name}",
                f"{steps} steps of {count} walkers, tau = {slowest:.3g}, effective draws"
                f" {ess.min():.0f} of {wanted}",
                f"run at least {need}: `steps = {need}` in [fit] (now {longest})",
            )
