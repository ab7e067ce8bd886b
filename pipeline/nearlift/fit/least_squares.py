"""Generalised least squares of one lift model to trials."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nearlift.declare import FloatArray, LiftModel
from nearlift.errors import NotConverged
from nearlift.fit import height_error, information, inputs
from nearlift.fit.information import LEAST_DOF, parameter_covariance
from nearlift.fit.solver import solve
from nearlift.likelihood import budget, noise, student
from nearlift.likelihood.problem import Problem, height_slope, usable
from nearlift.results import Estimate, Noise, Observations
from nearlift.results.fit import ExcludedTrial

#: Standard uncertainty over a parameter's range from which it is rounding, and the parameter
#: undetermined.
VAGUE = 1e6
#: Maximum number of times that the height error is taken again, and its last change, in stated
#: standard uncertainties.
HEIGHT_ROUNDS, SAME_HEIGHT = 30, 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class LeastSquaresFit:
    """A model fitted to the trials of one boundary.

    `theta`, `covariance` and `names` belong together. `levels` holds L_inf in N per throttle;
    `level_coefficients` multiply the trials' `level_columns`. `chi2` uses the scatter of repeats,
    so chi2 well above `dof` shows a fault of the model, not of the noise. The covariance of the
    likelihood `problem` was assembled from `slope` and `parts`, and is linearised about the height
    error ``problem.offset_m``. `effective` (p,) are each coefficient's effective degrees of
    freedom,
    used by its interval and its profile. `lmfit` is lmfit's result where the fit is quoted, for its
    reports.
    """

    model: LiftModel
    theta: FloatArray
    covariance: FloatArray
    estimates: dict[str, Estimate]
    levels: dict[float, Estimate]
    level_coefficients: FloatArray
    level_covariance: FloatArray
    chi2: float
    dof: int
    log_likelihood: float
    excluded: tuple[ExcludedTrial, ...]
    noise: Noise
    problem: Problem
    slope: FloatArray
    parts: tuple[budget.Component, ...]
    effective: FloatArray
    lmfit: Any = None

    @property
    def names(self) -> tuple[str, ...]:
        """The free parameters, in the order of `theta`."""
        return tuple(p.name for p in self.model.parameters)

    @property
    def dof_of_all(self) -> float:
        """Fewest effective degrees of freedom of any coefficient, at least `LEAST_DOF`."""
        return max(float(self.effective.min(initial=np.inf)), LEAST_DOF)


def assemble(
    model: LiftModel,
    data: Observations,
    parts: tuple[budget.Component, ...],
    scatter: Noise,
    theta: FloatArray,
    slope: FloatArray | None = None,
    offset_m: float = 0.0,
) -> Problem:
    """The likelihood, height errors carried by `slope` (n,), or else by the model's at `theta`, to
    first order about `offset_m`.
    """
    if slope is None:
        slope = height_slope(model, data, model.named(theta), offset_m)
    covariance = noise.trial_covariance(
        data,
        scatter,
        slope,
        budget.shared(data, parts, slope),
        budget.own_variance(data, parts, slope),
    )
    shift = -offset_m * slope if offset_m else 0.0
    return Problem(model=model, data=data, covariance=covariance, offset_m=offset_m, shift=shift)


def fit(
    model: LiftModel,
    data: Observations,
    parts: tuple[budget.Component, ...] = (),
    scatter: Noise | None = None,
    slope: FloatArray | None = None,
    offset_m: float | None = None,
    *,
    quoted: bool = False,
) -> LeastSquaresFit:
    """Fit `model` to the trials in its range of validity.

    Parameters
    ----------
    data : Observations
        Accepted trials of one boundary, free-air trials included.
    parts : tuple of Component
        Declared errors; see `likelihood.budget`.
    scatter : Noise or None
        Variance components of trials; estimated from the repeats if None.
    slope : (n,) or None
        d log ratio / dz that carries height errors. Give every rival model the base model's: with
        its own, a flat curve would claim less noise, and likelihoods would not be comparable.
    offset_m : float or None
        Height error about which the model is linearised. If None, it is the most probable one where
        the slope does not suffice (`fit.height_error`). Give every rival the base model's.
    quoted : bool
        Whether lmfit makes the last search, for its report in `lmfit`.

    Raises
    ------
    NotConverged
        Too few trials, or the optimiser failed.
    """
    keep = usable(model, data)
    low, high = model.valid_z_hat
    excluded = tuple(
        ExcludedTrial(
            trial=str(t),
            reason=f"z_hat = {z:.4g} is outside {low:g} < z_hat <= {high:g} where"
            f" {model.name} holds",
        )
        for t, z in zip(data.trial[~keep], data.z_hat[~keep], strict=True)
    )
    data = data.take(keep)
    p, levels = len(model.parameters), data.unknown_levels
    if data.n < p + levels + 2:
        raise NotConverged(
            f"fit of {model.name}",
            f"{data.n} usable trials for {p + levels} unknowns",
            f"at least {p + levels + 2} trials are needed",
        )
    theta = np.array([q.value for q in model.parameters])
    settled, about = scatter or Noise(relative=0.01), offset_m or 0.0
    declared_parts = parts
    # the slope that carries height errors depends on theta: two rounds settle it to second order
    for _ in range(3):
        parts = inputs.acting(declared_parts, model, theta)
        if scatter is None:
            trial = Problem(
                model=model,
                data=data,
                covariance=noise.trial_covariance(data, settled, np.zeros(data.n)),
                offset_m=about,
            )
            declared = trial.height_slope(theta)
            lacking, source = noise.saturated_mean_columns(data)
            settled, _ = noise.estimate(
                data,
                np.log(data.lift_N) - trial.log_ratio(theta),
                np.hstack([data.level_columns, trial.jacobian(theta)]),
                lacking,
                declared,
                budget.shared(data, parts, declared),
                budget.own_variance(data, parts, declared),
                settled if settled.sizes else None,
                source,
            )
        problem = assemble(
            model, data, parts, settled, theta, None if slope is None else slope[keep], about
        )
        before, theta = theta, solve(problem, theta)[0]
        if p == 0 or np.allclose(before, theta, rtol=1e-3, atol=1e-6):
            break
    carried = slope[keep] if slope is not None else problem.height_slope(before)
    if offset_m is None:
        problem, theta, carried = _about_height_error(problem, theta, parts, settled, carried)
    theta, result = solve(problem, theta, quoted=quoted)
    described = _describe(problem, theta, settled, excluded, carried, parts)
    return replace(described, lmfit=result)


def _about_height_error(
    problem: Problem,
    theta: FloatArray,
    parts: tuple[budget.Component, ...],
    scatter: Noise,
    slope: FloatArray,
) -> tuple[Problem, FloatArray, FloatArray]:
    """The problem, its optimum and the slope about the most probable height error, where the slope
    at the recorded distances does not suffice.
    """
    standard = height_error.standard_m(height_error.common(parts, problem.data))
    if not height_error.bends(problem, theta, standard):
        return problem, theta, slope
    for _ in range(HEIGHT_ROUNDS):
        likely = height_error.most_probable_m(problem, theta, slope, standard)
        if abs(likely - problem.offset_m) < SAME_HEIGHT * standard:
            break
        model, data = problem.model, problem.data
        slope = height_slope(model, data, model.named(theta), likely)
        problem = assemble(model, data, parts, scatter, theta, slope, likely)
        theta = solve(problem, theta)[0]
    return problem, theta, slope


def _levels(
    problem: Problem, log_levels: FloatArray, covariance: FloatArray, quantiles: Sequence[float]
) -> dict[float, Estimate]:
    """L_inf, N, per throttle, with intervals of ±`quantiles` standard uncertainties."""
    values = np.exp(problem.data.shown(log_levels))
    relative = np.sqrt(np.diag(problem.shown_covariance(covariance)))
    return {
        float(t): _estimate(v, v * w, q, "N", (0.0, np.inf))
        for t, v, w, q in zip(problem.data.levels, values, relative, quantiles, strict=True)
    }


def _describe(
    problem: Problem,
    theta: FloatArray,
    scatter: Noise,
    excluded: tuple[ExcludedTrial, ...],
    slope: FloatArray,
    parts: tuple[budget.Component, ...],
) -> LeastSquaresFit:
    data, model = problem.data, problem.model
    jacobian = problem.jacobian(theta)
    covariance, determined = parameter_covariance(
        problem.project(jacobian.T), np.linalg.norm(problem.covariance.whiten(jacobian.T), axis=1)
    )
    g = information.gain(problem, theta)
    effective = information.freedom(problem, g, parts, scatter, slope)
    width = np.array([q.bounds[1] - q.bounds[0] for q in model.parameters])
    determined &= np.sqrt(np.diag(covariance)) < VAGUE * width
    sd = np.where(determined, np.sqrt(np.diag(covariance)), np.inf)
    coefficients = problem.best_levels(np.log(data.lift_N) - problem.log_ratio(theta))
    toll = problem.d_levels_d_theta(jacobian)
    level_covariance = problem.level_covariance + toll @ covariance @ toll.T
    levels_gain = problem.d_shown_levels_d_lift + problem.d_shown_levels_d_theta(jacobian) @ g
    level_dof = information.freedom(problem, levels_gain, parts, scatter, slope)
    quantiles = [student.quantile(0.95, dof) for dof in level_dof]
    return LeastSquaresFit(
        model=model,
        theta=theta,
        covariance=covariance,
        estimates=interval90(model, theta, sd, effective),
        levels=_levels(problem, coefficients, level_covariance, quantiles),
        level_coefficients=coefficients,
        level_covariance=level_covariance,
        chi2=float(problem.chi2(theta)),
        dof=data.n - data.unknown_levels - len(theta),
        log_likelihood=float(problem.log_likelihood(theta)),
        excluded=excluded,
        noise=scatter,
        problem=problem,
        slope=slope,
        parts=parts,
        effective=effective,
    )


def interval90(
    model: LiftModel, theta: FloatArray, sd: FloatArray, dof: FloatArray
) -> dict[str, Estimate]:
    """Each parameter with its standard uncertainty and 90 % interval by Student's t."""
    each = zip(model.parameters, theta, sd, dof, strict=True)
    return {
        q.name: _estimate(t, u, student.quantile(0.95, d), q.unit, q.bounds) for q, t, u, d in each
    }


def _estimate(
    value: float, u: float, quantile: float, unit: str, bounds: tuple[float, float]
) -> Estimate:
    width = bounds[1] - bounds[0]
    at_bound = bool(np.isfinite(width) and min(value - bounds[0], bounds[1] - value) < 1e-6 * width)
    reach = quantile * u if u > 0 else 0.0
    return Estimate(
        value=float(value),
        u=float(u),
        lo90=float(value - reach),
        hi90=float(value + reach),
        unit=unit,
        at_bound=at_bound,
    )
