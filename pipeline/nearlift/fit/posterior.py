"""Posterior of one model at one boundary: draws, their diagnostics, and the evidence.

emcee draws base models, with differential-evolution moves of all walkers at once. An exact grid
checks chains of one or two parameters, and draws rivals of so many. The length of a chain follows
from its autocorrelation time tau (Goodman and Weare 2010, as in emcee). The effective sample size
is steps times walkers over tau.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import randomness
from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit.density import Density
from nearlift.fit.grid import PosteriorGrid, grid
from nearlift.results.fit import APART, SamplerCheck

#: Chains into which independent draws are divided: the least number for R-hat (Vehtari et al. 2021,
#: Bayesian Anal. 16, 667).
INDEPENDENT_CHAINS = 4
#: Maximum number of parameters for a grid. Ours: three would need 7 million points.
MAX_GRID_PARAMETERS = 2
#: Cumulative probabilities at which chain and grid are compared. Ours: the quoted interval, and the
#: quartiles, where a missed mode shows.
PROBABILITIES = (0.05, 0.25, 0.5, 0.75, 0.95)
#: Steps between two assessments of a chain. Ours: a chain is at most that much longer than it needs
#: to be.
BLOCK_STEPS = 200
#: Approximate lattice points per standard deviation for the walkers' starts. Ours: far below the
#: standard deviation, and a power of two, so that differences of walkers are exact.
LATTICE_POINTS = 4096
#: Length of a chain in tau from which emcee's documentation trusts the estimate of tau.
MIN_LENGTH_TAU = 50
#: Burn-in in tau. Ours: at least twice the 2 to 5 of emcee's tutorial.
BURN_IN_TAU = 10
#: Effective draws at the ends of the 90 % interval, as a fraction of those of the mean.
#: Ours: they mix more slowly, and half as many still fix an end to 0.05 standard deviations.
TAIL_ESS_SHARE = 0.5
#: Share of moves along the whole difference of two walkers, by which they change between modes
#: (ter Braak 2006, Stat. Comput. 16, 239).
JUMP_SHARE = 0.1

Stream = Callable[[str], np.random.Generator]
Progress = Callable[[int], None]
Table = dict[str, NDArray[Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Posterior:
    """Draws of a model's parameters and of L_inf.

    Attributes
    ----------
    theta, log_prob : (c, n, p), (c, n)
        Draws by chain (walker), and their unnormalised log density.
    levels_N : (c, n, k)
        L_inf per throttle for each draw, N.
    sampler : str
        "emcee", "grid", or "none" where there is nothing to sample.
    ess, ess_tail : (p,)
        Effective sample size of the mean, and of the ends of the 90 % interval.
    tau : (p,)
        Autocorrelation time in steps; 1 for independent draws.
    acceptance, steps : float, int
        Share of accepted moves, and steps, of emcee; nan and 0 without a chain.
    log_evidence, u_log_evidence : float
        Log of the marginal likelihood, L_inf's prior flat in the logarithm, and its numerical
        error; nan for more than `MAX_GRID_PARAMETERS` parameters.
    exact : PosteriorGrid or None
        The grid, if it is resolved.
    """

    names: tuple[str, ...]
    theta: FloatArray
    log_prob: FloatArray
    levels_N: FloatArray
    sampler: str
    ess: FloatArray
    ess_tail: FloatArray
    tau: FloatArray
    acceptance: float = math.nan
    steps: int = 0
    log_evidence: float = math.nan
    u_log_evidence: float = math.nan
    checks: tuple[SamplerCheck, ...] = ()
    exact: PosteriorGrid | None = None

    def quantiles(self, i: int, probabilities: Sequence[float]) -> FloatArray:
        """Quantiles of parameter i: of the grid, without Monte Carlo error, or of the draws."""
        if self.exact:
            return self.exact.quantiles(i, probabilities)
        return np.asarray(np.quantile(self.theta[:, :, i], probabilities), dtype=np.float64)

    def rows(self, boundary: str, model: str, name: str, values: FloatArray) -> Table:
        """Rows of a table of draws for one quantity; `values` are (chains, draws)."""
        chain, draw = np.indices(values.shape)
        labels = {"boundary": boundary, "model": model, "parameter": name}
        # one string for all rows: `np.full` makes one for each
        return {k: np.array([x], dtype=object).repeat(values.size) for k, x in labels.items()} | {
            "chain": chain.ravel(),
            "draw": draw.ravel(),
            "value": values.ravel(),
            "log_prob": self.log_prob.ravel(),
        }


def sample(
    density: Density,
    seed: int,
    *purpose: str,
    ess: int = 4000,
    steps: int = 20_000,
    chain: bool = True,
    progress: Progress = lambda _: None,
) -> Posterior:
    """Draw a posterior to the effective sample size asked for, and check it.

    Parameters
    ----------
    seed, purpose
        Key of the random streams; see `randomness.generator`.
    ess, steps
        Effective sample size wanted, and maximum number of emcee's steps.
    chain
        Whether emcee draws, also where a grid could.
    progress
        Called with emcee's number of steps so far.

    Raises
    ------
    NotConverged
        The chain fell short, with the number of steps that would have been enough; or chain and
        grid disagree.
    """

    def stream(part: str) -> np.random.Generator:
        return randomness.generator(seed, "posterior", part, *purpose)

    p, count = len(density.centre), -(-ess // INDEPENDENT_CHAINS) * INDEPENDENT_CHAINS
    lattice = grid(density) if 0 < p <= MAX_GRID_PARAMETERS else None
    exact = lattice if lattice and lattice.resolved else None
    if p and (chain or not exact):
        drawn = run_chain(density, stream, ess, steps, lattice, progress)
    else:
        theta = exact.draw(stream("grid"), count) if exact else np.zeros((count, 0))
        theta = np.clip(theta, *density.problem.model.bounds)
        chains = theta.reshape(INDEPENDENT_CHAINS, count // INDEPENDENT_CHAINS, p)
        drawn = Posterior(
            names=density.problem.names,
            theta=chains,
            levels_N=levels(density, chains, stream("levels")),
            log_prob=density(theta).reshape(chains.shape[:2]),
            sampler="grid" if p else "none",
            ess=np.full(p, float(count)),
            ess_tail=np.full(p, float(count)),
            tau=np.ones(p),
        )
    evidence = (float(drawn.log_prob[0, 0]), 0.0) if not p else (math.nan, math.nan)
    if lattice:
        evidence = lattice.log_evidence, lattice.u_log_evidence
    return replace(drawn, log_evidence=evidence[0], u_log_evidence=evidence[1], exact=exact)


def run_chain(
    density: Density,
    stream: Stream,
    ess: int,
    most: int,
    lattice: PosteriorGrid | None = None,
    progress: Progress = lambda _: None,
) -> Posterior:
    """Draws by emcee, thinned: `ess` effective ones of every parameter, half as many in the tails.

    A chain that disagrees with the grid is continued to twice its length. One that missed a slow
    mode looks better than it is, and only more steps show that.

    Raises
    ------
    NotConverged
        `most` steps were too few; the message has a number that would have been enough. Or chain
        and grid still disagree.
    """
    import emcee

    p, place = len(density.centre), f"posterior of {density.problem.model.name}"
    count = max(2 * math.ceil(1.25 * ess / MIN_LENGTH_TAU / 2), 2 * (p + 1), 32)
    rng = stream("emcee")
    begin = start(density, rng, count)
    generator = np.random.RandomState(int(rng.integers(2**32)))
    moves = [(emcee.moves.DEMove(), 1 - JUMP_SHARE), (emcee.moves.DEMove(gamma0=1.0), JUMP_SHARE)]
    sampler = emcee.EnsembleSampler(count, p, density, moves=moves, vectorize=True)
    # emcee's wrapper prints a traceback where a run is interrupted
    sampler.log_prob_fn = density
    state = emcee.State(begin, random_state=generator.get_state())
    least = 0
    while True:
        state = sampler.run_mcmc(state, BLOCK_STEPS)
        steps = sampler.iteration
        progress(steps)
        if steps < least:
            continue
        theta = sampler.get_chain()
        tau = autocorrelation_time(theta[steps // 4 :])
        slowest = float(tau.max())
        burn = min(math.ceil(BURN_IN_TAU * slowest), steps - 1)
        late = theta[burn:]
        reached = len(late) * count / tau
        need = math.ceil(max(MIN_LENGTH_TAU, 1.1 * ess / count) * slowest) + burn
        if steps >= need:
            ends = np.quantile(late, [0.05, 0.95], axis=(0, 1))
            tail = np.min([effective_draws((late <= end).astype(float)) for end in ends], axis=0)
            short = max(ess / reached.min(), TAIL_ESS_SHARE * ess / max(float(tail.min()), 1.0))
            if short <= 1:
                # two draws for each effective one asked for: more would add little. Not fewer of
                # a walker than there are walkers, for which arviz warns of a mistake
                thin = max(len(late) // max(2 * ess // count, count), 1)
                kept = late[::thin].transpose(1, 0, 2)
                check = compare(density.problem.names, kept, lattice) if lattice else None
                if not (check and check.failed):
                    return Posterior(
                        names=density.problem.names,
                        theta=kept,
                        levels_N=levels(density, kept, stream("levels")),
                        log_prob=sampler.get_log_prob()[burn::thin].T,
                        sampler="emcee",
                        tau=tau,
                        ess=reached,
                        ess_tail=tail,
                        acceptance=float(np.mean(sampler.acceptance_fraction)),
                        steps=steps,
                        checks=(check,) if check else (),
                    )
                if not least and 2 * steps <= most:
                    least = 2 * steps
                    continue
                raise NotConverged(
                    place,
                    f"emcee and the grid disagree: {check.where},"
                    f" {check.apart:.1f} Monte Carlo standard errors apart (at most {APART:g})",
                    f"a longer chain may agree: `steps = {4 * steps}` in [fit] (now {most});"
                    " there may be several peaks, or one at a bound",
                )
            need = math.ceil(steps * max(1.2, 1.1 * short))
        if steps >= most:
            raise NotConverged(
                place,
                f"{steps} steps of {count} walkers, tau = {slowest:.3g}, effective draws"
                f" {reached.min():.0f} of {ess}",
                f"run at least {need}: `steps = {need}` in [fit] (now {most})",
            )


def start(density: Density, rng: np.random.Generator, count: int) -> FloatArray:
    """Starting points of the walkers about the fit, (w, p), with twice its standard uncertainties.

    They are on a lattice: walkers move by each other's differences, so that rounding errors of the
    starts would grow until they changed every walker.
    """
    mean, spread = density.peak, density.spread
    root = 2 * np.linalg.cholesky(spread)
    step = 2.0 ** np.round(np.log2(np.sqrt(np.diag(spread)))) / LATTICE_POINTS
    places = np.empty((0, len(mean)))
    for attempt in range(200):
        offset = rng.standard_normal((count, len(mean))) @ root.T / (1 + attempt / 10)
        some = step * np.round((mean + offset) / step)
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
    size: FloatArray = steps.shape[0] * steps.shape[1] / autocorrelation_time(steps)
    return size


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


def compare(names: Sequence[str], theta: FloatArray, lattice: PosteriorGrid) -> SamplerCheck:
    """Largest disagreement of a chain's quantiles with a grid, in Monte Carlo standard errors.

    `theta` (w, n, p) are the draws by walker. Every quantile has its own effective sample size.
    """
    worst, where = 0.0, ""
    steps = theta.transpose(1, 0, 2)
    for probability in PROBABILITIES:
        values = np.quantile(theta, probability, axis=(0, 1))
        size = effective_draws((steps <= values).astype(float))
        for i, name in enumerate(names):
            error = math.sqrt(probability * (1 - probability) / size[i]) + lattice.error / APART
            share = lattice.below(i, float(values[i]))
            if abs(share - probability) > worst * error:
                worst = abs(share - probability) / error
                where = (
                    f"{100 * probability:.0f} % of {name} lie below {values[i]:.5g} by emcee,"
                    f" {100 * share:.1f} % by the grid"
                )
    unfit = f"too coarse for this shape: half the resolution moves shares by {lattice.error:.3f}"
    return SamplerCheck(
        by="grid", apart=worst, where=where, unfit="" if lattice.resolved else unfit
    )


def levels(density: Density, theta: FloatArray, rng: np.random.Generator) -> FloatArray:
    """L_inf in N for draws (c, n, p): (c, n, k).

    Its logarithm given theta has Student's t distribution, since the noise scale is uncertain.
    """
    flat = theta.reshape(theta.shape[0] * theta.shape[1], theta.shape[2])
    triangle = np.linalg.cholesky(density.problem.level_covariance).astype(np.float64)
    root = density.problem.data.shown(triangle)
    scale = np.ones(len(flat))
    if math.isfinite(density.dof):
        departure = np.maximum(density.departure(flat), 0.0)
        scale = np.sqrt(
            (density.dof + departure) / rng.chisquare(density.dof + theta.shape[-1], len(flat))
        )
    noise = rng.standard_normal((len(flat), root.shape[1])) @ root.T
    levels_N = np.exp(density.stations.log_levels(flat) + scale[:, None] * noise)
    return levels_N.reshape(*theta.shape[:-1], -1)
