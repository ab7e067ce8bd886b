"""Trials to cells: mean lift and Delta L per (boundary, distance, throttle), with the full
covariance of Delta L.

Delta L = (L - L_inf) / L_inf. Every cell of a throttle shares one L_inf, so their errors are
correlated. The throttles of one visit of the traverse share that visit's height. Delta L is for
tables and figures: fits work on the trials themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import BoolArray, FloatArray, IntArray

#: With fewer repeats than this a cell borrows the relative scatter of all cells of its boundary.
OWN_SCATTER = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Scatter:
    """Covariance of cell means: `variance` (c,) of each, and what the cells of one station share,
    as (members, block).
    """

    variance: FloatArray
    joint: tuple[tuple[IntArray, FloatArray], ...]

    def dense(self) -> FloatArray:
        """The (c, c) matrix."""
        result = np.diag(self.variance)
        for members, block in self.joint:
            result[np.ix_(members, members)] = block
        return result


@dataclass(frozen=True, slots=True, kw_only=True)
class Cells:
    """One boundary's cells, ordered by throttle, then distance; arrays of shape (c,).

    `whole` is the covariance of all means, those in free air included. `near` selects these cells
    among them. `mean` are the means (N). `far` is the index of each one's L_inf among them.
    """

    z_hat: FloatArray
    throttle: FloatArray
    lift_N: FloatArray
    u_lift_N: FloatArray
    n_trials: IntArray
    delta_L: FloatArray
    u_delta_L: FloatArray
    whole: Scatter
    near: BoolArray
    mean: FloatArray
    far: IntArray

    def covariance(self) -> FloatArray:
        """Covariance of delta_L, (c, c): 8 c^2 bytes, and three times that while it is made.

        d delta = (d mean - (1 + delta) d mean_far) / mean_far: exactly nothing where a cell is its
        own reference.
        """
        far, over = self.far, self.mean / self.mean[self.far]
        result = self.whole.dense()
        result -= over[:, None] * result[far]
        result -= over * result[:, far]
        result /= self.mean[far][:, None]
        result /= self.mean[far]
        result = result[np.ix_(self.near, self.near)]
        return (result + result.T) / 2


def reduce(
    z_hat: FloatArray,
    throttle: FloatArray,
    lift_N: FloatArray,
    u_lift_N: FloatArray,
    visit: NDArray[Any],
) -> Cells:
    """Cells of the accepted trials of one boundary, from their columns of trials.parquet (n,).

    Free-air trials have z_hat = inf and serve as L_inf where present.
    """
    order = np.lexsort((z_hat, throttle))
    keys = np.stack([throttle[order], z_hat[order]])
    start = np.flatnonzero(np.r_[True, (keys[:, 1:] != keys[:, :-1]).any(axis=0)])
    label = np.empty(len(z_hat), dtype=np.int64)
    label[order] = np.repeat(np.arange(len(start)), np.diff(np.r_[start, len(order)]))
    count = np.bincount(label)
    mean = np.bincount(label, lift_N) / count
    z, t = z_hat[order][start], throttle[order][start]
    scatter = _scatter(label, count, mean, z, lift_N, u_lift_N, visit)
    far, near = _reference(z, t), np.isfinite(z)
    over = mean / mean[far]
    # a cell and its reference are at two distances, which share nothing
    both = scatter.variance + over**2 * scatter.variance[far]
    variance = np.where(far == np.arange(len(mean)), 0.0, both) / mean[far] ** 2
    return Cells(
        z_hat=z[near],
        throttle=t[near],
        lift_N=mean[near],
        u_lift_N=np.sqrt(scatter.variance[near]),
        n_trials=count[near],
        delta_L=(over - 1)[near],
        u_delta_L=np.sqrt(variance[near]),
        whole=scatter,
        near=near,
        mean=mean,
        far=far,
    )


def _reference(z: FloatArray, throttle: FloatArray) -> IntArray:
    """Index of each cell's L_inf: free air where present, else its throttle's farthest station."""
    far = np.empty(len(z), dtype=np.int64)
    for level in np.unique(throttle):
        mine = np.flatnonzero(throttle == level)
        far[mine] = mine[np.argmax(z[mine])]
    return far


def _scatter(
    label: IntArray,
    count: IntArray,
    mean: FloatArray,
    z: FloatArray,
    lift: FloatArray,
    u_lift: FloatArray,
    visit: NDArray[Any],
) -> Scatter:
    """Covariance of cell means, from repeats, joint over throttles where they share visits."""
    deviation = lift - mean[label]
    squares = np.bincount(label, deviation**2)
    within = np.bincount(label, u_lift**2) / count
    spare = np.sum(count) - len(count)
    pooled = np.sum(squares / mean**2) / spare if spare >= OWN_SCATTER else 0.0
    repeats = np.where(count >= OWN_SCATTER, squares / np.maximum(count - 1, 1), pooled * mean**2)
    variance, shared = np.maximum(repeats, within) / count, []
    often = np.isfinite(z) & (count >= 2 * OWN_SCATTER)
    for station in np.unique(z[often]):
        members = np.flatnonzero(often & (z == station))
        visits = [set(visit[label == m].tolist()) for m in members]
        # only complete repeats give a joint scatter that is a covariance
        if len(members) < 2 or any(
            v != visits[0] or len(v) != count[m] for v, m in zip(visits, members, strict=True)
        ):
            continue
        table = np.stack([deviation[label == m][np.argsort(visit[label == m])] for m in members])
        joint = table @ table.T / (count[members[0]] - 1) / count[members[0]]
        shared.append((members, joint + np.diag(np.maximum(variance[members] - np.diag(joint), 0))))
        variance[members] = np.diag(shared[-1][1])
    return Scatter(variance=variance, joint=tuple(shared))
