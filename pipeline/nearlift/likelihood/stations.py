"""Least squares of thousands of parameter vectors or resamples, at the cost of distinct stations.

The model's log ratio f takes one value per station (distance, and any other need of the model).
Whitening is linear, so the residuals of trials y are ``P y - A f(theta)`` with one column of A per
station. Only their part ``Q' P y - R f`` in the span of ``A = Q R`` depends on theta.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.covariance import group_sums
from nearlift.likelihood.problem import Likelihood, where_finite
from nearlift.results import IntArray

#: With more stations than this their triangle costs more than whitening every trial.
MOST = 400
#: Numbers held at once by one batch: few enough that they stay in a cache, and no new memory is
#: asked for at every step.
BATCH = 50_000


@dataclass(frozen=True, kw_only=True)
class Stations:
    """A problem at its distinct stations: `at` has one trial of each, and no `shift`; trial i is at
    station `index[i]`.

    `triangle` (s, s) is R, and `weights` (s, n) are Q' P; both are None where stations are many,
    and trials are whitened.
    """

    problem: Likelihood
    at: Likelihood
    index: IntArray
    triangle: FloatArray | None = None
    weights: FloatArray | None = None

    @classmethod
    def from_problem(cls, problem: Likelihood) -> Stations:
        """The stations of a problem."""
        data = problem.data
        needs = [
            np.asarray(value, dtype=float)
            for name, value in problem.known.items()
            if name not in data.geometry
        ]
        _, first, index = np.unique(
            np.stack([data.z_hat, *needs]), axis=1, return_index=True, return_inverse=True
        )
        at = replace(problem, data=data.take(first), shift=0.0)
        stations = cls(problem=problem, at=at, index=index.ravel())
        if len(first) > MOST or len(first) == data.n:
            return stations
        q, r = np.linalg.qr(problem.project(np.eye(len(first))[stations.index].T).T)
        return replace(stations, triangle=r, weights=problem.unproject(q.T))

    def target(self, log_lift: FloatArray) -> FloatArray:
        """Whitened part of log lift (..., n) that parameters may explain."""
        rest = log_lift - self.problem.shift
        return self.problem.project(rest) if self.weights is None else rest @ self.weights.T

    def white(self, x: FloatArray) -> FloatArray:
        """Whitened values (..., s) of stations, as in `target`."""
        triangle = self.triangle
        if triangle is None:
            return self.problem.project(x[..., self.index])
        return where_finite(lambda x: x @ triangle.T, x)

    @cached_property
    def measured(self) -> tuple[FloatArray, float]:
        """Target of the trials, and the part of chi2 that no parameter changes."""
        log_lift = np.log(self.problem.data.lift_N)
        target, whole = self.target(log_lift), self.problem.project(log_lift - self.problem.shift)
        return target, float(whole @ whole - target @ target)

    def chi2(self, theta: FloatArray) -> FloatArray:
        """Chi2 for theta (m, p), (m,); inf where the model has no value. See `Likelihood.chi2`."""
        target, rest = self.measured
        total = np.zeros(len(theta))
        for some in self.batches(len(theta)):
            r = target - self.white(self.at.log_ratio(theta[some]))
            total[some] = np.einsum("ij,ij->i", r, r) + rest
        return np.where(np.isfinite(total), total, np.inf)

    def log_levels(self, theta: FloatArray) -> FloatArray:
        """Log L_inf per throttle given theta (m, p): (m, k)."""
        gain = self.problem.d_shown_levels_d_lift
        mean = gain @ (np.log(self.problem.data.lift_N) - self.problem.shift)
        rows = group_sums(gain, self.index)
        levels = np.zeros((len(theta), len(mean)))
        for some in self.batches(len(theta)):
            log_ratio = self.at.log_ratio(theta[some])
            levels[some] = mean - where_finite(lambda x: x @ rows.T, log_ratio)
        return levels

    def batches(self, m: int) -> Iterator[slice]:
        """Slices of m rows that stay in a processor's cache."""
        size = max(BATCH // (self.problem if self.triangle is None else self.at).data.n, 1)
        return (slice(i, i + size) for i in range(0, m, size))
