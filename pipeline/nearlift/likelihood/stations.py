"""Least squares of thousands of parameter vectors or resamples, at the cost of a few distances.

The model's log ratio f of all trials is ``B f(stations)``: a trial has the value of its station.
Where distances hardly repeat, it is interpolated between Chebyshev nodes of log distance, to
rounding. Whitening is linear, so the residuals of trials y are ``P y - P B f(theta)``. Only their
part ``Q' P y - R f`` in the span of ``P B = Q R`` depends on theta.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.problem import Likelihood, where_finite

#: Most stations with a triangle. Ours, by timing: with more, whitening every trial is faster.
MOST = 400
#: Nodes of log distance. Ours: 48 resolve every model from 0.5 to 12 rotor radii to rounding.
NODES = 64
#: Standard uncertainties to either side of the fit within which nodes must be exact, and the
#: largest error of a trial's log ratio that counts as exact. Ours: 1e-6 of any load cell's scatter.
REACH, EXACT = 8.0, 1e-10
#: Numbers held at once by one batch. Ours: few enough to stay in a cache.
BATCH = 50_000


@dataclass(frozen=True, kw_only=True)
class Stations:
    """A problem at its stations: `at` has one trial of each, and no `shift`.

    `levels` (k, s) is the change of each shown log L_inf per unit of log ratio at a station.
    `triangle` (s, s) is R, and `weights` (s, n) are Q' P; both are None where every trial is a
    station, and whitened.
    """

    problem: Likelihood
    at: Likelihood
    levels: FloatArray
    triangle: FloatArray | None = None
    weights: FloatArray | None = None

    @classmethod
    def from_problem(cls, problem: Likelihood, theta: FloatArray, sd: FloatArray) -> Stations:
        """The stations of a problem: nodes, if exact within `REACH` `sd` (p,) of `theta` (p,)."""
        data, gain = problem.data, -problem.d_shown_levels_d_lift
        needs = [
            np.asarray(value, dtype=float)
            for name, value in problem.known.items()
            if name not in data.geometry
        ]
        _, first, index = np.unique(
            np.stack([data.z_hat, *needs]), axis=1, return_index=True, return_inverse=True
        )
        if not needs and len(first) > NODES and (nodes := _nodes(problem, theta, sd)):
            at, spread = nodes
        elif len(first) <= MOST and len(first) < data.n:
            at = replace(problem, data=data.take(first), shift=0.0)
            spread = np.eye(len(first))[index.ravel()]
        else:
            return cls(problem=problem, at=replace(problem, shift=0.0), levels=gain)
        q, r = np.linalg.qr(problem.project(spread.T).T)
        weights = problem.unproject(q.T)
        return cls(problem=problem, at=at, levels=gain @ spread, triangle=r, weights=weights)

    def target(self, log_lift: FloatArray) -> FloatArray:
        """Whitened part of log lift (..., n) that parameters may explain."""
        rest = log_lift - self.problem.shift
        return self.problem.project(rest) if self.weights is None else rest @ self.weights.T

    def white(self, x: FloatArray) -> FloatArray:
        """Whitened values (..., s) of stations, as in `target`."""
        triangle = self.triangle
        if triangle is None:
            return self.problem.project(x)
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
        problem = self.problem
        mean = problem.d_shown_levels_d_lift @ (np.log(problem.data.lift_N) - problem.shift)
        levels = np.zeros((len(theta), len(mean)))
        for some in self.batches(len(theta)):
            log_ratio = self.at.log_ratio(theta[some])
            levels[some] = mean + where_finite(lambda x: x @ self.levels.T, log_ratio)
        return levels

    def batches(self, m: int) -> Iterator[slice]:
        """Slices of m rows that stay in a processor's cache."""
        size = max(BATCH // self.at.data.n, 1)
        return (slice(i, i + size) for i in range(0, m, size))


def _nodes(
    problem: Likelihood, theta: FloatArray, sd: FloatArray
) -> tuple[Likelihood, FloatArray] | None:
    """The problem at nodes, and the matrix (n, s) from its log ratios to those of the trials; None
    where they are not exact.

    The nearest and farthest distances are nodes, and so is free air: the nodes have a value where
    all trials have one.
    """
    from numpy.polynomial import chebyshev

    data = problem.data
    near = np.isfinite(data.z_hat)
    log = np.log(data.z_hat[near])
    middle, half = (log.max() + log.min()) / 2, np.ptp(log) / 2
    points = chebyshev.chebpts2(NODES)
    z_hat = np.r_[np.exp(middle + half * points), data.z_hat[~near][:1]]
    spread = np.zeros((data.n, len(z_hat)))
    spread[~near, NODES:] = 1.0
    degree = NODES - 1
    spread[near, :NODES] = np.linalg.solve(
        chebyshev.chebvander(points, degree).T,
        chebyshev.chebvander((log - middle) / half, degree).T,
    ).T
    one_each = replace(data.take(np.zeros(len(z_hat), dtype=int)), z_hat=z_hat)
    at = replace(problem, data=one_each, shift=0.0)
    low, high = (np.clip(theta + side * REACH * sd, *problem.model.bounds) for side in (-1, 1))
    corners = np.array(list(product(*zip(low, theta, high, strict=True))))
    values = where_finite(lambda x: x @ spread.T, at.log_ratio(corners))
    error = values - replace(problem, shift=0.0).log_ratio(corners)
    return (at, spread) if np.abs(error).max() <= EXACT else None
