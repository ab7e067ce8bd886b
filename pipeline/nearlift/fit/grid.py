"""Posterior of one or two parameters on a grid: deterministic, with an estimate of its error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit.density import Density

#: Points along each axis, by number of parameters.
POINTS = {1: 1025, 2: 193}
#: Fall of the log density at which the grid ends.
DEEP = 16.0
#: Limit on the change of a cumulative probability when the resolution is halved.
COARSE = 0.005


@dataclass(frozen=True, kw_only=True)
class PosteriorGrid:
    """Points (n, p), their probabilities (n,) and cell widths (p,); `error` is the largest change
    of a marginal cumulative probability when the resolution is halved.
    """

    theta: FloatArray
    mass: FloatArray
    width: FloatArray
    error: float

    @property
    def resolved(self) -> bool:
        """Whether the grid may be used as a judge."""
        return self.error < COARSE

    def below(self, parameter: int, value: float) -> float:
        """Marginal cumulative probability of a parameter at `value`."""
        return _below(self.theta[:, parameter], self.mass, self.width[parameter], value)

    def moments(self, parameter: int) -> tuple[float, float]:
        """Mean and standard deviation of one parameter."""
        x = self.theta[:, parameter]
        mean = float(self.mass @ x)
        return mean, float(np.sqrt(self.mass @ (x - mean) ** 2))

    def quantiles(self, probability: FloatArray) -> FloatArray:
        """Quantiles of the only parameter, interpolated over adjacent cells."""
        order = np.argsort(self.theta[:, 0])
        ends = np.append(
            self.theta[order, 0] - self.width[0] / 2, self.theta[order[-1], 0] + self.width[0] / 2
        )
        return np.asarray(
            np.interp(probability, np.append(0.0, np.cumsum(self.mass[order])), ends),
            dtype=np.float64,
        )


def _below(x: FloatArray, mass: FloatArray, width: float, value: float) -> float:
    """Cumulative probability, each point's mass spread over its cell of this width."""
    return float(mass @ np.clip(0.5 + (value - x) / width, 0.0, 1.0))


def grid(density: Density, mean: FloatArray, covariance: FloatArray) -> PosteriorGrid:
    """The posterior on a lattice along the principal axes of `covariance`, widened until its edges
    are negligible.

    `mean` (p,) and `covariance` (p, p) only place the lattice; p is 1 or 2.
    """
    p = len(mean)
    value, vector = np.linalg.eigh(covariance)
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
    lattice, theta = _lattice(mean, axes, reach, POINTS[p])
    log = density(theta)
    weight = np.exp(log - log.max())
    mass = weight / weight.sum()
    half = (slice(None, None, 2),) * p
    coarse, few = (
        weight.reshape(lattice)[half].ravel(),
        theta.reshape(*lattice, p)[half].reshape(-1, p),
    )
    coarse = coarse / coarse.sum()
    width = np.abs(axes) @ (np.ptp(reach, axis=1) / (POINTS[p] - 1))
    error = 0.0
    for i in range(p):
        held = theta[mass > 0.05 * mass.max(), i]
        for place in np.linspace(float(held.min()), float(held.max()), 9).tolist():
            error = max(
                error,
                abs(
                    _below(theta[:, i], mass, width[i], place)
                    - _below(few[:, i], coarse, 2 * width[i], place)
                ),
            )
    return PosteriorGrid(theta=theta, mass=mass, width=width, error=error)


def _lattice(
    mean: FloatArray, axes: FloatArray, reach: FloatArray, points: int
) -> tuple[tuple[int, ...], FloatArray]:
    nodes = [np.linspace(low, high, points) for low, high in reach]
    mesh = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)
    return mesh.shape[:-1], (mean + mesh @ axes.T).reshape(-1, len(mean))
