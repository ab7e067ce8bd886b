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
#: Pareto shape k from which weights are not used.
LIMIT = 0.7


def shape(excess: FloatArray) -> float:
    """Shape k of a generalised Pareto distribution from ascending excesses (n,), not all 0."""
    n = len(excess)
    m = 30 + int(np.sqrt(n))
    quartile = max(excess[int(n / 4 + 0.5) - 1], 1e-12 * excess[-1])
    theta = 1 / excess[-1] + (1 - np.sqrt(m / (np.arange(m) + 0.5))) / (3 * quartile)
    k = np.log1p(-theta[:, None] * excess).mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        profile = n * (np.log(-theta / k) - k - 1)
    profile = np.where(np.isfinite(profile), profile, -np.inf)
    weight = np.exp(profile - profile.max())
    best = float(theta @ weight / weight.sum())
    return float(np.log1p(-best * excess).mean())


def pareto_k(log_weights: FloatArray) -> float:
    """Shape k of a generalised Pareto distribution in the upper tail of importance weights, shrunk
    towards 0.5; 0 without a tail.

    Below 0.5 the weights have a finite variance; up to 0.7 their averages can be used; beyond, they
    cannot be trusted however many there are. Fit: Zhang and Stephens, Technometrics 51 (2009); what
    to fit, and the limits: Vehtari, Simpson, Gelman, Yao and Gabry, JMLR 25 (2024).
    """
    n = len(log_weights)
    size = int(np.ceil(min(0.2 * n, 3 * np.sqrt(n))))
    weights = np.sort(np.exp(log_weights - np.max(log_weights)))
    excess = weights[-size:] - weights[-size - 1]
    if size < 5 or excess[-1] < 1e-12:
        return 0.0
    return (size * shape(excess) + 5) / (size + 10)


def enough(k: float) -> float:
    """Number of draws that weights with tail k need; inf from k = 1 on."""
    return 10 ** (1 / (1 - max(k, 0.0))) if k < 1 else np.inf


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
        """Shape of the weights' tail; see `pareto_k`."""
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
