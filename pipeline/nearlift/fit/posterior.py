"""Posterior of one model at one boundary: draws, their diagnostics, and the evidence.

emcee (`fit.ensemble`) draws base models, and an exact grid checks chains of one or two parameters.
Rivals of one or two parameters are drawn from that grid.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift import randomness
from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit import ensemble
from nearlift.fit.density import Density
from nearlift.fit.ensemble import effective_draws
from nearlift.fit.grid import PosteriorGrid, grid
from nearlift.results.posterior import APART, SamplerCheck

#: Chains into which independent draws are divided, for the usual diagnostics.
CHAINS = 4
#: Maximum number of parameters for a grid.
GRID = 2
#: Cumulative probabilities at which chain and grid are compared.
PROBABILITIES = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Effective sample size wanted, and maximum number of emcee's steps."""

    ess: int = 4000
    steps: int = 20_000

    @property
    def draws(self) -> int:
        """Independent draws from a grid, divided evenly among `CHAINS`."""
        return -(-self.ess // CHAINS) * CHAINS


@dataclass(frozen=True, slots=True, kw_only=True)
class Posterior:
    """Draws of a model's parameters and of L_inf.

    Attributes
    ----------
    names : tuple of str
        Of the parameters.
    theta, log_prob : (c, n, p), (c, n)
        Draws by chain, and their unnormalised log density.
    levels_N : (c, n, k)
        L_inf per throttle for each draw, N.
    sampler : str
        "emcee", "grid", or "none" where there is nothing to sample.
    ess, ess_tail : (p,)
        Effective sample size of the mean, and of the ends of the 90 % interval.
    tau : (p,)
        Autocorrelation time in steps; 1 for independent draws.
    acceptance : float
        Share of accepted moves; nan without a chain.
    log_evidence, u_log_evidence : float
        Log of the marginal likelihood, L_inf's prior flat in the logarithm, and its numerical
        error; nan for more than `GRID` parameters.
    steps : int
        Steps of emcee.
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
    log_evidence: float = math.nan
    u_log_evidence: float = math.nan
    steps: int = 0
    checks: tuple[SamplerCheck, ...] = ()
    exact: PosteriorGrid | None = None

    def flat(self) -> FloatArray:
        """All draws of the parameters, (c n, p)."""
        return self.theta.reshape(self.log_prob.size, len(self.names))


def ignore_steps(_: int) -> None:
    """Report no progress."""


def sample(
    density: Density,
    settings: Settings,
    seed: int,
    *purpose: str,
    chain: bool = True,
    progress: Callable[[int], None] = ignore_steps,
) -> Posterior:
    """Draw a posterior to the effective sample size asked for, and check it.

    Parameters
    ----------
    seed, purpose
        Key of the random streams; see `randomness.generator`.
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
    names = density.problem.names

    def stream(part: str) -> np.random.Generator:
        return randomness.generator(seed, "posterior", part, *purpose)

    if not names:
        drawn = _independent(density, np.zeros((settings.draws, 0)), "none", stream("levels"))
        log = float(drawn.log_prob[0, 0])
        return replace(drawn, log_evidence=log, u_log_evidence=0.0)
    lattice = grid(density) if len(names) <= GRID else None
    if lattice and lattice.resolved and not chain:
        theta = np.clip(lattice.draw(stream("grid"), settings.draws), *density.problem.model.bounds)
        drawn = _independent(density, theta, "grid", stream("levels"))
    else:
        drawn = _chained(density, settings, stream, lattice, progress)
    if lattice is None:
        return drawn
    return replace(
        drawn,
        log_evidence=lattice.log_evidence,
        u_log_evidence=lattice.u_log_evidence,
        exact=lattice if lattice.resolved else None,
    )


def _chained(
    density: Density,
    settings: Settings,
    stream: Callable[[str], np.random.Generator],
    lattice: PosteriorGrid | None,
    progress: Callable[[int], None],
) -> Posterior:
    """Draws by emcee, checked by the grid; a chain that disagrees is repeated at twice its length.

    A chain that missed a slow mode looks better than it is, and only more steps show that.
    """
    least = 0
    while True:
        chain = ensemble.run(
            density, stream("emcee"), settings.ess, settings.steps, least, progress
        )
        check = compare(density.problem.names, chain.theta, lattice) if lattice else None
        if not check or not check.failed:
            break
        if least or 2 * chain.steps > settings.steps:
            raise NotConverged(
                f"posterior of {density.problem.model.name}",
                f"emcee and the grid disagree: {check.where}, {check.apart:.1f} Monte Carlo"
                f" standard errors apart (at most {APART:g})",
                f"a longer chain may agree: `steps = {4 * chain.steps}` in [fit] (now"
                f" {settings.steps}); there may be several peaks, or one at a bound",
            )
        least = 2 * chain.steps
    return Posterior(
        names=density.problem.names,
        theta=chain.theta,
        levels_N=levels(density, chain.theta, stream("levels")),
        log_prob=chain.log_prob,
        sampler="emcee",
        ess=chain.ess,
        ess_tail=chain.ess_tail,
        tau=chain.tau,
        acceptance=chain.acceptance,
        steps=chain.steps,
        checks=(check,) if check else (),
    )


def compare(names: Sequence[str], theta: FloatArray, lattice: PosteriorGrid) -> SamplerCheck:
    """Largest disagreement of a chain's quantiles with a grid, in Monte Carlo standard errors.

    `theta` (w, n, p) are the draws by walker. Every quantile has its own effective sample size.
    """
    worst, where = 0.0, ""
    quantiles = np.quantile(theta, PROBABILITIES, axis=(0, 1))
    steps = theta.transpose(1, 0, 2)
    for probability, values in zip(PROBABILITIES, quantiles, strict=True):
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
    unfit = (
        ""
        if lattice.resolved
        else f"too coarse for this shape: half the resolution moves shares by {lattice.error:.3f}"
    )
    return SamplerCheck(by="grid", apart=worst, where=where, unfit=unfit)


def _independent(
    density: Density, theta: FloatArray, sampler: str, rng: np.random.Generator
) -> Posterior:
    """Independent draws (m, p) as `CHAINS` chains."""
    m, p = theta.shape
    chains = theta.reshape(CHAINS, m // CHAINS, p)
    size = np.full(p, float(m))
    return Posterior(
        names=density.problem.names,
        theta=chains,
        levels_N=levels(density, chains, rng),
        log_prob=density(theta).reshape(chains.shape[:2]),
        sampler=sampler,
        ess=size,
        ess_tail=size,
        tau=np.ones(p),
    )


def levels(density: Density, theta: FloatArray, rng: np.random.Generator) -> FloatArray:
    """L_inf in N for draws (c, n, p): (c, n, k).

    Its logarithm given theta has Student's t distribution, since the noise scale is uncertain.
    """
    flat = theta.reshape(theta.shape[0] * theta.shape[1], theta.shape[2])
    triangle = np.linalg.cholesky(density.problem.level_covariance)
    root = density.problem.data.shown(np.asarray(triangle, dtype=np.float64))
    centre = density.stations.log_levels(flat)
    scale = np.ones(len(flat))
    if math.isfinite(density.dof):
        departure = np.maximum(density.stations.chi2(flat) - density.least, 0.0)
        scale = np.sqrt(
            (density.dof + departure) / rng.chisquare(density.dof + theta.shape[-1], len(flat))
        )
    noise = rng.standard_normal((len(flat), root.shape[1])) @ root.T
    return np.asarray(
        np.exp(centre + scale[:, None] * noise).reshape(*theta.shape[:-1], -1), dtype=np.float64
    )
