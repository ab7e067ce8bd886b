"""Adaptive importance sampling from a posterior's peak: fast path, cross-check and evidence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit.density import Density
from nearlift.fit.mixture import Mixture
from nearlift.fit.pareto import LIMIT, pareto_k

#: Draws per parameter in each of the first three rounds; later ones are larger.
ROUND = 1500
ROUNDS = 10
#: Expectation-maximisation steps after each round.
STEPS = 6
#: Effective fraction of draws above which, and Pareto k below which, a proposal adapts no more.
GOOD = 0.7
LIGHT = 0.4
#: Index of the round after which the proposal is split, and the number of its components.
PATIENCE = 2
COMPONENTS = 8
#: Maximum number of adaptations to the final draws.
AGAIN = 3
#: Maximum number of draws for each one that is wanted.
GENEROUS = 40


@dataclass(frozen=True, kw_only=True)
class Weighted:
    """Draws `theta` (n, p) with `log_weight` (n,) = log posterior - log proposal, and their
    `log_prob` (n,).
    """

    theta: FloatArray
    log_weight: FloatArray
    log_prob: FloatArray

    @cached_property
    def weight(self) -> FloatArray:
        """Weights that sum to 1."""
        w = np.exp(self.log_weight - self.log_weight.max())
        return np.asarray(w / w.sum(), dtype=np.float64)

    @property
    def ess(self) -> float:
        """Effective sample size (Kish)."""
        return float(1 / (self.weight @ self.weight))

    @cached_property
    def pareto_k(self) -> float:
        """Shape of the weights' tail; see `fit.pareto`."""
        return pareto_k(self.log_weight)

    @property
    def good(self) -> bool:
        """Whether the proposal of these draws needs no further adaptation."""
        return self.ess > GOOD * len(self.theta) and self.pareto_k < LIGHT

    @property
    def log_evidence(self) -> tuple[float, float]:
        """Log of the integral of likelihood times prior, and its Monte Carlo standard error."""
        n = len(self.log_weight)
        top = float(self.log_weight.max())
        value = top + math.log(float(np.exp(self.log_weight - top).mean()))
        return value, math.sqrt(max(1 / self.ess - 1 / n, 0.0))

    def moments(self) -> tuple[FloatArray, FloatArray]:
        """Mean (p,) and covariance (p, p)."""
        return self.weight @ self.theta, np.atleast_2d(
            np.cov(self.theta.T, aweights=self.weight, ddof=0)
        )

    def below(self, parameter: int, value: float) -> float:
        """Marginal cumulative probability of a parameter at `value`."""
        return float(self.weight[self.theta[:, parameter] <= value].sum())

    def quantile(self, parameter: int, probabilities: Any) -> FloatArray:
        """Marginal quantiles of a parameter."""
        order = np.argsort(self.theta[:, parameter])
        cumulative = np.cumsum(self.weight[order]) - 0.5 * self.weight[order]
        return np.asarray(
            np.interp(probabilities, cumulative, self.theta[order, parameter]), dtype=np.float64
        )

    def picked(self, rng: np.random.Generator, n: int) -> FloatArray:
        """Indices of `n` draws of equal weight, (n,): systematic resampling, so that none repeats
        unless its weight exceeds 1 / n.
        """
        places = (np.arange(n) + rng.random()) / n
        return np.minimum(np.searchsorted(np.cumsum(self.weight), places), len(self.weight) - 1)


def peak(density: Density) -> FloatArray:
    """Approximate mode of the posterior, (p,), searched from the least-squares theta.

    Rounded to a sixteenth of the spread: proposals need no more, and the last digits of a search,
    which depend on the processor, would change all draws.
    """
    from scipy.optimize import minimize

    low, high = density.problem.model.bounds
    scale = np.sqrt(np.diag(density.spread()))
    start = np.clip(density.centre, low, high)

    def at(x: FloatArray) -> FloatArray:
        return np.asarray(np.clip(start + x * scale, low, high), dtype=np.float64)

    def cost(x: FloatArray) -> float:
        value = float(density(at(x)[None, :])[0])
        return -value if np.isfinite(value) else 1e10

    ends = list(zip((low - start) / scale, (high - start) / scale, strict=True))
    end = minimize(cost, np.zeros(len(start)), method="L-BFGS-B", jac="3-point", bounds=ends).x
    near = np.round(16 * end) / 16
    return at(near if cost(near) < 1e10 else end)


def weigh(density: Density, proposal: Mixture, rng: np.random.Generator, n: int) -> Weighted:
    """`n` draws from the proposal with their weights."""
    theta = proposal.draw(rng, n)
    log_prob = density(theta)
    return Weighted(
        theta=theta, log_weight=log_prob - proposal.log_density(theta), log_prob=log_prob
    )


def adapt(density: Density, rng: np.random.Generator) -> tuple[Mixture, Weighted]:
    """A proposal adapted to the posterior's shape, and the draws from it.

    Each round adapts to all draws so far, weighted against the average of their proposals (adaptive
    multiple importance sampling), so that a region once found is not forgotten.
    """
    top = peak(density)
    stretch = np.where(np.isclose(top, density.prior.coordinates(top)), 1.0, top)
    spread, mean = density.spread() / np.outer(stretch, stretch), density.prior.coordinates(top)
    proposals = [
        Mixture(
            prior=density.prior,
            share=np.array([0.6, 0.3]),
            mean=np.stack([mean, mean]),
            scale=np.stack([spread, 6 * spread]),
        )
    ]
    rounds: list[Weighted] = []
    for i in range(ROUNDS):
        # rare draws of large weight show only in large samples: later rounds are larger
        rounds.append(weigh(density, proposals[-1], rng, ROUND * len(mean) * (1 + i // 3)))
        if rounds[-1].good:
            return proposals[-1], rounds[-1]
        theta, weight = _together(rounds, proposals)
        # one peak that is no ellipse, or several: more components, at draws picked by weight
        learnt = (
            proposals[-1].split(rng, theta, weight, COMPONENTS) if i == PATIENCE else proposals[-1]
        )
        for _ in range(STEPS):
            learnt = learnt.learn(theta, weight)
        proposals.append(learnt)
    best = max(
        range(ROUNDS),
        key=lambda i: (rounds[i].pareto_k < LIMIT, rounds[i].ess / len(rounds[i].theta)),
    )
    return proposals[best], rounds[best]


def _together(rounds: list[Weighted], proposals: list[Mixture]) -> tuple[FloatArray, FloatArray]:
    """All draws so far (n, p) and their weights (n,), truncated so that none dominates."""
    theta = np.concatenate([r.theta for r in rounds])
    log = np.concatenate([r.log_prob for r in rounds]) - np.logaddexp.reduce(
        [p.log_density(theta) for p in proposals], axis=0
    )
    weight = np.exp(log - log.max())
    return theta, np.minimum(weight, np.sqrt(len(weight)) * weight.mean())


def sample(density: Density, rng: np.random.Generator, wanted: int) -> Weighted:
    """Weighted draws, enough for `wanted` of equal weight with few repeats."""
    proposal, trial = adapt(density, rng)
    n = len(trial.weight)
    # resampling repeats no draw whose weight is below 1 / wanted; whole quarters, since a number
    # that depended on the last bit would change all draws
    quarters = math.ceil(4 * min(1.2 * n * float(trial.weight.max()), GENEROUS))
    size = max(quarters, 5) * wanted // 4
    drawn = weigh(density, proposal, rng, size)
    for _ in range(AGAIN):
        if drawn.pareto_k < LIMIT:
            break
        # so many draws have reached what the rounds missed: adapt to them and draw afresh
        for _ in range(STEPS):
            proposal = proposal.learn(
                drawn.theta, np.minimum(drawn.weight, len(drawn.weight) ** -0.5)
            )
        drawn = weigh(density, proposal, rng, size)
    return drawn
