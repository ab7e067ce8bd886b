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
#: Fall of the log density at which the grid ends: the tail of a normal beyond it is below 1e-7.
DEEP = 16.0
#: Limit on the change of a cumulative probability when the resolution is halved: less than the
#: Monte Carlo error of 4000 draws.
COARSE = 0.005


@dataclass(frozen=True, kw_only=True)
class PosteriorGrid:
    """Points (n, p) with their probabilities (n,).

    `steps` (p, p) are the vectors from a point to its neighbours, a row each. `error` is the
    largest change of a marginal cumulative probability when the resolution is halved.
    `log_evidence` is the log of the integral of likelihood times prior, `u_log_evidence` its change
    on halving the resolution.
    """

    theta: FloatArray
    mass: FloatArray
    steps: FloatArray
    error: float
    log_evidence: float
    u_log_evidence: float

    @property
    def resolved(self) -> bool:
        """Whether the grid may be used."""
        return self.error < COARSE

    def below(self, parameter: int, value: float) -> float:
        """Marginal cumulative probability of a parameter at `value`."""
        width = np.abs(self.steps[:, parameter]).sum()
        return _below(self.theta[:, parameter], self.mass, width, value)

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
        drawn = self.theta[rng.permutation(picked)] + offset @ self.steps
        return np.asarray(drawn, dtype=np.float64)


def _below(x: FloatArray, mass: FloatArray, width: float, value: float) -> float:
    """Cumulative probability, each point's mass spread over its cell of this width."""
    return float(mass @ np.clip(0.5 + (value - x) / width, 0.0, 1.0))


def grid(density: Density) -> PosteriorGrid:
    """The posterior of one or two parameters on a lattice along the axes of its first-order spread.

    The lattice begins about the peak and is widened until its edges are negligible.
    """
    mean = density.peak
    p = len(mean)
    value, vector = np.linalg.eigh(density.spread())
    axes = vector * np.sqrt(np.maximum(value, 1e-30))
    reach = np.tile([-6.0, 6.0], (p, 1))
    for _ in range(8):
        lattice, theta = _lattice(mean, axes, reach, 65)
        log = density(theta).reshape(lattice)
        grown = reach.copy()
        for axis in range(p):
            along = np.moveaxis(log, axis, 0).reshape(lattice[axis], -1).max(axis=1)
            held = np.flatnonzero(along > log.max() - DEEP)
            nodes = np.linspace(float(reach[axis, 0]), float(reach[axis, 1]), lattice[axis])
            step = nodes[1] - nodes[0]
            # widen a side that still holds mass, shrink one that does not
            grown[axis, 0] = (
                nodes[0] - (nodes[-1] - nodes[0]) if held[0] == 0 else nodes[held[0]] - step
            )
            grown[axis, 1] = (
                nodes[-1] + (nodes[-1] - nodes[0])
                if held[-1] == len(nodes) - 1
                else nodes[held[-1]] + step
            )
        settled = np.allclose(grown, reach, atol=0.05 * np.ptp(reach))
        reach = grown
        if settled:
            break
    points = POINTS[p]
    posterior = _at(density, mean, axes, reach, points)
    for _ in range(DOUBLINGS):
        if posterior.resolved:
            break
        points = 2 * points - 1
        posterior = _at(density, mean, axes, reach, points)
    return posterior


def _at(
    density: Density, mean: FloatArray, axes: FloatArray, reach: FloatArray, points: int
) -> PosteriorGrid:
    """The posterior on a lattice of so many points along each axis."""
    p = len(mean)
    lattice, theta = _lattice(mean, axes, reach, points)
    log = density(theta)
    weight = np.exp(log - log.max())
    mass = weight / weight.sum()
    half = (slice(None, None, 2),) * p
    coarse, few = (
        weight.reshape(lattice)[half].ravel(),
        theta.reshape(*lattice, p)[half].reshape(-1, p),
    )
    steps = (axes * (np.ptp(reach, axis=1) / (points - 1))).T
    volume = abs(float(np.linalg.det(steps)))
    width = np.abs(steps).sum(axis=0)
    error = 0.0
    for i in range(p):
        held = theta[mass > 0.05 * mass.max(), i]
        for place in np.linspace(float(held.min()), float(held.max()), 9).tolist():
            error = max(
                error,
                abs(
                    _below(theta[:, i], mass, width[i], place)
                    - _below(few[:, i], coarse / coarse.sum(), 2 * width[i], place)
                ),
            )
    return PosteriorGrid(
        theta=theta,
        mass=mass,
        steps=steps,
        error=error,
        log_evidence=float(log.max()) + math.log(weight.sum() * volume),
        u_log_evidence=abs(math.log(weight.sum() / (2**p * coarse.sum()))),
    )


def _lattice(
    mean: FloatArray, axes: FloatArray, reach: FloatArray, points: int
) -> tuple[tuple[int, ...], FloatArray]:
    nodes = [np.linspace(low, high, points) for low, high in reach]
    mesh = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)
    return mesh.shape[:-1], (mean + mesh @ axes.T).reshape(-1, len(mean))
