"""Posterior of one or two parameters on a grid: deterministic, with an estimate of its error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit.density import Density

#: Points along each axis, by number of parameters, and how often they are doubled for a shape that
#: they do not resolve (a bent ridge): 600,000 points at most, which take a second.
POINTS = {1: 1025, 2: 193}
DOUBLINGS = 2
#: Points along each axis while the grid's reach is searched, and maximum number of rounds of it.
ROUGH_POINTS, ROUNDS = 65, 8
#: Fall of the log density at which the grid ends: the tail of a normal beyond it is below 1e-7.
DEEP = 16.0
#: Limit on the change of a cumulative probability when the resolution is halved: less than the
#: Monte Carlo error of 4000 draws.
COARSE = 0.005


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
        return self.error < COARSE

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
        picked = np.minimum(np.searchsorted(np.cumsum(self.mass), places), len(self.mass) - 1)
        offset = rng.random((n, len(self.steps))) - 0.5
        drawn: FloatArray = self.theta[rng.permutation(picked)] + offset @ self.steps
        return drawn


def grid(density: Density) -> PosteriorGrid:
    """The posterior of one or two parameters on a lattice along the axes of its first-order spread.

    The lattice begins about the peak and is widened until its edges are negligible.
    """
    mean = density.peak
    p = len(mean)
    value, vector = np.linalg.eigh(density.spread())
    axes = vector * np.sqrt(np.maximum(value, 1e-30))

    def evaluated(points: int) -> tuple[FloatArray, FloatArray]:
        """Points (..., p) of the lattice within `reach`, and their log density (...)."""
        nodes = [np.linspace(low, high, points) for low, high in reach]
        theta = mean + np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1) @ axes.T
        return theta, density(theta.reshape(-1, p)).reshape(theta.shape[:-1])

    reach = np.tile([-6.0, 6.0], (p, 1))
    for _ in range(ROUNDS):
        _, log = evaluated(ROUGH_POINTS)
        before, width = reach.copy(), np.ptp(reach, axis=1)
        for axis in range(p):
            along = log.max(axis=tuple(i for i in range(p) if i != axis))
            held = np.flatnonzero(along > log.max() - DEEP)
            nodes = np.linspace(before[axis, 0], before[axis, 1], ROUGH_POINTS)
            step = nodes[1] - nodes[0]
            # widen a side that still holds mass, shrink one that does not
            low, high = nodes[held[0]] - step, nodes[held[-1]] + step
            reach[axis] = (
                nodes[0] - width[axis] if held[0] == 0 else low,
                nodes[-1] + width[axis] if held[-1] == ROUGH_POINTS - 1 else high,
            )
        if np.allclose(reach, before, atol=0.05 * np.ptp(before)):
            break
    for doubling in range(DOUBLINGS + 1):
        points = (POINTS[p] - 1) * 2**doubling + 1
        steps = (axes * (np.ptp(reach, axis=1) / (points - 1))).T
        posterior = _with_error(*evaluated(points), steps)
        if posterior.resolved:
            break
    return posterior


def _with_error(theta: FloatArray, log: FloatArray, steps: FloatArray) -> PosteriorGrid:
    """Grid of points (..., p) and log densities (...), compared with one of half its resolution."""
    p, volume = theta.shape[-1], abs(float(np.linalg.det(steps)))
    half = (slice(None, None, 2),) * p
    weight = np.exp(log - log.max())

    def normalised(theta: FloatArray, weight: FloatArray, cell: int) -> PosteriorGrid:
        total = weight.sum()
        return PosteriorGrid(
            theta=theta.reshape(-1, p),
            mass=weight.ravel() / total,
            steps=cell * steps,
            log_evidence=float(log.max()) + math.log(total * volume * cell**p),
        )

    fine, coarse = normalised(theta, weight, 1), normalised(theta[half], weight[half], 2)
    error = 0.0
    for i in range(p):
        held = fine.theta[fine.mass > 0.05 * fine.mass.max(), i]
        places = np.linspace(held.min(), held.max(), 9).tolist()
        error = max([error, *(abs(fine.below(i, x) - coarse.below(i, x)) for x in places)])
    return PosteriorGrid(
        theta=fine.theta,
        mass=fine.mass,
        steps=steps,
        error=error,
        log_evidence=fine.log_evidence,
        u_log_evidence=abs(fine.log_evidence - coarse.log_evidence),
    )
