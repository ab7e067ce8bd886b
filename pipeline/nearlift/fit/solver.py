"""Nonlinear least squares: lmfit for a fit that is quoted, one batched method for all others.

Rivals, profiles, and fits of resampled or left-out trials need the same minimum at dozens or
thousands of nearby settings. One call of the model serves them
all, by Levenberg-Marquardt steps. Both end with Newton steps, so
that they agree to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import isolation
from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.likelihood.problem import Problem
from nearlift.results import IntArray

#: Maximum number of iterations.
ROUNDS = 100
#: Step, relative to a parameter's scale, below which the search ends.
STILL = 1e-7
#: Damping relative to the diagonal: at a start near the minimum and far from it, at least after a
#: failed step, and where the search gives up.
DAMPING_MIN, FAR_DAMPING, DAMPING, DAMPING_MAX = 1e-8, 1.0, 1e-3, 1e10
#: A problem has converged where an undamped step would be smaller than this, relative to every
#: parameter's scale.
CONVERGED = 1e-4
#: Change of the residuals by a step of one scale, relative to their size, below which a parameter
#: stays at its start: the derivatives are then rounding.
NO_EFFECT = 1e-9
#: Maximum number of Newton steps, and the relative singular value below which a Gauss-Newton step
#: ignores a direction.
LAST_STEPS, DETERMINED = 20, 1e-9
#: Step of the differences for chi2's curvature, in units of what moves chi2 by 1, and the least
#: curvature of a minimum, relative to that without misfit; rounding contributes 1e-11.
CURVATURE_STEP, CURVED = 1e-3, 1e-6
#: Residual in place of one without a value: above any real misfit, so that lmfit can leave a pole.
NO_VALUE = 1e3

Linearised = Callable[[FloatArray, IntArray], tuple[FloatArray, FloatArray]]


def solve(
    problem: Problem, start: FloatArray | None = None, *, quoted: bool = False
) -> tuple[FloatArray, Any]:
    """The theta (p,) of least chi2 within the parameters' bounds, and lmfit's result if `quoted` or
    where Levenberg-Marquardt steps end at no minimum.

    Raises
    ------
    NotConverged
        lmfit stopped short of a minimum, or the model has no value for some trial at any
        start.
    """
    parameters = problem.model.parameters
    if not parameters:
        return np.zeros(0), None
    first = _first(problem, None if start is None else np.asarray(start, dtype=float))
    size = [
        max(abs(p.value), 0.05 * (min(p.bounds[1], p.value + 10) - max(p.bounds[0], p.value - 10)))
        for p in parameters
    ]
    scale = np.array(size)

    def linearised(theta: FloatArray, _: IntArray) -> tuple[FloatArray, FloatArray]:
        return problem.linearised(theta)

    bounds, result = problem.model.bounds, None
    minima = minimise(linearised, first[None], bounds, scale, damping=FAR_DAMPING)
    theta = minima.theta[0]
    if quoted or not minima.converged[0]:
        theta, result = _by_lmfit(problem, first, scale)
        if not result.success:
            raise NotConverged(
                f"fit of {problem.model.name}",
                f"lmfit stopped: {result.message}",
                "look at the residuals, or tighten the parameters' bounds",
            )
    best: FloatArray = refine(linearised, theta[None], bounds)[0]
    return best, result


def _by_lmfit(problem: Problem, first: FloatArray, scale: FloatArray) -> tuple[FloatArray, Any]:
    """Minimum and lmfit's result; its standard errors are those of the covariance as it is."""
    # it imports matplotlib
    lmfit = isolation.library("lmfit")
    parameters = lmfit.Parameters()
    for p, value in zip(problem.model.parameters, first, strict=True):
        inset = 1e-9 * (p.bounds[1] - p.bounds[0])
        value = float(np.clip(value, p.bounds[0] + inset, p.bounds[1] - inset))
        parameters.add(p.name, value=value, min=p.bounds[0], max=p.bounds[1])

    def at(values: Any) -> FloatArray:
        return np.array([values[n].value for n in problem.names])

    def residuals(values: Any) -> FloatArray:
        r = problem.residuals(at(values))
        return np.where(np.isfinite(r), r, NO_VALUE)

    def derivatives(values: Any) -> FloatArray:
        return np.nan_to_num(problem.derivatives(at(values)), posinf=0.0, neginf=0.0).T

    stop = {"xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12, "max_nfev": 2000}
    result = lmfit.minimize(
        residuals,
        parameters,
        method="least_squares",
        scale_covar=False,
        jac=derivatives,
        x_scale=scale,
        **stop,
    )
    return at(result.params), result


def _first(problem: Problem, start: FloatArray | None) -> FloatArray:
    """Starting values at which the model has a value for all trials: those given, else those
    declared, else others within the bounds.

    Raises
    ------
    NotConverged
        There are none; the remedy depends on which trials are to blame.
    """
    low, high = problem.model.bounds
    usual: FloatArray = np.array([p.value for p in problem.model.parameters], dtype=np.float64)
    inner: list[FloatArray] = [
        usual + share * (end - usual)
        for end in (low, high)
        for share in (0.05, 0.2, 0.5)
        if np.isfinite(end).all()
    ]
    for first in ([] if start is None else [start]) + [usual, *inner]:
        if np.isfinite(problem.chi2(first)):
            return first
    at = ", ".join(
        f"{n} = {v:g}"
        for n, v in zip(problem.names, usual if start is None else start, strict=True)
    )
    bad, z_hat = ~np.isfinite(problem.log_ratio(usual)), problem.data.z_hat
    if bad.all() or z_hat[bad].max() > z_hat[~bad].min():
        remedy = "choose another model: the trials to blame are not those nearest to the boundary"
    else:
        remedy = (
            f"leave out the {bad.sum()} trials nearest to the boundary (z_hat up to"
            f" {z_hat[bad].max():.3g}), or choose another model"
        )
    raise NotConverged(
        f"fit of {problem.model.name}",
        f"the model has no value at its start, {at}, for some of the {problem.data.n} trials, nor"
        " elsewhere",
        remedy,
    )


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


def minimise(
    linearised: Linearised,
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    scale: FloatArray,
    free: NDArray[np.bool_] | None = None,
    damping: float = DAMPING_MIN,
) -> Minima:
    """Minimise the sum of squares of each of m problems by Levenberg-Marquardt steps.

    A prior of a parameter is a further residual.

    Parameters
    ----------
    linearised : callable
        Maps parameters (k, p) and their problems' indices (k,) to residuals (k, n) and derivatives
        (k, p, n). Both are nan where the model has no value.
    start : (m, p)
    bounds : pair of (p,)
    scale : (p,)
        Typical size of each parameter's change, such as its standard uncertainty.
    free : (p,) bool, optional
        Parameters that are optimised (all if not given); the others are held at their start.
    damping : float
        Of the first step, relative to the diagonal.
    """
    theta = np.clip(np.array(start, dtype=float), *bounds)
    which = np.arange(theta.shape[1]) if free is None else np.flatnonzero(free)
    limits = [b[which] for b in bounds]

    def at(theta: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        r, slopes = linearised(theta, rows)
        slopes = slopes[:, which] * scale[which][:, None]
        return _chi2(r), r, np.nan_to_num(slopes, posinf=0.0, neginf=0.0)

    chi2, r, slopes = at(theta, np.arange(len(theta)))
    if not len(which):
        return Minima(theta=theta, chi2=chi2, converged=np.isfinite(chi2))
    r, slopes = r.copy(), slopes.copy()
    damp = np.full(len(theta), damping)
    active = np.isfinite(chi2)
    for _ in range(ROUNDS):
        rows = np.flatnonzero(active)
        if not len(rows):
            break
        trial = theta[rows]
        trial[:, which] += scale[which] * _step(
            trial[:, which], r[rows], slopes[rows], limits, damp[rows]
        )
        trial = np.clip(trial, *bounds)
        moved = np.abs((trial - theta[rows]) / scale).max(axis=1)
        new, new_r, new_slopes = at(trial, rows)
        better = new <= chi2[rows]
        ahead = rows[better]
        theta[ahead], chi2[ahead], r[ahead], slopes[ahead] = (
            x[better] for x in (trial, new, new_r, new_slopes)
        )
        damp[rows] = np.where(better, damp[rows] / 10, np.maximum(damp[rows] * 10, DAMPING))
        active[rows] = (moved > STILL) & (damp[rows] < DAMPING_MAX)
    whole = np.isfinite(chi2)
    left = np.full((len(theta), len(which)), np.inf)
    left[whole] = _step(
        theta[whole][:, which], r[whole], slopes[whole], limits, np.zeros(int(whole.sum()))
    )
    # a step that a bound stops counts as converged
    reached = np.clip(theta[:, which] + left * scale[which], *limits)
    remaining = np.abs((reached - theta[:, which]) / scale[which]).max(axis=1)
    return Minima(theta=theta, chi2=chi2, converged=whole & (remaining <= CONVERGED))


def refine(
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


def _step(
    theta: FloatArray,
    r: FloatArray,
    slopes: FloatArray,
    bounds: list[FloatArray],
    damping: FloatArray,
) -> FloatArray:
    """Damped Gauss-Newton steps in units of the scale; 0 for what has no effect or would leave a
    bound.
    """
    gradient = (slopes @ r[:, :, None])[..., 0]
    curved = slopes @ slopes.swapaxes(-1, -2)
    low, high = bounds
    stuck = ((theta <= low) & (gradient > 0)) | ((theta >= high) & (gradient < 0))
    stuck |= np.einsum("kpp->kp", curved) < NO_EFFECT**2 * _chi2(r)[:, None]
    gradient = np.where(stuck, 0.0, gradient)
    curved = np.where(stuck[:, :, None] | stuck[:, None, :], 0.0, curved)
    diagonal = np.einsum("kpp->kp", curved)
    extra = damping[:, None] * diagonal + 1e-12 * (diagonal.max(axis=1, keepdims=True) + 1e-300)
    damped = curved + np.eye(theta.shape[1]) * np.where(diagonal > 0, extra, 1.0)[:, None, :]
    return np.asarray(-np.linalg.solve(damped, gradient[..., None])[..., 0], dtype=np.float64)


def _chi2(r: FloatArray) -> FloatArray:
    total = np.einsum("kn,kn->k", r, r)
    return np.where(np.isfinite(total), total, np.inf)
