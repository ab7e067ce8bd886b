"""Many small least-squares problems at once: Levenberg and Marquardt's method on a stack, with bounds and with some parameters held.

Profiles, integrals over an unknown height, resampled and left-out trials ask for the same minimum at dozens or thousands of nearby
settings; one call of the model serves them all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray

ROUNDS = 60
#: A step smaller than this part of a parameter's scale ends the search.
STILL = 1e-7
#: Below this the derivatives are not taken anew: residuals do not vanish at the minimum, so older ones would put it elsewhere by as much.
NEAR = 1e-6
#: Damping relative to the diagonal: at first hardly any, this much after a step that failed, and what ends the search.
DAMPING_MIN, DAMPING, DAMPING_MAX = 1e-8, 1e-3, 1e10
#: A problem counts as converged where an undamped step would be smaller than this part of every parameter's scale.
CONVERGED = 1e-4

IntArray = NDArray[np.int64]
Residuals = Callable[[FloatArray, IntArray], FloatArray]
Linearised = Callable[[FloatArray, IntArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Minima:
    """The minimum of each of m problems.

    Attributes
    ----------
    theta : (m, p)
    chi2 : (m,)
        inf where the model has no value at the start.
    converged : (m,) bool
        False where the search stopped short of a minimum; never take a mean over those.
    """

    theta: FloatArray
    chi2: FloatArray
    converged: NDArray[np.bool_]


def minimise(
    residuals: Residuals,
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    scale: FloatArray,
    free: NDArray[np.bool_],
    linearised: Linearised | None = None,
) -> Minima:
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
    linearised : callable, optional
        The same arguments, to residuals (k, n) and their derivatives (k, p, n); without it, differences are taken.
    """
    theta = np.clip(np.array(start, dtype=float), *bounds)
    which = np.flatnonzero(free)
    if not len(which):
        chi2 = _chi2(residuals(theta, np.arange(len(theta))))
        return Minima(theta=theta, chi2=chi2, converged=np.isfinite(chi2))

    def at(theta: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        r, slopes = _differences(residuals, theta, rows, bounds, scale, which) if linearised is None else _chosen(linearised(theta, rows), which)
        slopes = slopes * scale[which][:, None]
        return r, slopes if np.isfinite(slopes.sum()) else np.nan_to_num(slopes, posinf=0.0, neginf=0.0)

    r, slopes = at(theta, np.arange(len(theta)))
    chi2 = _chi2(r)
    damping = np.full(len(theta), DAMPING_MIN)
    active = np.isfinite(chi2)
    for _ in range(ROUNDS):
        rows = np.flatnonzero(active)
        if not len(rows):
            break
        step = np.zeros((len(rows), theta.shape[1]))
        step[:, which] = _step(theta[rows][:, which], r[rows], slopes[rows], [b[which] for b in bounds], damping[rows]) * scale[which]
        trial = np.clip(theta[rows] + step, *bounds)
        moved = np.abs((trial - theta[rows]) / scale).max(axis=1)
        # so near the end the derivatives stay what they are
        near = moved <= NEAR
        better = np.zeros(len(rows), dtype=bool)
        for some, anew in ((near, False), (~near, True)):
            own = rows[some]
            if not len(own):
                continue
            new_r, new_slopes = at(trial[some], own) if anew else (residuals(trial[some], own), slopes[own])
            new = _chi2(new_r)
            good = new <= chi2[own]
            ahead, better[some] = own[good], good
            theta[ahead], chi2[ahead], r[ahead], slopes[ahead] = trial[some][good], new[good], new_r[good], new_slopes[good]
        damping[rows] = np.where(better, damping[rows] / 10, np.maximum(damping[rows] * 10, DAMPING))
        active[rows] = (moved > STILL) & (damping[rows] < DAMPING_MAX)
    whole = np.isfinite(chi2)
    left = np.full((len(theta), len(which)), np.inf)
    left[whole] = _step(theta[whole][:, which], r[whole], slopes[whole], [b[which] for b in bounds], np.zeros(int(whole.sum())))
    # what a bound stops is as good as still
    reached = np.clip(theta[:, which] + left * scale[which], *(b[which] for b in bounds))
    return Minima(theta=theta, chi2=chi2, converged=whole & (np.abs((reached - theta[:, which]) / scale[which]).max(axis=1) <= CONVERGED))


def _chosen(found: tuple[FloatArray, FloatArray], which: NDArray[np.intp]) -> tuple[FloatArray, FloatArray]:
    r, slopes = found
    return r, slopes if len(which) == slopes.shape[1] else slopes[:, which]


def _differences(
    residuals: Residuals, theta: FloatArray, rows: IntArray, bounds: tuple[FloatArray, FloatArray], scale: FloatArray, which: NDArray[np.intp]
) -> tuple[FloatArray, FloatArray]:
    """Residuals and their derivatives with respect to what is free, by differences in one call."""
    # towards the middle, so that the derivative never asks beyond a bound
    side = np.where(theta[:, which] > np.clip(bounds, -1e12, 1e12).mean(axis=0)[which], -1.0, 1.0)
    h = 1e-4 * scale[which] * side
    shifted = theta[:, None, :] + np.zeros((1, len(which), 1))
    shifted[:, np.arange(len(which)), which] += h
    stacked = np.concatenate([theta[:, None, :], shifted], axis=1).reshape(-1, theta.shape[1])
    r = residuals(stacked, np.repeat(rows, len(which) + 1)).reshape(len(theta), len(which) + 1, -1)
    return r[:, 0], (r[:, 1:] - r[:, :1]) / h[:, :, None]


def _step(theta: FloatArray, r: FloatArray, slopes: FloatArray, bounds: list[FloatArray], damping: FloatArray) -> FloatArray:
    """A damped Newton step for each problem, in units of the scale; none for what stands at a bound and would leave it."""
    gradient = (slopes @ r[:, :, None])[..., 0]
    curved = slopes @ slopes.swapaxes(-1, -2)
    low, high = bounds
    stuck = ((theta <= low) & (gradient > 0)) | ((theta >= high) & (gradient < 0))
    gradient = np.where(stuck, 0.0, gradient)
    curved = np.where(stuck[:, :, None] | stuck[:, None, :], 0.0, curved)
    diagonal = np.einsum("kpp->kp", curved)
    extra = damping[:, None] * diagonal + 1e-12 * (diagonal.max(axis=1, keepdims=True) + 1e-300)
    own = curved + np.eye(theta.shape[1]) * np.where(diagonal > 0, extra, 1.0)[:, None, :]
    return np.asarray(-np.linalg.solve(own, gradient[..., None])[..., 0], dtype=np.float64)


def _chi2(r: FloatArray) -> FloatArray:
    total = np.einsum("kn,kn->k", r, r)
    return np.where(np.isfinite(total), total, np.inf)
