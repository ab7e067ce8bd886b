"""Refits of one problem to many resampled lifts.

All refits advance together (`fit.batched`), with the model's own derivatives, on residuals whitened
once. The trials stay, so the model is evaluated once per station, and a triangle of the stations'
size replaces all trials.
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import batched
from nearlift.fit.batched import Minima
from nearlift.likelihood.finite import where_finite
from nearlift.likelihood.problem import Problem
from nearlift.likelihood.stations import distinct
from nearlift.results import IntArray

#: Size of one batch of residuals and derivatives: what stays in a processor's own cache.
BATCH = 200_000
#: Ratio of stations to trials above which a triangle is not used.
WORTH = 0.5


def refit(
    problem: Problem, start: FloatArray, scale: FloatArray, *, log_lift: FloatArray
) -> Minima:
    """Fit each row of `log_lift` in place of the measured lifts, the covariance unchanged.

    Parameters
    ----------
    start : (p,)
        Such as the fit to the measured lifts.
    scale : (p,)
        Standard uncertainties, or other expected changes of the coefficients; positive.
    log_lift : (m, n)
        Natural logarithm of lift in N.
    """
    index, at = distinct(problem)
    target = problem.project(log_lift)
    rest: FloatArray = np.zeros(len(target))
    triangle = None
    if at.data.n > WORTH * problem.data.n:
        at = problem
    else:
        basis, triangle = np.linalg.qr(problem.project(np.eye(at.data.n)[index].T).T)
        whole = np.einsum("ij,ij->i", target, target)
        target = target @ basis
        rest = np.maximum(whole - np.einsum("ij,ij->i", target, target), 0.0)

    def folded(x: FloatArray) -> FloatArray:
        return problem.project(x) if triangle is None else where_finite(lambda x: x @ triangle.T, x)

    def fitted(target: FloatArray) -> Minima:
        def residuals(theta: FloatArray, rows: IntArray) -> FloatArray:
            return target[rows] - folded(at.log_ratio(theta))

        def linearised(theta: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
            return residuals(theta, rows), -folded(at.slopes(theta))

        first = np.tile(start, (len(target), 1))
        free = np.ones(len(start), dtype=bool)
        return batched.minimise(residuals, first, problem.model.bounds, scale, free, linearised)

    size = max(BATCH // (target.shape[1] * (len(start) + 1)), 1)
    parts = [fitted(target[first : first + size]) for first in range(0, len(target), size)]
    return Minima(
        theta=np.concatenate([part.theta for part in parts]),
        chi2=np.concatenate([part.chi2 for part in parts]) + rest,
        converged=np.concatenate([part.converged for part in parts]),
    )
