"""Posterior of one model at one boundary, sampled and cross-checked.

The default is importance sampling (`fit.importance`); emcee (`fit.ensemble`) serves where its
weights cannot be trusted, and on request. Each judges the other where it can, and for one or two
parameters so does a grid.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from nearlift import randomness
from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit import agreement, convergence, ensemble, importance, pareto
from nearlift.fit.agreement import PROBABILITIES
from nearlift.fit.density import Density
from nearlift.fit.ensemble import Block
from nearlift.fit.grid import grid
from nearlift.fit.importance import Weighted
from nearlift.results.posterior import SamplerCheck

Sampler = Literal["auto", "emcee", "importance"]
#: Chains into which independent draws are divided, for the usual diagnostics.
CHAINS = 4
#: Maximum number of parameters for a grid.
GRID = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Sampler, effective sample size wanted, and maximum number of emcee steps."""

    sampler: Sampler = "auto"
    ess: int = 4000
    steps: int = 20_000

    @property
    def draws(self) -> int:
        """Independent draws made: a tenth above `ess`, since its estimate scatters."""
        return -(-11 * self.ess // (10 * CHAINS)) * CHAINS


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
        "importance", "emcee", or "none" where there is nothing to sample.
    ess, ess_tail, r_hat : (p,)
        Bulk and tail effective sample size; R-hat, nan for independent draws.
    tau : (p,)
        Autocorrelation time in steps; 1 for independent draws.
    acceptance, pareto_k : float
        nan where they do not apply.
    log_evidence, u_log_evidence : float
        Log of the marginal likelihood, L_inf's prior flat in the logarithm, and its Monte Carlo
        standard error.
    steps : int
        Steps of emcee.
    checks : tuple of SamplerCheck
    """

    names: tuple[str, ...]
    theta: FloatArray
    log_prob: FloatArray
    levels_N: FloatArray
    sampler: str
    ess: FloatArray
    ess_tail: FloatArray
    r_hat: FloatArray
    tau: FloatArray
    acceptance: float = math.nan
    pareto_k: float = math.nan
    log_evidence: float = math.nan
    u_log_evidence: float = math.nan
    steps: int = 0
    checks: tuple[SamplerCheck, ...] = ()

    def flat(self) -> FloatArray:
        """All draws of the parameters, (c n, p)."""
        return self.theta.reshape(self.log_prob.size, len(self.names))


Stream = Callable[[str], np.random.Generator]


def forget(_: Block) -> None:
    """Discard a block."""


def sample(
    density: Density,
    settings: Settings,
    seed: int,
    *purpose: str,
    stored: Sequence[Block] = (),
    keep: Callable[[Block], None] = forget,
) -> Posterior:
    """Sample a posterior to the effective sample size asked for, and cross-check it.

    Parameters
    ----------
    density : Density
    settings : Settings
    seed, purpose
        Key of the random streams; see `randomness.generator`.
    stored, keep
        Blocks of an interrupted emcee chain, and the callback for new ones; see `ensemble.run`.

    Raises
    ------
    NotConverged
        The sampler fell short, with the number that would have been enough; or two computations
        of the posterior disagree.
    """
    names, model = density.problem.names, density.problem.model.name

    def stream(part: str) -> np.random.Generator:
        return randomness.generator(seed, "posterior", part, *purpose)

    if not names:
        return _without_parameters(density, settings, stream)
    weighted = importance.sample(density, stream("importance"), settings.draws)
    if settings.sampler == "importance" and weighted.pareto_k >= pareto.LIMIT:
        raise NotConverged(
            f"posterior of {model}",
            f"the weights of {len(weighted.weight)} draws have Pareto k = {weighted.pareto_k:.2f},"
            f" above {pareto.LIMIT}",
            f"weights like these would want {pareto.enough(weighted.pareto_k):.2g} draws; say"
            ' `sampler = "emcee"` in [fit]',
        )
    judges = (
        [agreement.grid_judge(grid(density, *weighted.moments()))] if len(names) <= GRID else []
    )
    value, u = weighted.log_evidence
    drawn = _from_weights(density, weighted, settings, stream)
    quantiles = np.stack([weighted.quantile(i, PROBABILITIES) for i in range(len(names))])
    checks = [
        agreement.compare(names, quantiles, np.full(quantiles.shape, weighted.ess), judge)
        for judge in judges
    ]
    passed = (
        weighted.pareto_k < pareto.LIMIT
        and drawn.ess.min() >= settings.ess
        and not any(c.failed for c in checks)
    )
    remedy = (
        'there may be several peaks, or one at a bound: `sampler = "emcee"` in [fit] looks for them'
        " in another way"
    )
    if settings.sampler == "emcee" or (settings.sampler == "auto" and not passed):
        others = [agreement.importance_judge(weighted), *judges]
        blocks: list[Block] = []

        def both(block: Block) -> None:
            blocks.append(block)
            keep(block)

        chain = ensemble.run(density, stream("emcee"), settings.ess, settings.steps, stored, both)
        drawn, checks = _judged(density, chain, weighted, others, stream)
        twice = 2 * chain.steps
        longer = min(twice, settings.steps)
        if any(c.failed for c in checks) and longer > chain.steps:
            # a chain that missed a slow mode looks better than it is: only more steps tell
            so_far = [*stored, *blocks]
            chain = ensemble.run(
                density, stream("emcee"), settings.ess, settings.steps, so_far, keep, least=longer
            )
            drawn, checks = _judged(density, chain, weighted, others, stream)
        remedy = _after(chain, twice, settings)
    agreement.insist(model, drawn.sampler, checks, remedy)
    return replace(drawn, checks=tuple(checks), log_evidence=value, u_log_evidence=u)


def _judged(
    density: Density,
    chain: ensemble.ThinnedChain,
    weighted: Weighted,
    judges: Sequence[agreement.Judge],
    stream: Stream,
) -> tuple[Posterior, list[SamplerCheck]]:
    """A chain's posterior and its comparison with each judge; every quantile has its own effective
    sample size, smaller in the tails.
    """
    drawn = _from_chain(density, chain, weighted, stream)
    quantiles = np.quantile(drawn.flat(), PROBABILITIES, axis=0).T
    worth = [
        [convergence.worth((c <= value).astype(float)) for value in row]
        for c, row in zip(np.moveaxis(drawn.theta, -1, 0), quantiles, strict=True)
    ]
    return drawn, [
        agreement.compare(drawn.names, quantiles, np.array(worth), judge) for judge in judges
    ]


def _after(chain: ensemble.ThinnedChain, twice: int, settings: Settings) -> str:
    """Remedy for a chain that disagrees with its judges, even at `twice` its length if allowed."""
    if settings.steps < twice:
        return f"a longer chain may agree: `steps = {twice}` in [fit] (now {settings.steps})"
    return (
        f"{chain.steps} steps, twice those that seemed enough, did not mend it: there may be"
        " several peaks, or one at a bound; another seed shows which is wrong, and `sampler ="
        ' "importance"` in [fit] gives the other answer'
    )


def _from_weights(
    density: Density, weighted: Weighted, settings: Settings, stream: Stream
) -> Posterior:
    picked = weighted.picked(stream("resample"), settings.draws)
    times = np.unique(picked, return_counts=True)[1]
    worth = min(settings.draws**2 / float(times @ times), weighted.ess)
    theta = weighted.theta[picked].reshape(CHAINS, -1, len(density.problem.names))
    return Posterior(
        names=density.problem.names,
        theta=theta,
        levels_N=levels(density, theta, stream("levels")),
        log_prob=weighted.log_prob[picked].reshape(CHAINS, -1),
        sampler="importance",
        ess=np.full(theta.shape[-1], worth),
        ess_tail=np.full(theta.shape[-1], worth),
        r_hat=np.full(theta.shape[-1], math.nan),
        tau=np.ones(theta.shape[-1]),
        pareto_k=weighted.pareto_k,
    )


def _from_chain(
    density: Density, chain: ensemble.ThinnedChain, weighted: Weighted, stream: Stream
) -> Posterior:
    each = np.moveaxis(chain.theta, -1, 0)
    return Posterior(
        names=density.problem.names,
        theta=chain.theta,
        levels_N=levels(density, chain.theta, stream("levels")),
        log_prob=chain.log_prob,
        sampler="emcee",
        ess=np.array([convergence.worth(c) for c in each]),
        ess_tail=np.array([convergence.tail(c) for c in each]),
        r_hat=np.array([convergence.r_hat(c) for c in each]),
        tau=chain.tau,
        acceptance=chain.acceptance,
        pareto_k=weighted.pareto_k,
        steps=chain.steps,
    )


def _without_parameters(density: Density, settings: Settings, stream: Stream) -> Posterior:
    theta = np.zeros((CHAINS, settings.draws // CHAINS, 0))
    log = float(density(np.zeros((1, 0)))[0])
    none = np.zeros(0)
    return Posterior(
        names=(),
        theta=theta,
        levels_N=levels(density, theta, stream("levels")),
        log_prob=np.full(theta.shape[:2], log),
        sampler="none",
        ess=none,
        ess_tail=none,
        r_hat=none,
        tau=none,
        log_evidence=log,
        u_log_evidence=0.0,
    )


def levels(density: Density, theta: FloatArray, rng: np.random.Generator) -> FloatArray:
    """L_inf in N for draws (c, n, p): (c, n, k). Its logarithm given theta has Student's t
    distribution, since the noise scale is uncertain.
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
