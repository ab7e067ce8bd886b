"""Minimum of chi2 of one problem within its parameters' bounds, by lmfit; or of other residuals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from nearlift import isolation
from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit import batched
from nearlift.likelihood.problem import Problem


def finite_residuals(residuals: FloatArray) -> FloatArray:
    """Replace residuals without a value by one above any real misfit, so that a search can leave a
    pole.
    """
    return np.where(np.isfinite(residuals), residuals, 1e3)


def polished(
    residuals: Callable[[FloatArray], FloatArray],
    linearised: batched.Linearised,
    start: FloatArray,
    bounds: tuple[FloatArray, FloatArray],
    scale: FloatArray,
) -> FloatArray:
    """Minimum (1, p) of the sum of squares of `residuals`, by scipy from `start` (p,), refined by
    `batched.settled`.

    `scale` (p,) is the typical size of each parameter.
    """
    from scipy.optimize import least_squares

    minimum = least_squares(
        residuals,
        start,
        jac="3-point",
        bounds=bounds,
        x_scale=scale,
        xtol=1e-10,
        ftol=1e-10,
        gtol=1e-10,
    )
    return batched.settled(linearised, minimum.x[None], bounds)


def minimise(problem: Problem, start: FloatArray | None = None) -> FloatArray:
    """The theta of least chi2 within the parameters' bounds.

    Raises
    ------
    NotConverged
        lmfit stopped without convergence, or the model has no value for some trial at any start.
    """
    # it imports matplotlib
    lmfit = isolation.library("lmfit")
    declared = problem.model.parameters
    if not declared:
        return np.zeros(0)
    first = _first(problem, None if start is None else np.asarray(start, dtype=float))
    parameters = lmfit.Parameters()
    for p, value in zip(declared, first, strict=True):
        inset = 1e-9 * (p.bounds[1] - p.bounds[0])
        parameters.add(
            p.name,
            value=float(np.clip(value, p.bounds[0] + inset, p.bounds[1] - inset)),
            min=p.bounds[0],
            max=p.bounds[1],
        )

    def at(values: Any) -> FloatArray:
        return np.array([values[n].value for n in problem.names])

    def residuals(values: Any) -> FloatArray:
        return finite_residuals(problem.residuals(at(values)))

    def derivatives(values: Any) -> FloatArray:
        return np.nan_to_num(problem.derivatives(at(values)), posinf=0.0, neginf=0.0).T

    scale = np.array(
        [
            max(
                abs(p.value),
                0.05 * (min(p.bounds[1], p.value + 10) - max(p.bounds[0], p.value - 10)),
            )
            for p in declared
        ]
    )
    stop = {"xtol": 1e-12, "ftol": 1e-12, "gtol": 1e-12, "max_nfev": 2000}
    minimum = lmfit.minimize(
        residuals, parameters, method="least_squares", jac=derivatives, x_scale=scale, **stop
    )
    if not minimum.success:
        raise NotConverged(
            f"fit of {problem.model.name}",
            f"lmfit stopped: {minimum.message}",
            "look at the residuals, or tighten the parameters' bounds",
        )
    best: FloatArray = batched.settled(
        lambda theta, rows: problem.linearised(theta),
        at(minimum.params)[None],
        problem.model.bounds,
    )[0]
    return best


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
