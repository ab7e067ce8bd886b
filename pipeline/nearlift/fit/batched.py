"""Batched nonlinear least squares: many small problems solved at once by the Levenberg-Marquardt
method.

Parameters may have bounds or be fixed. Profiles, integrals over an unknown height, and resampled or
left-out trials need the same minimum at dozens or thousands of nearby settings. One call of the
model serves them all.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.results import IntArray

#: Maximum number of iterations.
ROUNDS = 60
#: Step, relative to a parameter's scale, below which the search ends.
STILL = 1e-7
#: Relative step below which the Jacobian is reused: where residuals do not vanish at the minimum,
#: an older Jacobian would displace it by as much.
NEAR = 1e-6
#: Damping relative to the diagonal: at the start, at least after a failed step, and where the
#: search gives up.
DAMPING_MIN, DAMPING, DAMPING_MAX = 1e-8, 1e-3, 1e10
#: A problem has converged where an undamped step would be smaller than this, relative to every
#: parameter's scale.
CONVERGED = 1e-4
#: Maximum number of Newton steps, and the relative singular value below which a Gauss-Newton step
#: ignores a direction.
LAST_STEPS, DETERMINED = 20, 1e-9
#: Step of the differences for chi2's curvature, in units of what moves chi2 by 1, and the least
#: curvature of a minimum, relative to that without misfit; rounding contributes 1e-11.
CURVATURE_STEP, CURVED = 1e-3, 1e-6

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
        False where the search stopped short of a minimum; leave these out of any mean.
    """

    theta: FloatArray
    chi2: FloatArray
    converged: NDArray[np.bool_]

    def good(self) -> FloatArray:
        """The converged rows of `theta`.

        Raises
        ------
        NotConverged
            More than 1 % failed: the remaining rows would be a biased selection.
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
        Maps parameters (k, p) and the indices (k,) of their problems to residuals (k, n); nan where
        the model has no value.
    start : (m, p)
    bounds : pair of (p,)
    scale : (p,)
        Typical size of each parameter's change, such as its standard uncertainty.
    free : (p,) bool
        Parameters that are optimised; the others are held at their start.
    linearised : callable, optional
        Maps the same arguments to residuals (k, n) and their derivatives (k, p, n); one-sided
        differences without it.
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
        # so close to the minimum the Jacobian is reused
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
    # a step that a bound stops counts as converged
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
    """Minima refined by Newton steps to a vanishing gradient of chi2, until the steps shrink no
    more.

    A search that compares values of chi2 stops at steps of about 1e-8 sqrt(chi2), at a point that
    depends on the processor. Gauss-Newton steps, which omit the residuals' curvature, converge
    slowly where the misfit is large, so the Hessian is taken by differences. Gauss-Newton steps are
    used where the Hessian shows no minimum, as along a direction that the data do not determine.

    Parameters
    ----------
    linearised : callable
        As in `minimise`.
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
    """Residuals and derivatives with respect to the free parameters, by one-sided differences."""
    # towards the middle, so that the model is never evaluated beyond a bound
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
    """Damped Gauss-Newton steps in units of the scale; 0 for what would leave a bound."""
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
