"""Penalised least squares of a candidate: weak priors, bounds, and starts over shape parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import Effect, FloatArray
from nearlift.likelihood.problem import Problem
from nearlift.loop.candidate import Candidate
from nearlift.loop.starts import Starts

#: Effects with their flat vector, fitted or assumed: the base model's entries, then their own.
Point = tuple[tuple[Effect, ...], FloatArray]
#: Most bisections of a start beyond a pole towards the null.
HALVINGS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Fitted:
    """A candidate at its penalised least-squares optimum: `residual` is whitened with L_inf
    projected out (by `space`), `penalty` the prior's part of the objective.
    """

    candidate: Candidate
    space: Problem
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


def fit(candidate: Candidate, space: Problem, log_lift: FloatArray, start: FloatArray) -> Fitted:
    """Penalised least squares from `start`, by Levenberg-Marquardt steps within the bounds.

    Parameters
    ----------
    candidate : Candidate
    space : Problem
        Whitens and projects out L_inf.
    log_lift : (n,)
    start : (P,)
    """
    low, high = candidate.bounds
    mean, sd = candidate.prior
    weight = 1 / sd

    def residual(vector: FloatArray) -> FloatArray:
        return space.project(log_lift - candidate.log_ratio(vector))

    def cost(r: FloatArray, vector: FloatArray) -> float:
        total = float(np.sum(r**2) + np.sum(((vector - mean) * weight) ** 2))
        return total if np.isfinite(total) else np.inf

    vector = np.clip(start, low, high)
    r = residual(vector)
    best = cost(r, vector)
    damping = 1e-6
    for _ in range(25 if np.isfinite(best) else 0):
        columns = candidate.jacobian(vector)
        j = space.project(columns.T).T
        length = np.sqrt(np.sum(j**2, axis=0) + weight**2)
        length = np.where(length > 0, length, 1.0)
        normal = (j.T @ j + np.diag(weight**2)) / np.outer(length, length)
        gradient = (j.T @ r - weight**2 * (vector - mean)) / length
        gained = 0.0
        for _ in range(8):
            damped = normal + damping * np.eye(len(vector))
            step = _step(damped, gradient, length, vector, low, high)
            trial = np.clip(vector + step, low, high)
            r_trial = residual(trial)
            value = cost(r_trial, trial)
            if value < best:
                gained = best - value
                vector, r, best, damping = trial, r_trial, value, max(damping / 10, 1e-9)
                break
            damping = max(damping * 20, 1e-6)
        if gained < 1e-3:
            break
    return Fitted(
        candidate=candidate,
        space=space,
        vector=vector,
        residual=r,
        penalty=best - float(np.sum(r**2)),
    )


def _step(
    normal: FloatArray,
    gradient: FloatArray,
    length: FloatArray,
    vector: FloatArray,
    low: FloatArray,
    high: FloatArray,
) -> FloatArray:
    """Gauss-Newton step with an active set: entries at a bound it would cross are held."""
    free = np.ones(len(vector), dtype=bool)
    step = np.zeros(len(vector))
    for _ in range(len(vector)):
        step[:] = 0.0
        scaled = np.linalg.lstsq(normal[np.ix_(free, free)], gradient[free], rcond=1e-12)[0]
        step[free] = scaled / length[free]
        stuck = free & (((vector <= low) & (step < 0)) | ((vector >= high) & (step > 0)))
        if not stuck.any():
            break
        free &= ~stuck
    return step


def search(candidate: Candidate, starts: Starts, log_lift: FloatArray) -> Fitted:
    """Best fit over the shapes' starting values."""
    return optima(candidate, starts, log_lift)[0]


def optima(candidate: Candidate, starts: Starts, log_lift: FloatArray) -> list[Fitted]:
    """Fits from the two best `starts`, the best first.

    A start beyond a pole of the model, where some trial has no predicted value, is bisected towards
    the null. If that does not help, the result's chi2 is nan.
    """
    fits = [
        fit(candidate, starts.space, log_lift, _short_of_pole(candidate, start.vector, start.null))
        for start in starts.ranked(candidate, log_lift)[:2]
    ]
    return sorted(fits, key=lambda f: np.nan_to_num(f.cost, nan=np.inf))


def _short_of_pole(candidate: Candidate, start: FloatArray, null: FloatArray) -> FloatArray:
    """The start, or the first of the midpoints towards `null` at which every trial has a value."""
    for _ in range(HALVINGS):
        if np.isfinite(candidate.log_ratio(np.clip(start, *candidate.bounds))).all():
            break
        start = (start + null) / 2
    return start
