"""Trials to cells: mean lift and Delta L per (boundary, distance, throttle), with the full covariance of Delta L.

Delta L = (L - L_inf) / L_inf; every cell of a throttle shares one L_inf, so their errors hang together, and the throttles of
one visit of the traverse share that visit's height. Delta L is for tables and figures: fits work on the trials themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray

#: With fewer repeats than this a cell borrows the relative scatter of all cells of its boundary.
OWN_SCATTER = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Cells:
    """One boundary's cells, ordered by throttle, then distance; arrays of shape (c,), `covariance` (c, c) of delta_L."""

    z_hat: FloatArray
    throttle: FloatArray
    lift_N: FloatArray
    u_lift_N: FloatArray
    n_trials: NDArray[np.int64]
    delta_L: FloatArray
    covariance: FloatArray


def reduce(z_hat: FloatArray, throttle: FloatArray, lift_N: FloatArray, u_lift_N: FloatArray, visit: NDArray[Any]) -> Cells:
    """Cells of the accepted trials of one boundary; free-air trials have z_hat = inf and serve as L_inf where present.

    Parameters
    ----------
    z_hat, throttle, lift_N, u_lift_N, visit : (n,)
        As in trials.parquet.
    """
    order = np.lexsort((z_hat, throttle))
    keys = np.stack([throttle[order], z_hat[order]])
    start = np.flatnonzero(np.r_[True, (keys[:, 1:] != keys[:, :-1]).any(axis=0)])
    label = np.empty(len(z_hat), dtype=np.int64)
    label[order] = np.repeat(np.arange(len(start)), np.diff(np.r_[start, len(order)]))
    count = np.bincount(label)
    mean = np.bincount(label, lift_N) / count
    z, t = z_hat[order][start], throttle[order][start]
    covariance = _mean_covariance(label, count, mean, z, lift_N, u_lift_N, visit)

    far = _reference(z, t)
    delta = mean / mean[far] - 1
    # d delta = (d mean - (1 + delta) d mean_far) / mean_far: exactly nothing where a cell is its own reference
    jacobian = np.eye(len(mean))
    jacobian[np.arange(len(mean)), far] -= 1 + delta
    jacobian /= mean[far][:, None]
    spread = jacobian @ covariance @ jacobian.T
    keep = np.isfinite(z)
    return Cells(
        z_hat=z[keep],
        throttle=t[keep],
        lift_N=mean[keep],
        u_lift_N=np.sqrt(np.diag(covariance))[keep],
        n_trials=count[keep],
        delta_L=delta[keep],
        covariance=((spread + spread.T) / 2)[np.ix_(keep, keep)],
    )


def _reference(z: FloatArray, throttle: FloatArray) -> NDArray[np.int64]:
    """Index of the cell that gives each cell's L_inf: free air where present, else the farthest station of its throttle."""
    far = np.empty(len(z), dtype=np.int64)
    for level in np.unique(throttle):
        mine = np.flatnonzero(throttle == level)
        far[mine] = mine[np.argmax(z[mine])]
    return far


def _mean_covariance(
    label: NDArray[np.int64], count: NDArray[np.int64], mean: FloatArray, z: FloatArray, lift: FloatArray, u_lift: FloatArray, visit: NDArray[Any]
) -> FloatArray:
    """Covariance of cell means: from the scatter of repeats, joint over throttles where they share visits."""
    deviation = lift - mean[label]
    squares = np.bincount(label, deviation**2)
    within = np.bincount(label, u_lift**2) / count
    spare = np.sum(count) - len(count)
    pooled = np.sum(squares / mean**2) / spare if spare >= OWN_SCATTER else 0.0
    own = np.where(count >= OWN_SCATTER, squares / np.maximum(count - 1, 1), pooled * mean**2)
    covariance = np.diag(np.maximum(own, within) / count)
    for station in np.unique(z[np.isfinite(z)]):
        members = np.flatnonzero((z == station) & (count >= 2 * OWN_SCATTER))
        visits = [set(visit[label == m].tolist()) for m in members]
        # only complete repeats give a joint scatter that is a covariance
        if len(members) < 2 or any(v != visits[0] or len(v) != count[m] for v, m in zip(visits, members, strict=True)):
            continue
        table = np.stack([deviation[label == m][np.argsort(visit[label == m])] for m in members])
        joint = table @ table.T / (count[members[0]] - 1) / count[members[0]]
        covariance[np.ix_(members, members)] = joint + np.diag(np.maximum(np.diag(covariance)[members] - np.diag(joint), 0))
    return covariance
