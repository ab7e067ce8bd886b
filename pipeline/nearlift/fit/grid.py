"""Posterior of one or two parameters on a grid: deterministic, with an estimate of its error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit.density import Density

#: Points along each axis, by number of parameters, and how often they are doubled for a shape that
#: they do not resolve (a bent ridge). Ours: 600,000 points at most, which take a second.
GRID_POINTS = {1: 1025, 2: 193}
MAX_DOUBLINGS = 2
#: Points along each axis while the grid's reach is searched, and maximum number of rounds of it.
#: Ours: a coarse grid suffices to see an edge, and a round can triple the reach.
REACH_POINTS, REACH_ROUNDS = 65, 8
#: Fall of the log density at which the grid ends. Ours: the tail of a normal beyond it is below
#: 1e-7.
MAX_LOG_FALL = 16.0
#: Limit on the change of a cumulative probability when the resolution is halved. Ours: less than
#: the Monte Carlo error of 4000 draws.
MAX_GRID_ERROR = 0.005


@dataclass(frozen=True, kw_only=True)
class PosteriorGrid:
    """Points (n, p) with their probabilities (n,), and the `steps` (p, p) from a point to its
    neighbours, a row each.

    `error` is the largest change of a marginal cumulative probability when the resolution is
    halved. `log_evidence` is the log of the integral of likelihood times prior, `u_log_evidence`
    its change on halving the resolution.
    """

    theta: FloatArray
    mass: FloatArray
    steps: FloatArray
    error: float = 0.0
    log_evidence: float
    u_log_evidence: float = 0.0

    @property
    def resolved(self) -> bool:
        """Whether the grid may be used."""
        return self.error < MAX_GRID_ERROR

    def below(self, parameter: int, value: float) -> float:
        """Marginal cumulative probability of a parameter at `value`; each point's is spread over
        its cell.
        """
        width = np.abs(self.steps[:, parameter]).sum()
        share = np.clip(0.5 + (value - self.theta[:, parameter]) / width, 0.0, 1.0)
        return float(self.mass @ share)

    def moments(self, parameter: int) -> tuple[float, float]:
        """Mean and standard deviation of one parameter."""
        x = self.theta[:, parameter]
        mean = float(self.mass @ x)
        return mean, float(np.sqrt(self.mass @ (x - mean) ** 2))

    def quantiles(self, parameter: int, probabilities: Sequence[float]) -> FloatArray:
        """Marginal quantiles of one parameter, where `below` has these values."""
        from scipy.optimize import brentq

        x, width = self.theta[:, parameter], float(np.abs(self.steps[:, parameter]).sum())
        low, high = float(x.min()) - width, float(x.max()) + width
        return np.array(
            [brentq(lambda v, p=p: self.below(parameter, v) - p, low, high) for p in probabilities]
        )

    def draw(self, rng: np.random.Generator, n: int) -> FloatArray:
        """Independent draws, (n, p), uniform within the cell of a point."""
        places = (np.arange(n) + rng.random()) / n
        nearest = np.minimum(np.searchsorted(np.cumsum(self.mass), places), len(self.mass) - 1)
        offset = rng.random((n, len(self.steps))) - 0.5
        drawn: FloatArray = self.theta[rng.permutation(nearest)] + offset @ self.steps
        return drawn


def grid(density: Density) -> PosteriorGrid:
    """The posterior of one or two parameters on a lattice along the axes of its first-order spread.

    The lattice begins about the peak and is widened until its edges are negligible.
    """
    mean = density.peak
    p = len(mean)
    value, vector = np.linalg.eigh(density.spread)
    axes = vector * np.sqrt(np.maximum(value, 1e-30))

    def evaluated(points: int) -> tuple[FloatArray, FloatArray]:
        """Points (..., p) of the lattice from `low` to `high`, and their log density (...)."""
        nodes = np.linspace(low, high, points).T
        theta = mean + np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1) @ axes.T
        return theta, density(theta.reshape(-1, p)).reshape(theta.shape[:-1])

    low, high, last = np.full(p, -6.0), np.full(p, 6.0), REACH_POINTS - 1
    for _ in range(REACH_ROUNDS):
        _, log = evaluated(REACH_POINTS)
        places = np.array(np.nonzero(log > log.max() - MAX_LOG_FALL))
        first, final = places.min(axis=1), places.max(axis=1)
        before, width = np.stack([low, high]), high - low
        # widen a side that still holds mass, shrink one that does not
        high = np.where(final == last, high + width, low + (final + 1) * width / last)
        low = np.where(first == 0, low - width, low + (first - 1) * width / last)
        if np.allclose([low, high], before, atol=0.05 * np.ptp(before)):
            break
    for doubling in range(MAX_DOUBLINGS + 1):
        points = (GRID_POINTS[p] - 1) * 2**doubling + 1
        posterior = _with_error(*evaluated(points), (axes * ((high - low) / (points - 1))).T)
        if posterior.resolved:
            break
    return posterior


def _with_error(theta: FloatArray, log: FloatArray, steps: FloatArray) -> PosteriorGrid:
    """Grid of points (..., p) and log densities (...), compared with one of half its resolution."""
    p, weight = theta.shape[-1], np.exp(log - log.max())

    def normalised(cell: int) -> PosteriorGrid:
        """The grid of every `cell`-th point."""
        kept = (slice(None, None, cell),) * p
        volume, total = abs(float(np.linalg.det(cell * steps))), weight[kept].sum()
        return PosteriorGrid(
            theta=theta[kept].reshape(-1, p),
            mass=weight[kept].ravel() / total,
            steps=cell * steps,
            log_evidence=float(log.max()) + math.log(total * volume),
        )

    fine, coarse = normalised(1), normalised(2)
    error = 0.0
    for i in range(p):
        held = fine.theta[fine.mass > 0.05 * fine.mass.max(), i]
        places = np.linspace(held.min(), held.max(), 9).tolist()
        error = max([error, *(abs(fine.below(i, x) - coarse.below(i, x)) for x in places)])
    change = abs(fine.log_evidence - coarse.log_evidence)
    return replace(fine, error=error, u_log_evidence=change)
