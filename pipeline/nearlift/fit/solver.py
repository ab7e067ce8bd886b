"""Nonlinear least squares: lmfit for a fit that is quoted, one batched method for all others.

Rivals, candidates, profiles, and fits of resampled or left-out trials need the same minimum at
dozens or thousands of nearby settings. One call of the model serves them all, by
Levenberg-Marquardt steps. Fits of one model then end with Newton steps, as lmfit's do, so that
both agree to rounding.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nearlift import derivative, isolation
from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.likelihood.problem import Likelihood
from nearlift.likelihood.stations import Stations
from nearlift.results import IntArray

#: Maximum number of steps of a search. Ours: good starts need about ten.
ROUNDS = 100
#: Step, relative to a parameter's scale, below which a search ends; chi2 then changes by 1e-14.
STILL = 1e-7
#: Damping relative to the diagonal (Marquardt 1963): at a start near the minimum and far from it,
#: at least after a failed step, and where the search gives up because steps are rounding.
DAMPING_MIN, FAR_DAMPING, DAMPING, DAMPING_MAX = 1e-8, 1.0, 1e-3, 1e10
#: Undamped step, relative to a parameter's scale, below which a search has converged. Ours: no
#: printed digit shows 1e-4 of a standard uncertainty.
CONVERGED = 1e-4
#: Change of the residuals by a step of one scale, relative to their size, below which a parameter
#: stays at its start. A derivative by differences is rounding below 1e-10.
NO_EFFECT = 1e-9
#: Damping, relative to the diagonal, that gives a singular normal matrix an inverse: above the
#: rounding of its elements, 1e-16 times their number.
RIDGE = 1e-12
#: Maximum number of Newton steps: each that is kept halves the step, and 2^-20 is 1e-6.
LAST_STEPS = 20
#: Relative singular value below which a Gauss-Newton step ignores a direction: rounding of slopes
#: by differences.
DETERMINED = 1e-9
#: Least curvature of a minimum of chi2, relative to that without misfit; rounding contributes 1e-8.
CURVED = 1e-6
#: Residual in place of one without a value: above any real misfit, so that lmfit can leave a pole.
NO_VALUE = 1e3

Values = Callable[[FloatArray, IntArray], FloatArray]


class System(NamedTuple):
    """Residuals (k, n) and their derivatives (k, p, n) of some of m problems.

    Each maps parameters (k, p) and their problems' indices (k,). Both are nan where the model has
    no value.
    """

    residuals: Values
    derivatives: Values

    def penalised(self, mean: FloatArray, sd: FloatArray) -> System:
        """System with a normal prior of each parameter, (p,) each, as a further residual."""

        def residuals(theta: FloatArray, rows: IntArray) -> FloatArray:
            return np.hstack([self.residuals(theta, rows), (theta - mean) / sd])

        def derivatives(theta: FloatArray, rows: IntArray) -> FloatArray:
            prior = np.broadcast_to(np.diag(1 / sd), (len(theta), len(sd), len(sd)))
            return np.concatenate([self.derivatives(theta, rows), prior], axis=2)

        return System(residuals, derivatives)


def system(problem: Likelihood) -> System:
    """System of a model's likelihood, the same for every row."""
    return System(lambda t, _: problem.residuals(t), lambda t, _: problem.derivatives(t))


def system_at(stations: Stations, target: FloatArray) -> System:
    """System of a likelihood at its stations for each row of `target` (m, r) by `Stations.target`.

    Where stations repeat, chi2 of a row is less by what no parameter changes.
    """

    def residuals(theta: FloatArray, rows: IntArray) -> FloatArray:
        return target[rows] - stations.white(stations.at.log_ratio(theta))

    return System(residuals, lambda theta, _: -stations.white(stations.at.slopes(theta)))


def solve(
    problem: Likelihood, start: FloatArray | None = None, *, quoted: bool = False
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
    scale, bounds, result = np.array(size), problem.model.bounds, None
    minima = minimise(system(problem), first[None], bounds, scale, damping=FAR_DAMPING)
    theta = minima.theta[0]
    if quoted or not minima.converged[0]:
        theta, result = _by_lmfit(problem, first, scale)
        if not result.success:
            raise NotConverged(
                f"fit of {problem.model.name}",
                f"lmfit stopped: {result.message}",
                "look at the residuals, or tighten the parameters' bounds",
            )
    best: FloatArray = refine(system(problem), theta[None], bounds)[0]
    return best, result


def _by_lmfit(problem: Likelihood, first: FloatArray, scale: FloatArray) -> tuple[FloatArray, Any]:
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


def _first(problem: Likelihood, start: FloatArray | None) -> FloatArray:
    """Starting values at which the model has a value for all trials: those given, else those
    declared, else others within the bounds.

    Raises
    ------
    NotConverged
        There are none.
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
    bad = problem.data.z_hat[~np.isfinite(problem.log_ratio(usual))]
    raise NotConverged(
        f"fit of {problem.model.name}",
        f"the model has no value at its start, {at}, for some of the {problem.data.n} trials, nor"
        " elsewhere",
        f"choose another model, or leave out the {len(bad)} trials without a value (z_hat from"
        f" {bad.min(initial=np.inf):.3g} to {bad.max(initial=0.0):.3g})",
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
    system: System,
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    scale: FloatArray | None = None,
    free: NDArray[np.bool_] | None = None,
    damping: float = DAMPING_MIN,
    enough: float = 0.0,
) -> Minima:
    """Minimise the sum of squares of each of m problems by Levenberg-Marquardt steps.

    Derivatives are taken only where a step has been accepted.

    Parameters
    ----------
    system : System
    start : (m, p)
    bounds : pair of (p,)
    scale : (p,), optional
        Typical change of each parameter. If not given, it moves chi2 by 1 at the first start.
    free : (p,) bool, optional
        Parameters that are optimised (all if not given); the others are held at their start.
    damping : float
        Of the first step, relative to the diagonal.
    enough : float
        Gain in chi2 by one step, or expected of a step that failed, below which a search has
        converged.
    """
    theta = np.clip(np.array(start, dtype=float), *bounds)
    which = np.arange(theta.shape[1]) if free is None else np.flatnonzero(free)
    limits = [b[which] for b in bounds]
    r = system.residuals(theta, np.arange(len(theta))).copy()
    chi2 = _chi2(r)
    converged = np.isfinite(chi2)
    if not len(which) or not converged.any():
        return Minima(theta=theta, chi2=chi2, converged=converged)
    slopes = np.zeros((len(theta), len(which), r.shape[1]))

    def differentiate(rows: IntArray) -> None:
        d = system.derivatives(theta[rows], rows)[:, which]
        slopes[rows] = np.nan_to_num(d, posinf=0.0, neginf=0.0)

    first = np.flatnonzero(converged)
    differentiate(first)
    if scale is None:
        length = np.linalg.norm(slopes[first[0]], axis=1)
        unit = 1 / np.where(length > 0, length, 1.0)
    else:
        unit = scale[which]

    def step(rows: IntArray, damping: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Points after a step within the bounds, its size, and the linear model's chi2 there."""
        at, scaled = theta[rows], slopes[rows] * unit[:, None]
        inner = _step(at[:, which], r[rows], scaled, limits, damping)
        at[:, which] = np.clip(at[:, which] + unit * inner, *limits)
        moved = np.abs((at - theta[rows])[:, which] / unit).max(axis=1)
        return at, moved, _chi2(r[rows] + (inner[:, None] @ scaled)[:, 0])

    damp = np.full(len(theta), damping)
    active, stale = converged.copy(), np.zeros(len(theta), dtype=bool)
    for _ in range(ROUNDS):
        rows = np.flatnonzero(active)
        if not len(rows):
            break
        if stale[rows].any():
            differentiate(rows[stale[rows]])
        trial, moved, linear = step(rows, damp[rows])
        new_r = system.residuals(trial, rows)
        new = _chi2(new_r)
        better = new <= chi2[rows]
        # only a step that is hardly damped shows by its failure that little is left to gain
        reached = np.where(better, new, np.where(damp[rows] < DAMPING, linear, -np.inf))
        converged[rows] = chi2[rows] - reached < enough
        ahead = rows[better]
        theta[ahead], chi2[ahead], r[ahead] = trial[better], new[better], new_r[better]
        stale[rows] = better
        damp[rows] = np.where(better, damp[rows] / 10, np.maximum(damp[rows] * 10, DAMPING))
        active[rows] = (moved > STILL) & (damp[rows] < DAMPING_MAX) & ~converged[rows]
    rest = first[~converged[first]]
    if len(rest):
        # there an undamped step has to be short; a bound may stop it
        differentiate(rest)
        converged[rest] = step(rest, np.zeros(len(rest)))[1] <= CONVERGED
    return Minima(theta=theta, chi2=chi2, converged=converged)


def refine(system: System, theta: FloatArray, bounds: tuple[FloatArray, FloatArray]) -> FloatArray:
    """Minima refined by Newton steps to a vanishing gradient of chi2, until the steps shrink no
    more.

    A search that compares values of chi2 stops at steps of about 1e-8 sqrt(chi2), at a point that
    depends on the processor. Gauss-Newton steps, which omit the residuals' curvature, converge
    slowly where the misfit is large, so the Hessian is taken by differences. Gauss-Newton steps are
    used where the Hessian shows no minimum, as along a direction that the data do not determine.

    Parameters
    ----------
    system : System
    theta : (m, p)
    bounds : pair of (p,)

    Returns
    -------
    (m, p)
        Unchanged in rows without a finite chi2.
    """
    rows = [_refined(system, i, x, bounds) for i, x in enumerate(theta)]
    return np.array(rows).reshape(theta.shape)


def _refined(
    system: System, row: int, best: FloatArray, bounds: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """One row of `refine`."""
    low, high = bounds

    def at(x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Residuals, slopes and gradient at x (k, p)."""
        rows = np.full(len(x), row)
        r = system.residuals(x, rows)
        slopes = np.nan_to_num(system.derivatives(x, rows), posinf=0.0, neginf=0.0)
        return r, slopes, (slopes @ np.nan_to_num(r)[:, :, None])[..., 0]

    def gradients(x: FloatArray) -> FloatArray:
        return at(x.reshape(-1, len(best)))[2].reshape(x.shape)

    r, slopes, gradient = (value[0] for value in at(best[None]))
    least, size = r @ r, np.linalg.norm(slopes, axis=1)
    if not np.isfinite(least):
        return best
    # what moves chi2 by 1
    unit = np.where(size > 0, 1 / np.where(size > 0, size, 1.0), 0.0)
    change, apart = derivative.central(gradients, best, unit, low, high)
    hessian = change / np.where(apart > 0, apart, 1.0)[:, None] * np.outer(unit, unit)
    # without a value nearby it shows no minimum
    hessian = np.nan_to_num((hessian + hessian.T) / 2, posinf=0.0, neginf=0.0)
    before = np.inf
    for _ in range(LAST_STEPS):
        held = ((best <= low) & (gradient > 0)) | ((best >= high) & (gradient < 0))
        free, step = (size > 0) & ~held, np.zeros(len(best))
        curvature = hessian[np.ix_(free, free)]
        if np.linalg.eigvalsh(curvature).min(initial=np.inf) > CURVED:
            step[free] = np.linalg.solve(curvature, -(gradient * unit)[free])
        else:
            columns = (slopes[free] * unit[free, None]).T
            step[free] = np.linalg.lstsq(columns, -r, rcond=DETERMINED)[0]
        trial = np.clip(best + step * unit, low, high)
        moved = float(np.max(np.abs(trial - best) * size, initial=0.0))
        new_r, new_slopes, new_gradient = (value[0] for value in at(trial[None]))
        if moved == 0 or moved >= before / 2 or not new_r @ new_r <= (1 + 1e-9) * least:
            break
        best, before, r, slopes, gradient = trial, moved, new_r, new_slopes, new_gradient
    return best


def _step(
    theta: FloatArray,
    r: FloatArray,
    slopes: FloatArray,
    limits: list[FloatArray],
    damping: FloatArray,
) -> FloatArray:
    """Damped Gauss-Newton steps in units of the scale; 0 for what has no effect or would leave a
    bound.
    """
    gradient = (slopes @ r[:, :, None])[..., 0]
    curved = slopes @ slopes.swapaxes(-1, -2)
    low, high = limits
    diagonal = np.einsum("kpp->kp", curved)
    held = ((theta <= low) & (gradient > 0)) | ((theta >= high) & (gradient < 0))
    held |= diagonal < NO_EFFECT**2 * _chi2(r)[:, None]
    step: FloatArray = np.zeros(theta.shape)
    # a correlated step may leave by a bound that the gradient alone would not
    for _ in range(theta.shape[1] + 1):
        free = np.where(held[:, :, None] | held[:, None, :], 0.0, curved)
        extra = np.where(held | (diagonal <= 0), 1.0, (damping[:, None] + RIDGE) * diagonal)
        damped = free + np.eye(theta.shape[1]) * extra[:, None, :]
        down = np.where(held, 0.0, -gradient)
        step = np.asarray(np.linalg.solve(damped, down[..., None])[..., 0], dtype=np.float64)
        leaving = ~held & (((theta <= low) & (step < 0)) | ((theta >= high) & (step > 0)))
        if not leaving.any():
            break
        held |= leaving
    return step


def _chi2(r: FloatArray) -> FloatArray:
    total = np.einsum("kn,kn->k", r, r)
    return np.where(np.isfinite(total), total, np.inf)
