"""Many small least-squares problems at once: Levenberg and Marquardt's method on a stack, with bounds and with some parameters held.

Profiles, and integrals over an unknown height, ask for the same minimum at dozens of nearby settings; one call of the model serves them all.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray

ROUNDS = 60
#: A step smaller than this part of a parameter's scale ends the search.
STILL = 1e-7
DAMPING_MAX = 1e10


def minimise(
    residuals: Callable[[FloatArray, NDArray[np.int64]], FloatArray],
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    scale: FloatArray,
    free: NDArray[np.bool_],
) -> tuple[FloatArray, FloatArray]:
    """Minimise the sum of squares of each of m problems.

    Parameters
    ----------
    residuals : callable
        Parameters (k, p) and which problems (k,) they belong to, to residuals (k, n); nan where the model has no value.
    start : (m, p)
    bounds : pair of (p,)
    scale : (p,)
        Typical size of each parameter's change, such as its standard uncertainty.
    free : (p,) bool
        What is optimised; the rest is held at its start.

    Returns
    -------
    theta : (m, p)
    chi2 : (m,)
        inf where the model has no value at the start.
    """
    theta = np.clip(np.array(start, dtype=float), *bounds)
    m = len(theta)
    chi2 = _chi2(residuals(theta, np.arange(m)))
    if not free.any():
        return theta, chi2
    damping = np.full(m, 1e-3)
    active = np.isfinite(chi2)
    for _ in range(ROUNDS):
        rows = np.flatnonzero(active)
        if not len(rows):
            break
        step = _step(residuals, theta[rows], rows, bounds, scale, free, damping[rows])
        trial = np.clip(theta[rows] + step, *bounds)
        moved = np.abs((trial - theta[rows]) / scale).max(axis=1)
        new = _chi2(residuals(trial, rows))
        better = new <= chi2[rows]
        theta[rows[better]], chi2[rows[better]] = trial[better], new[better]
        damping[rows] = np.where(better, damping[rows] / 10, damping[rows] * 10)
        active[rows] = (moved > STILL) & (damping[rows] < DAMPING_MAX)
    return theta, chi2


def _step(
    residuals: Callable[[FloatArray, NDArray[np.int64]], FloatArray],
    theta: FloatArray,
    rows: NDArray[np.int64],
    bounds: tuple[FloatArray, FloatArray],
    scale: FloatArray,
    free: NDArray[np.bool_],
    damping: FloatArray,
) -> FloatArray:
    """A damped Newton step for each problem, none for what stands at a bound and would leave it."""
    which = np.flatnonzero(free)
    # towards the middle, so that the derivative never asks beyond a bound
    side = np.where(theta[:, which] > np.clip(bounds, -1e12, 1e12).mean(axis=0)[which], -1.0, 1.0)
    h = 1e-4 * scale[which] * side
    shifted = theta[:, None, :] + np.zeros((1, len(which), 1))
    shifted[:, np.arange(len(which)), which] += h
    stacked = np.concatenate([theta[:, None, :], shifted], axis=1).reshape(-1, theta.shape[1])
    r = residuals(stacked, np.repeat(rows, len(which) + 1)).reshape(len(theta), len(which) + 1, -1)
    here = r[:, 0]
    jacobian = np.nan_to_num((r[:, 1:] - here[:, None]) / h[:, :, None]) * scale[which][None, :, None]
    gradient = np.einsum("kpn,kn->kp", jacobian, here)
    low, high = bounds[0][which], bounds[1][which]
    stuck = ((theta[:, which] <= low) & (gradient > 0)) | ((theta[:, which] >= high) & (gradient < 0))
    jacobian[stuck] = 0.0
    gradient[stuck] = 0.0
    curved = np.einsum("kpn,kqn->kpq", jacobian, jacobian)
    diagonal = np.einsum("kpp->kp", curved)
    extra = damping[:, None] * diagonal + 1e-12 * (diagonal.max(axis=1, keepdims=True) + 1e-300)
    own = curved + np.eye(len(which)) * np.where(diagonal > 0, extra, 1.0)[:, None, :]
    step = np.zeros_like(theta)
    step[:, which] = -np.linalg.solve(own, gradient[..., None])[..., 0] * scale[which]
    return step


def _chi2(r: FloatArray) -> FloatArray:
    total = np.einsum("kn,kn->k", r, r)
    return np.where(np.isfinite(total), total, np.inf)
