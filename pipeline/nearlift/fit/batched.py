"""Many small least-squares problems at once: Levenberg and Marquardt's method on a stack, with
bounds and with some parameters held.

Profiles, integrals over an unknown height, resampled and left-out trials ask for the same minimum
at dozens or thousands of nearby settings; one call of the model serves them all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged

ROUNDS = 60
#: A step smaller than this part of a parameter's scale ends the search.
STILL = 1e-7
#: Below this the derivatives are not taken anew: residuals do not vanish at the minimum, so older
#: ones would put it elsewhere by as much.
NEAR = 1e-6
#: Damping relative to the diagonal: at first hardly any, this much after a step that failed, and
#: what ends the search.
DAMPING_MIN, DAMPING, DAMPING_MAX = 1e-8, 1e-3, 1e10
#: A problem counts as converged where an undamped step would be smaller than this part of every
#: parameter's scale.
CONVERGED = 1e-4
#: Last steps at most, and the least ratio of singular values of a direction in which they go by the
#: slopes alone.
LAST_STEPS, DETERMINED = 20, 1e-9
#: Step of the differences that give chi2's curvature, in units of what moves chi2 by 1, and the
#: least curvature, in units of that without misfit, that is a minimum's: rounding puts 1e-11 into
#: it.
CURVATURE_STEP, CURVED = 1e-3, 1e-6

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

    def good(self) -> FloatArray:
        """The rows of `theta` that are estimates.

        Raises
        ------
        NotConverged
            More than one in a hundred failed: the rest would be a choice of the lucky ones.
        """
        failed = int((~self.converged).sum())
        if failed > 0.01 * len(self.theta):
            raise NotConverged(
                "refit",
                f"{failed} of {len(self.theta)} did not converge",
                "look at the residuals, or tighten the parameters' bounds",
            )
        return self.theta[self.converged]


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
        Parameters (k, p) and which problems (k,) they belong to, to residuals (k, n); nan where the
        model has no value.
    start : (m, p)
    bounds : pair of (p,)
    scale : (p,)
        Typical size of each parameter's change, such as its standard uncertainty.
    free : (p,) bool
        What is optimised; the rest is held at its start.
    linearised : callable, optional
        The same arguments, to residuals (k, n) and their derivatives (k, p, n); without it,
        differences are taken.
    """
    theta = np.clip(np.array(start, dtype=float), *bounds)
    which = np.flatnonzero(free)
    if not len(which):
        chi2 = _chi2(residuals(theta, np.arange(len(theta))))
        return Minima(theta=theta, chi2=chi2, converged=np.isfinite(chi2))

    def at(theta: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        if linearised is None:
            r, slopes = _differences(residuals, theta, rows, bounds, scale, which)
        else:
            r, slopes = linearised(theta, rows)
            slopes = slopes if len(which) == slopes.shape[1] else slopes[:, which]
        slopes = slopes * scale[which][:, None]
        return r, slopes if np.isfinite(slopes.sum()) else np.nan_to_num(
            slopes, posinf=0.0, neginf=0.0
        )

    r, slopes = at(theta, np.arange(len(theta)))
    chi2 = _chi2(r)
    damping = np.full(len(theta), DAMPING_MIN)
    active = np.isfinite(chi2)
    for _ in range(ROUNDS):
        rows = np.flatnonzero(active)
        if not len(rows):
            break
        step = np.zeros((len(rows), theta.shape[1]))
        step[:, which] = (
            _step(
                theta[rows][:, which],
                r[rows],
                slopes[rows],
                [b[which] for b in bounds],
                damping[rows],
            )
            * scale[which]
        )
        trial = np.clip(theta[rows] + step, *bounds)
        moved = np.abs((trial - theta[rows]) / scale).max(axis=1)
        # so near the end the derivatives stay what they are
        near = moved <= NEAR
        better = np.zeros(len(rows), dtype=bool)
        for some, anew in ((near, False), (~near, True)):
            members = rows[some]
            if not len(members):
                continue
            new_r, new_slopes = (
                at(trial[some], members)
                if anew
                else (residuals(trial[some], members), slopes[members])
            )
            new = _chi2(new_r)
            good = new <= chi2[members]
            ahead, better[some] = members[good], good
            theta[ahead], chi2[ahead], r[ahead], slopes[ahead] = (
                trial[some][good],
                new[good],
                new_r[good],
                new_slopes[good],
            )
        damping[rows] = np.where(
            better, damping[rows] / 10, np.maximum(damping[rows] * 10, DAMPING)
        )
        active[rows] = (moved > STILL) & (damping[rows] < DAMPING_MAX)
    whole = np.isfinite(chi2)
    left = np.full((len(theta), len(which)), np.inf)
    left[whole] = _step(
        theta[whole][:, which],
        r[whole],
        slopes[whole],
        [b[which] for b in bounds],
        np.zeros(int(whole.sum())),
    )
    # what a bound stops is as good as still
    reached = np.clip(theta[:, which] + left * scale[which], *(b[which] for b in bounds))
    return Minima(
        theta=theta,
        chi2=chi2,
        converged=whole
        & (np.abs((reached - theta[:, which]) / scale[which]).max(axis=1) <= CONVERGED),
    )


def settled(
    linearised: Linearised, theta: FloatArray, bounds: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Newton's steps from each of m minima to where the gradient of chi2 vanishes, until they
    shrink no more.

    A search by trial stops where chi2, a large number, no longer falls: at a step of 1e-8 of its
    root, and where exactly depends on the processor. Gauss and Newton's steps, which leave the
    residuals' own curvature out, hardly shrink beside a large misfit, so that is taken by
    differences; where it shows no minimum (a direction that the data do not determine), they serve.

    Parameters
    ----------
    linearised : callable
        As `minimise` takes it.
    theta : (m, p)
    bounds : pair of (p,)

    Returns
    -------
    (m, p)
        Unchanged in rows without a finite chi2.
    """
    low, high = bounds

    def at(theta: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        r, slopes = linearised(theta, rows)
        slopes = np.nan_to_num(slopes, posinf=0.0, neginf=0.0)
        return r, slopes, (slopes @ np.nan_to_num(r)[:, :, None])[..., 0]

    every = np.arange(len(theta))
    r, slopes, gradient = at(theta, every)
    least, size = _chi2(r), np.linalg.norm(slopes, axis=2)
    unit = np.where(size > 0, 1 / np.where(size > 0, size, 1.0), 0.0)
    moves = np.eye(theta.shape[1])[:, None, :] * CURVATURE_STEP * unit
    bent = (
        np.stack([at(theta + h, every)[2] - at(theta - h, every)[2] for h in moves], axis=2)
        * unit[:, :, None]
        / (2 * CURVATURE_STEP)
    )
    bent = (bent + bent.swapaxes(1, 2)) / 2
    r, best, before, active = r.copy(), theta, np.full(len(theta), np.inf), np.isfinite(least)
    for _ in range(LAST_STEPS):
        rows = np.flatnonzero(active)
        if not len(rows):
            break
        step = np.zeros((len(rows), theta.shape[1]))
        for k, row in enumerate(rows):
            g = gradient[row]
            free = (
                (size[row] > 0) & ~((best[row] <= low) & (g > 0)) & ~((best[row] >= high) & (g < 0))
            )
            curvature, down = bent[row][np.ix_(free, free)], -(g * unit[row])[free]
            if np.linalg.eigvalsh(curvature).min(initial=np.inf) > CURVED:
                step[k, free] = np.linalg.solve(curvature, down) * unit[row, free]
            else:
                step[k, free] = (
                    np.linalg.lstsq(
                        (slopes[row, free] * unit[row, free, None]).T, -r[row], rcond=DETERMINED
                    )[0]
                    * unit[row, free]
                )
        trial = np.clip(best[rows] + step, low, high)
        moved = np.max(np.abs(trial - best[rows]) * size[rows], axis=1, initial=0.0)
        new_r, new_slopes, new_gradient = at(trial, rows)
        good = (moved < before[rows] / 2) & (_chi2(new_r) <= (1 + 1e-9) * least[rows])
        ahead = rows[good]
        best = best.copy()
        best[ahead], before[ahead], r[ahead], slopes[ahead], gradient[ahead] = (
            x[good] for x in (trial, moved, new_r, new_slopes, new_gradient)
        )
        active[rows] = good & (moved > 0)
    return best


def _differences(
    residuals: Residuals,
    theta: FloatArray,
    rows: IntArray,
    bounds: tuple[FloatArray, FloatArray],
    scale: FloatArray,
    which: NDArray[np.intp],
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


def _step(
    theta: FloatArray,
    r: FloatArray,
    slopes: FloatArray,
    bounds: list[FloatArray],
    damping: FloatArray,
) -> FloatArray:
    """A damped Newton step for each problem, in units of the scale; none for what stands at a bound
    and would leave it.
    """
    gradient = (slopes @ r[:, :, None])[..., 0]
    curved = slopes @ slopes.swapaxes(-1, -2)
    low, high = bounds
    stuck = ((theta <= low) & (gradient > 0)) | ((theta >= high) & (gradient < 0))
    gradient = np.where(stuck, 0.0, gradient)
    curved = np.where(stuck[:, :, None] | stuck[:, None, :], 0.0, curved)
    diagonal = np.einsum("kpp->kp", curved)
    extra = damping[:, None] * diagonal + 1e-12 * (diagonal.max(axis=1, keepdims=True) + 1e-300)
    damped = curved + np.eye(theta.shape[1]) * np.where(diagonal > 0, extra, 1.0)[:, None, :]
    return np.asarray(-np.linalg.solve(damped, gradient[..., None])[..., 0], dtype=np.float64)


def _chi2(r: FloatArray) -> FloatArray:
    total = np.einsum("kn,kn->k", r, r)
    return np.where(np.isfinite(total), total, np.inf)
