"""Exact chi2 of thousands of parameter vectors at once, at the cost of distinct stations instead of
trials.

The model's log ratio takes one value per station (distance, and any other need of the model).
Whitening is linear, so ``chi2 = |t - A f(theta)|^2`` with one column of A per station. The triangle
of ``[A t]`` holds all of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.finite import where_finite
from nearlift.likelihood.problem import Likelihood
from nearlift.results import IntArray

#: With more stations than this the triangle costs more than whitening every trial, and only the
#: model is asked by station.
MOST = 400
#: Numbers held at once by one batch: few enough that they stay in a cache, and no new memory is
#: asked for at every step.
BATCH = 50_000


def distinct(problem: Likelihood) -> tuple[IntArray, Likelihood]:
    """The station of each trial (n,), and the problem at one trial of each station; its covariance
    is not that of the stations.
    """
    data = problem.data
    by_trial = [
        np.asarray(value, dtype=float)
        for name, value in problem.known.items()
        if name not in data.geometry
    ]
    _, first, index = np.unique(
        np.stack([data.z_hat, *by_trial]), axis=1, return_index=True, return_inverse=True
    )
    return index.ravel(), replace(
        problem, data=data.take(first), shift=np.broadcast_to(problem.shift, data.n)[first]
    )


@dataclass(frozen=True, kw_only=True)
class Stations:
    """A problem seen through its distinct stations `at`, trial i standing at station `index[i]`.

    `triangle` (s + 1, s + 1) gives chi2 and `level_rows` (k, s) L_inf; both are None where stations
    are many, and trials are whitened.
    """

    problem: Likelihood
    at: Likelihood
    index: IntArray
    triangle: FloatArray | None
    level_rows: FloatArray | None

    @classmethod
    def from_problem(cls, problem: Likelihood) -> Stations:
        """The stations of a problem."""
        index, at = distinct(problem)
        if at.data.n > MOST or at.data.n + 1 > problem.data.n:
            return cls(problem=problem, at=at, index=index, triangle=None, level_rows=None)
        indicator = np.eye(at.data.n)[index]
        columns = problem.project(indicator.T)
        target = problem.project(np.log(problem.data.lift_N))
        triangle = np.asarray(
            np.linalg.qr(np.vstack([columns, target]).T, mode="r"), dtype=np.float64
        )
        return cls(
            problem=problem,
            at=at,
            index=index,
            triangle=triangle,
            level_rows=problem.d_shown_levels_d_theta(indicator),
        )

    def chi2(self, theta: FloatArray) -> FloatArray:
        """Chi2 for theta (m, p), (m,); inf where the model has no value. See `Likelihood.chi2`."""
        return np.concatenate([np.zeros(0), *(self._chi2(some) for some in self._batches(theta))])

    def _batches(self, theta: FloatArray) -> Iterator[FloatArray]:
        size = max(
            BATCH // (self.problem.data.n if self.triangle is None else self.at.data.n + 1), 1
        )
        return (theta[i : i + size] for i in range(0, len(theta), size))

    def _chi2(self, theta: FloatArray) -> FloatArray:
        log_ratio, triangle = self.at.log_ratio(theta), self.triangle
        if triangle is None:
            r = self.problem.left(log_ratio[:, self.index])
        else:
            r = where_finite(lambda x: x @ triangle[:, :-1].T, log_ratio) - triangle[:, -1]
        total = np.einsum("ij,ij->i", r, r)
        return np.where(np.isfinite(total), total, np.inf)

    def log_levels(self, theta: FloatArray) -> FloatArray:
        """Log L_inf per throttle given theta (m, p): (m, k)."""
        return np.concatenate(
            [
                np.zeros((0, len(self.problem.data.levels))),
                *(self._log_levels(some) for some in self._batches(theta)),
            ]
        )

    def _log_levels(self, theta: FloatArray) -> FloatArray:
        log_ratio, rows = self.at.log_ratio(theta), self.level_rows
        if rows is None:
            return (
                self.problem.level_mean
                + self.problem.d_shown_levels_d_theta(log_ratio[:, self.index].T).T
            )
        return self.problem.level_mean + where_finite(lambda x: x @ rows.T, log_ratio)
