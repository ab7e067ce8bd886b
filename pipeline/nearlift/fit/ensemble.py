"""Ensemble Markov chain Monte Carlo by emcee, with differential-evolution and snooker moves; all
walkers are evaluated at once.

The chain grows in blocks. A block carries the sampler's state at its end, the generator's included,
so a chain resumed from its last block is bit for bit the uninterrupted one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit import convergence
from nearlift.fit.density import Density
from nearlift.fit.importance import peak

#: Steps per block.
BLOCK = 200
#: Approximate lattice points per standard deviation for the walkers' starts: a power of two.
LATTICE = 4096
#: Length of a chain, in autocorrelation times, from which their estimate is trusted.
LENGTHS = 50
#: Burn-in, in autocorrelation times.
BURN = 10
#: Upper limit of every parameter's R-hat.
MIXED = 1.01
#: Tail effective sample size required, as a fraction of the bulk one.
TAIL = 0.5


@dataclass(frozen=True, kw_only=True)
class Block:
    """Steps (t, w, p) with their log_prob (t, w), accepted moves per walker (w,), and the
    generator's final state: `keys`, `place` and `cached`.
    """

    theta: FloatArray
    log_prob: FloatArray
    accepted: FloatArray
    keys: NDArray[np.uint32]
    place: NDArray[np.int64]
    cached: float


@dataclass(frozen=True, kw_only=True)
class ThinnedChain:
    """A converged ensemble: thinned draws (w, n, p), log_prob (w, n), sampler statistics."""

    theta: FloatArray
    log_prob: FloatArray
    tau: FloatArray
    acceptance: float
    steps: int


def walkers(p: int, wanted: int) -> int:
    """Number of walkers for `wanted` independent draws in `LENGTHS` autocorrelation times."""
    return max(2 * math.ceil(1.25 * wanted / LENGTHS / 2), 2 * (p + 1), 32)


def begin(density: Density, rng: np.random.Generator, count: int) -> FloatArray:
    """Starting points of the walkers, (w, p), twice as widely spread about the peak as the
    first-order posterior.

    On a lattice: walkers move by each other's differences, so that rounding errors of the starts
    would grow until they changed every walker.
    """
    spread = density.spread()
    root, step = (
        2 * np.linalg.cholesky(spread),
        2.0 ** np.round(np.log2(np.sqrt(np.diag(spread)))) / LATTICE,
    )
    mean = peak(density)
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


def run(
    density: Density,
    rng: np.random.Generator,
    wanted: int,
    longest: int,
    stored: Sequence[Block],
    keep: Callable[[Block], None],
    least: int = 0,
) -> ThinnedChain:
    """Sample until every parameter has `wanted` effective draws in bulk, half as many in the tails,
    and an R-hat below `MIXED`.

    Parameters
    ----------
    rng : Generator
        Places the walkers and seeds emcee; a resumed chain needs it in the same state as the first
        time.
    wanted, longest : int
        Bulk effective sample size, and the most steps that may be spent on it.
    stored : sequence of Block
        Blocks of an interrupted run, in order. Each is assessed as if it were new, so that the
        chain ends at the same step.
    keep : callable
        Called with each new block.
    least : int
        Fewest steps.

    Raises
    ------
    NotConverged
        `longest` steps were too few; the message says how many would have been enough.
    """
    import emcee

    from nearlift.fit.snooker import SnookerMove

    p = len(density.centre)
    count = walkers(p, wanted)
    start = begin(density, rng, count)
    seed = int(rng.integers(2**32))
    sampler = emcee.EnsembleSampler(
        count, p, density, moves=[(emcee.moves.DEMove(), 0.8), (SnookerMove(), 0.2)], vectorize=True
    )
    known = [b for b in stored if b.theta.shape[1:] == (count, p)]
    blocks: list[Block] = []
    state = emcee.State(start, random_state=np.random.RandomState(seed).get_state())
    while True:
        if blocks and BLOCK * len(blocks) >= least:
            chain = _assess(blocks, wanted, longest)
            if isinstance(chain, ThinnedChain):
                return chain
            if BLOCK * len(blocks) >= longest:
                raise NotConverged(f"posterior of {density.problem.model.name}", *chain)
        if known:
            block = known.pop(0)
            blocks.append(block)
            generator = ("MT19937", block.keys, *block.place.tolist(), block.cached)
            state = emcee.State(
                block.theta[-1], log_prob=block.log_prob[-1], random_state=generator
            )
            continue
        sampler.reset()
        state = sampler.run_mcmc(state, BLOCK)
        kind, keys, position, has_cached, cached = state.random_state
        assert kind == "MT19937"
        block = Block(
            theta=sampler.get_chain(),
            log_prob=sampler.get_log_prob(),
            accepted=np.asarray(sampler.backend.accepted, dtype=np.float64),
            keys=np.asarray(keys, dtype=np.uint32),
            place=np.array([position, has_cached], dtype=np.int64),
            cached=float(cached),
        )
        keep(block)
        blocks.append(block)


def _assess(blocks: Sequence[Block], wanted: int, longest: int) -> ThinnedChain | tuple[str, str]:
    """The thinned chain if it has converged; else the shortfall and its remedy."""
    from emcee.autocorr import integrated_time

    theta = np.concatenate([b.theta for b in blocks])
    steps, count, _ = theta.shape
    late = theta[steps // 4 :]
    moving = np.ptp(late, axis=(0, 1)) > 0
    tau = np.ones(theta.shape[2])
    if moving.any():
        tau[moving] = integrated_time(late[:, :, moving], tol=0, quiet=True)
    slowest = float(np.nanmax(tau))
    if not math.isfinite(slowest):
        slowest = float(steps)
    burn = min(math.ceil(BURN * slowest), steps - 1)
    # thinning by tau / 2 costs few effective draws and saves most of the file
    thin = max(int(slowest / 2), 1)
    kept = theta[burn::thin].transpose(1, 0, 2)
    need = math.ceil(max(LENGTHS * slowest, 1.1 * wanted * slowest / count) + BURN * slowest)
    bulk, tail, mixed = 0.0, 0.0, math.inf
    if steps >= need:
        chains = [kept[:, :, i] for i in range(theta.shape[2])]
        bulk, mixed = (
            min(convergence.worth(c) for c in chains),
            max(convergence.r_hat(c) for c in chains),
        )
        tail = min(convergence.tail(c) for c in chains)
        if bulk >= wanted and tail >= TAIL * wanted and mixed < MIXED:
            accepted = sum(b.accepted for b in blocks) / steps
            log_prob = np.concatenate([b.log_prob for b in blocks])[burn::thin].T
            return ThinnedChain(
                theta=kept,
                log_prob=log_prob,
                tau=tau,
                acceptance=float(np.mean(accepted)),
                steps=steps,
            )
        short = [
            asked / max(worth, 1.0)
            for asked, worth in ((wanted, bulk), (TAIL * wanted, tail))
            if worth < asked
        ]
        need = math.ceil(steps * max([1.2, *(1.1 * s for s in short)]))
    reached = (
        f", effective draws {bulk:.0f} of {wanted}, in the tails {tail:.0f} of {TAIL * wanted:.0f},"
        f" R-hat {mixed:.3f}"
        if bulk
        else ""
    )
    return (
        f"{steps} steps of {count} walkers, tau = {slowest:.3g}{reached}",
        f"run at least {need}: `steps = {need}` in [fit] (now {longest})",
    )
