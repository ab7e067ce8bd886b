"""Penalised least squares of a candidate: weak priors, bounds, and starts over shape parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import Effect, FloatArray
from nearlift.fit import solver
from nearlift.likelihood.problem import Likelihood
from nearlift.loop.candidate import Candidate
from nearlift.loop.starts import Starts

#: Effects with their flat vector, fitted or assumed: the base model's entries, then their own.
Point = tuple[tuple[Effect, ...], FloatArray]
#: Maximum number of bisections of a start beyond a pole towards the null.
HALVINGS = 8
#: Gain in the objective by a step below which a candidate's fit ends: evidences differ by units.
ENOUGH = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """A candidate at its penalised least-squares optimum: `residual` is whitened with L_inf
    projected out (by `space`), `penalty` the prior's part of the objective.
    """

    candidate: Candidate
    space: Likelihood
    vector: FloatArray
    residual: FloatArray
    penalty: float

    @property
    def jacobian(self) -> FloatArray:
        """Minus d residual / d vector, (n, P); not stored, since a search keeps every candidate."""
        return self.space.project(self.candidate.jacobian(self.vector).T).T

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the vector, (P, P), the effects' forms exact."""
        j, (_, sd) = self.jacobian, self.candidate.prior
        return inverse(j.T @ j + np.diag(1 / sd**2))

    @property
    def at_bound(self) -> bool:
        """Whether an effect's size is at a bound that is not its null."""
        low, high = self.candidate.bounds
        sizes = self.candidate.sizes()
        value, null = self.vector[sizes], self.candidate.null[sizes]
        return bool(np.any(((value <= low[sizes]) | (value >= high[sizes])) & (value != null)))

    @property
    def datum_chi2(self) -> float:
        """Squared zero error of the distance over its stated uncertainty."""
        candidate = self.candidate
        mean, sd = candidate.prior
        return float(np.sum((((self.vector - mean) / sd)[candidate.at_datum]) ** 2))

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals, and that of the zero error of the distance."""
        return float(np.sum(self.residual**2)) + self.datum_chi2

    @property
    def point(self) -> Point:
        """Its effects and its vector."""
        return self.candidate.effects, self.vector

    @property
    def cost(self) -> float:
        """Objective that the fit minimises."""
        return float(np.sum(self.residual**2)) + self.penalty


def inverse(information: FloatArray) -> FloatArray:
    """Covariance of parameters from their information; 0 along undetermined directions."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    unit = np.outer(scale, scale)
    return np.asarray(np.linalg.pinv(information / unit, rcond=1e-13) / unit)


def fit(candidate: Candidate, space: Likelihood, log_lift: FloatArray, start: FloatArray) -> Fitted:
    """Penalised least squares from `start` (P,); `space` whitens and projects out L_inf."""
    return _fits(candidate, space, log_lift, start[None])[0]


def _fits(
    candidate: Candidate, space: Likelihood, log_lift: FloatArray, starts: FloatArray
) -> list[Fitted]:
    """Penalised least squares of log lift (n,) from each of `starts` (m, P), all at once."""
    bounds, (mean, sd) = candidate.bounds, candidate.prior

    def residuals(vectors: FloatArray) -> FloatArray:
        return space.project(log_lift - candidate.log_ratio(vectors))

    def derivatives(vectors: FloatArray) -> FloatArray:
        return -space.project(candidate.jacobian(vectors).swapaxes(1, 2))

    best = np.clip(starts, *bounds)
    if candidate.size:
        system = solver.System(lambda v, _: residuals(v), lambda v, _: derivatives(v))
        best = solver.minimise(system.penalised(mean, sd), best, bounds, enough=ENOUGH).theta
    return [
        Fitted(
            candidate=candidate,
            space=space,
            vector=vector,
            residual=r,
            penalty=float(np.sum(((vector - mean) / sd) ** 2)),
        )
        for vector, r in zip(best, residuals(best), strict=True)
    ]


def search(candidate: Candidate, starts: Starts, log_lift: FloatArray) -> Fitted:
    """Best fit over the shapes' starting values."""
    return optima(candidate, starts, log_lift)[0]


def optima(candidate: Candidate, starts: Starts, log_lift: FloatArray) -> list[Fitted]:
    """Fits from the two best `starts`, the best first.

    A start beyond a pole of the model, where some trial has no predicted value, is bisected towards
    the null. If that does not help, the result's chi2 is nan.
    """
    vectors = [
        _short_of_pole(candidate, start.vector, start.null)
        for start in starts.ranked(candidate, log_lift)[:2]
    ]
    fits = _fits(candidate, starts.space, log_lift, np.array(vectors))
    return sorted(fits, key=lambda f: np.nan_to_num(f.cost, nan=np.inf))


def _short_of_pole(candidate: Candidate, start: FloatArray, null: FloatArray) -> FloatArray:
    """The start, or the first of the midpoints towards `null` at which every trial has a value."""
    for _ in range(HALVINGS):
        if np.isfinite(candidate.log_ratio(np.clip(start, *candidate.bounds))).all():
            break
        start = (start + null) / 2
    return start
