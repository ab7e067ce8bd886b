"""The same problem fitted again and again, to resampled lifts.

All refits advance together (`fit.batched`), with the model's own derivatives, on residuals
whitened once. The trials stay, so the prediction takes one value per station, and a triangle of the
stations' size stands for all trials.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import NotConverged
from nearlift.fit import batched
from nearlift.likelihood.finite import where_finite
from nearlift.likelihood.problem import Problem
from nearlift.likelihood.stations import distinct
from nearlift.results import IntArray

Found = TypeVar("Found")
#: Numbers that one batch of residuals and derivatives may hold: what stays in a processor's own
#: cache.
BATCH = 200_000
#: More stations than this part of the trials are not worth a triangle.
WORTH = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Refits:
    """What each of m refits found.

    Attributes
    ----------
    names : tuple of str
        The coefficients, in the order of `theta`.
    theta : (m, p)
    chi2 : (m,)
    converged : (m,) bool
        Where it is False the row of `theta` is where the search gave up, and no estimate.
    """

    names: tuple[str, ...]
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


def refit(
    problem: Problem, start: FloatArray, scale: FloatArray, *, log_lift: FloatArray
) -> Refits:
    """Fit each row of `log_lift` as if it had been measured in the trials' place, the covariance as
    it is.

    Parameters
    ----------
    problem : Problem
    start : (p,)
        Such as the fit to the measured lifts.
    scale : (p,)
        Standard uncertainties, or whatever else a coefficient may be expected to change by;
        positive.
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

    def residuals(theta: FloatArray, rows: IntArray) -> FloatArray:
        return target[rows] - folded(at.log_ratio(theta))

    def linearised(theta: FloatArray, rows: IntArray) -> tuple[FloatArray, FloatArray]:
        return residuals(theta, rows), -folded(at.slopes(theta))

    low, high = (np.array([q.bounds[end] for q in problem.model.parameters]) for end in (0, 1))
    free = np.ones(len(start), dtype=bool)
    # batches that fit into a cache
    size = max(BATCH // (target.shape[1] * (len(start) + 1)), 1)
    parts = []
    for first in range(0, len(target), size):
        own = np.tile(start, (min(size, len(target) - first), 1))
        parts.append(
            batched.minimise(
                _from(residuals, first), own, (low, high), scale, free, _from(linearised, first)
            )
        )
    return Refits(
        names=problem.names,
        theta=np.concatenate([np.zeros((0, len(start))), *(p.theta for p in parts)]),
        chi2=np.concatenate([np.zeros(0), *(p.chi2 for p in parts)]) + rest,
        converged=np.concatenate([np.zeros(0, dtype=bool), *(p.converged for p in parts)]),
    )


def _from(
    function: Callable[[FloatArray, IntArray], Found], first: int
) -> Callable[[FloatArray, IntArray], Found]:
    """The same function for a batch that begins with problem `first`."""
    return lambda theta, rows: function(theta, rows + first)
