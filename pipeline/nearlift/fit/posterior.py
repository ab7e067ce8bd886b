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
from nearlift.fit import convergence, ensemble, importance
from nearlift.fit.density import Density
from nearlift.fit.ensemble import Block
from nearlift.fit.grid import PosteriorGrid, grid
from nearlift.fit.importance import Weighted
from nearlift.results.posterior import APART, SamplerCheck

Sampler = Literal["auto", "emcee", "importance"]
#: Chains into which independent draws are divided, for the usual diagnostics.
CHAINS = 4
#: Maximum number of parameters for a grid.
GRID = 2
#: Cumulative probabilities at which two computations are compared.
PROBABILITIES = (0.05, 0.25, 0.5, 0.75, 0.95)


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Judge:
    """A second computation of a posterior: `below` gives the cumulative probability of a parameter
    at a value, with an effective sample size `ess` and a numerical error of at most `error`.
    """

    name: str
    below: Callable[[int, float], float]
    ess: float = math.inf
    error: float = 0.0
    unfit: str = ""


def grid_judge(lattice: PosteriorGrid) -> Judge:
    """A grid as judge."""
    unfit = (
        ""
        if lattice.resolved
        else f"too coarse for this shape: half the resolution moves shares by {lattice.error:.3f}"
    )
    return Judge(name="grid", below=lattice.below, error=lattice.error, unfit=unfit)


def importance_judge(weighted: Weighted) -> Judge:
    """Importance sampling as judge."""
    k = weighted.pareto_k
    unfit = (
        ""
        if k < importance.LIMIT
        else f"its weights cannot be trusted: Pareto k = {k:.2f}, above {importance.LIMIT}"
    )
    return Judge(name="importance sampling", below=weighted.below, ess=weighted.ess, unfit=unfit)


def compare(
    names: Sequence[str], values: FloatArray, ess: FloatArray, judge: Judge
) -> SamplerCheck:
    """Largest disagreement of quantiles `values` (p, 5), worth `ess` (p, 5) draws, with a judge, in
    Monte Carlo standard errors.
    """
    worst, where = 0.0, ""
    for i, name in enumerate(names):
        for probability, value, worth in zip(PROBABILITIES, values[i], ess[i], strict=True):
            error = (
                math.sqrt(probability * (1 - probability) * (1 / worth + 1 / judge.ess))
                + judge.error / APART
            )
            share = judge.below(i, float(value))
            if abs(share - probability) > worst * error:
                worst = abs(share - probability) / error
                where = (
                    f"{100 * probability:.0f} % of {name} lie below {value:.5g} by one,"
                    f" {100 * share:.1f} % by the other"
                )
    return SamplerCheck(by=judge.name, apart=worst, where=where, unfit=judge.unfit)


def insist(model: str, sampler: str, checks: Sequence[SamplerCheck], remedy: str) -> None:
    """Raise `NotConverged` with this remedy if any judge disagrees."""
    for check in checks:
        if check.failed:
            raise NotConverged(
                f"posterior of {model}",
                f"{sampler} and the {check.by} disagree: {check.where}, {check.apart:.1f} Monte"
                f" Carlo standard errors apart (at most {APART:g})",
                remedy,
            )


def forget(_: Block) -> None:
    """Discard a block."""


def sample(
    density: Density,
    settings: Settings,
    seed: int,
    *purpose: str,
    progress: Callable[[Block], None] = forget,
) -> Posterior:
    """Sample a posterior to the effective sample size asked for, and cross-check it.

    Parameters
    ----------
    seed, purpose
        Key of the random streams; see `randomness.generator`.
    progress
        Called with each block of an emcee chain.

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
    if settings.sampler == "importance" and weighted.pareto_k >= importance.LIMIT:
        raise NotConverged(
            f"posterior of {model}",
            f"the weights of {len(weighted.weight)} draws have Pareto k = {weighted.pareto_k:.2f},"
            f" above {importance.LIMIT}",
            f"weights like these would want {importance.enough(weighted.pareto_k):.2g} draws; say"
            ' `sampler = "emcee"` in [fit]',
        )
    judges = [grid_judge(grid(density, *weighted.moments()))] if len(names) <= GRID else []
    value, u = weighted.log_evidence
    drawn = _from_weights(density, weighted, settings, stream)
    quantiles = np.stack([weighted.quantile(i, PROBABILITIES) for i in range(len(names))])
    checks = [
        compare(names, quantiles, np.full(quantiles.shape, weighted.ess), judge) for judge in judges
    ]
    passed = (
        weighted.pareto_k < importance.LIMIT
        and drawn.ess.min() >= settings.ess
        and not any(c.failed for c in checks)
    )
    remedy = (
        'there may be several peaks, or one at a bound: `sampler = "emcee"` in [fit] looks for them'
        " in another way"
    )
    if settings.sampler == "emcee" or (settings.sampler == "auto" and not passed):
        others = [importance_judge(weighted), *judges]
        blocks: list[Block] = []

        def both(block: Block) -> None:
            blocks.append(block)
            progress(block)

        chain = ensemble.run(density, stream("emcee"), settings.ess, settings.steps, (), both)
        drawn, checks = _judged(density, chain, weighted, others, stream)
        twice = 2 * chain.steps
        longer = min(twice, settings.steps)
        if any(c.failed for c in checks) and longer > chain.steps:
            # a chain that missed a slow mode looks better than it is: only more steps tell
            chain = ensemble.run(
                density,
                stream("emcee"),
                settings.ess,
                settings.steps,
                blocks,
                progress,
                least=longer,
            )
            drawn, checks = _judged(density, chain, weighted, others, stream)
        remedy = _after(chain, twice, settings)
    insist(model, drawn.sampler, checks, remedy)
    return replace(drawn, checks=tuple(checks), log_evidence=value, u_log_evidence=u)


def _judged(
    density: Density,
    chain: ensemble.ThinnedChain,
    weighted: Weighted,
    judges: Sequence[Judge],
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
    return drawn, [compare(drawn.names, quantiles, np.array(worth), judge) for judge in judges]


def _after(chain: ensemble.ThinnedChain, twice: int, settings: Settings) -> str:
    """Remedy for a chain that disagrees with its judges, even at `twice` its length if allowed."""
    if settings.steps < twice:
        return f"a longer chain may agree: `steps = {twice}` in [fit] (now {settings.steps})"
    return (
        f"{chain.steps} steps, twice those that seemed enough, did not help: there may be"
        " several peaks, or one at a bound; another seed shows which is wrong, and `sampler ="
        ' "importance"` in [fit] gives the other answer'
    )


def _independent(
    density: Density,
    theta: FloatArray,
    log_prob: FloatArray,
    worth: float,
    sampler: str,
    stream: Stream,
) -> Posterior:
    """Independent draws (c, n, p), `worth` so many of every parameter."""
    p = theta.shape[-1]
    return Posterior(
        names=density.problem.names,
        theta=theta,
        levels_N=levels(density, theta, stream("levels")),
        log_prob=log_prob,
        sampler=sampler,
        ess=np.full(p, worth),
        ess_tail=np.full(p, worth),
        r_hat=np.full(p, math.nan),
        tau=np.ones(p),
    )


def _from_weights(
    density: Density, weighted: Weighted, settings: Settings, stream: Stream
) -> Posterior:
    picked = weighted.picked(stream("resample"), settings.draws)
    times = np.unique(picked, return_counts=True)[1]
    worth = min(settings.draws**2 / float(times @ times), weighted.ess)
    theta = weighted.theta[picked].reshape(CHAINS, -1, len(density.problem.names))
    log_prob = weighted.log_prob[picked].reshape(CHAINS, -1)
    drawn = _independent(density, theta, log_prob, worth, "importance", stream)
    return replace(drawn, pareto_k=weighted.pareto_k)


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
    log_prob = np.full(theta.shape[:2], log)
    drawn = _independent(density, theta, log_prob, math.nan, "none", stream)
    return replace(drawn, log_evidence=log, u_log_evidence=0.0)


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
