"""Generalised least squares of one lift model to trials."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from nearlift.declare import FloatArray, LiftModel
from nearlift.errors import NotConverged
from nearlift.fit import height_error, information, inputs
from nearlift.fit.information import joint_information
from nearlift.fit.solver import solve
from nearlift.likelihood import budget, noise, student
from nearlift.likelihood.problem import Likelihood, height_slope, usable
from nearlift.results import Estimate, Noise, Observations
from nearlift.results.fit import ExcludedTrial

#: Standard uncertainty over a parameter's range from which it is rounding, and the parameter
#: undetermined. Ours: far above any prior's.
MAX_U_OF_RANGE = 1e6
#: Maximum number of times that noise and slope are taken again. Ours: two settle them to second
#: order.
NOISE_ROUNDS = 3
#: Maximum number of times that the height error is taken again, and its last change, in stated
#: standard uncertainties. Ours: the rest is far below a printed digit.
HEIGHT_ROUNDS, SAME_HEIGHT = 30, 1e-3
#: Distance from a bound, as a fraction of the range, at which a parameter is at it.
#: Ours: above lmfit's inset of 1e-9, below any uncertainty.
AT_BOUND = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class LeastSquaresFit:
    """A model fitted to the trials of one boundary.

    `theta`, `covariance`, `gain` (p, n) and `names` belong together; `gain` is the change of each
    coefficient per unit change of each trial's log lift. `levels` holds L_inf in N per throttle;
    `level_coefficients` multiply the trials' `level_design`. `chi2` uses the scatter of repeats,
    so chi2 well above `dof` shows a fault of the model, not of the noise. The covariance of the
    likelihood `problem` was assembled from `slope` and `parts`, and is linearised about the height
    error ``problem.offset_m``. `effective` (p,) are each coefficient's effective degrees of
    freedom, at least 1, used by its interval and its profile. `lmfit` is lmfit's result where the
    fit is quoted, for its reports.
    """

    problem: Likelihood
    theta: FloatArray
    covariance: FloatArray
    gain: FloatArray
    estimates: dict[str, Estimate]
    levels: dict[float, Estimate]
    level_coefficients: FloatArray
    level_covariance: FloatArray
    chi2: float
    dof: int
    log_likelihood: float
    excluded: tuple[ExcludedTrial, ...]
    noise: Noise
    slope: FloatArray
    parts: tuple[budget.Component, ...]
    effective: FloatArray
    lmfit: Any = None

    @property
    def model(self) -> LiftModel:
        """The model fitted."""
        return self.problem.model

    @property
    def names(self) -> tuple[str, ...]:
        """The free parameters, in the order of `theta`."""
        return self.problem.names


def assemble(
    model: LiftModel,
    data: Observations,
    parts: tuple[budget.Component, ...],
    scatter: Noise,
    theta: FloatArray,
    slope: FloatArray | None = None,
    offset_m: float = 0.0,
) -> Likelihood:
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
    return Likelihood(
        model=model, data=data, covariance=covariance, offset_m=offset_m, shift=-offset_m * slope
    )


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
        Stated uncertainties; see `likelihood.budget`.
    scatter : Noise or None
        Variance components of trials; estimated from the repeats if None.
    slope : (n,) or None
        d log ratio / dz that carries height errors. Give every rival model the base model's: with
        its own, a flat curve would claim less noise, and likelihoods would not be comparable.
    offset_m : float or None
        Height error about which the model is linearised; the most probable one if None
        (`fit.height_error`). Give every rival the base model's.
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
    slope = None if slope is None else slope[keep]
    p, levels = len(model.parameters), data.unknown_levels
    if data.n < p + levels + 2:
        raise NotConverged(
            f"fit of {model.name}",
            f"{data.n} usable trials for {p + levels} unknowns",
            f"at least {p + levels + 2} trials are needed",
        )
    standard = height_error.standard_m(height_error.common(parts, data)) * (offset_m is None)
    theta, about = np.array([q.value for q in model.parameters]), offset_m or 0.0
    settled, declared = scatter or Noise(relative=0.01), parts
    for _ in range(NOISE_ROUNDS):
        parts = inputs.acting(declared, model, theta)
        if scatter is None:
            settled = _scatter(model, data, parts, settled, theta, about)
        before = theta
        problem, theta, carried = _optimum(
            model, data, parts, settled, theta, slope, about, standard
        )
        about = problem.offset_m
        if p == 0 or np.allclose(before, theta, rtol=1e-3, atol=1e-6):
            break
    theta, result = solve(problem, theta, quoted=quoted)
    return _described(problem, theta, settled, excluded, carried, parts, result)


def _scatter(
    model: LiftModel,
    data: Observations,
    parts: tuple[budget.Component, ...],
    start: Noise,
    theta: FloatArray,
    offset_m: float,
) -> Noise:
    """Variance components of the trials about the model at `theta`."""
    trial = assemble(model, data, (), start, theta, np.zeros(data.n), offset_m)
    slope = trial.height_slope(theta)
    lacking, source = noise.saturated_mean_columns(data)
    return noise.estimate(
        data,
        np.log(data.lift_N) - trial.log_ratio(theta),
        np.hstack([data.level_design, trial.jacobian(theta)]),
        lacking,
        slope,
        budget.shared(data, parts, slope),
        budget.own_variance(data, parts, slope),
        start if start.sizes else None,
        source,
    )[0]


def _optimum(
    model: LiftModel,
    data: Observations,
    parts: tuple[budget.Component, ...],
    scatter: Noise,
    theta: FloatArray,
    slope: FloatArray | None,
    offset_m: float,
    standard: float,
) -> tuple[Likelihood, FloatArray, FloatArray]:
    """Likelihood, its optimum and the slope of height errors, about the most probable height error
    where one of `standard` uncertainty is stated.
    """
    for _ in range(HEIGHT_ROUNDS):
        of_model = height_slope(model, data, model.named(theta), offset_m)
        carried = of_model if slope is None else slope
        problem = assemble(model, data, parts, scatter, theta, carried, offset_m)
        theta = solve(problem, theta)[0]
        if not standard:
            break
        likely = height_error.most_probable_m(problem, theta, carried, standard)
        if abs(likely - offset_m) < SAME_HEIGHT * standard:
            break
        offset_m = likely
    return problem, theta, carried


def _described(
    problem: Likelihood,
    theta: FloatArray,
    scatter: Noise,
    excluded: tuple[ExcludedTrial, ...],
    slope: FloatArray,
    parts: tuple[budget.Component, ...],
    lmfit: Any,
) -> LeastSquaresFit:
    """Estimates with their intervals by Student's t, and L_inf."""
    data, joint = problem.data, joint_information(problem, problem.jacobian(theta))
    level_coefficients = problem.best_levels(np.log(data.lift_N) - problem.log_ratio(theta))
    level_covariance = joint.covariance[joint.levels, joint.levels]
    effective, level_dof = (
        information.effective_dof(information.lines(problem, g, parts, scatter, slope), scatter)
        for g in (joint.gain, data.shown(joint.level_gain))
    )
    low, high = problem.model.bounds
    width, nearest = high - low, np.minimum(theta - low, high - theta)
    u = np.where(joint.u < MAX_U_OF_RANGE * width, joint.u, np.inf)
    at_bound = np.isfinite(width) & (nearest < AT_BOUND * width)
    levels_N = np.exp(data.shown(level_coefficients))
    u_levels = levels_N * np.sqrt(np.diag(problem.shown_covariance(level_covariance)))
    return LeastSquaresFit(
        problem=problem,
        theta=theta,
        covariance=joint.parameter_covariance,
        gain=joint.gain,
        estimates={
            q.name: Estimate.around(
                theta[i],
                u[i],
                student.quantile(0.95, effective[i]),
                q.unit,
                at_bound=bool(at_bound[i]),
            )
            for i, q in enumerate(problem.model.parameters)
        },
        levels={
            t: Estimate.around(
                levels_N[i], u_levels[i], student.quantile(0.95, level_dof[i]), "N", at_bound=False
            )
            for i, t in enumerate(data.levels.tolist())
        },
        level_coefficients=level_coefficients,
        level_covariance=level_covariance,
        chi2=float(problem.chi2(theta)),
        dof=data.n - data.unknown_levels - len(theta),
        log_likelihood=float(problem.log_likelihood(theta)),
        excluded=excluded,
        noise=scatter,
        slope=slope,
        parts=parts,
        effective=effective,
        lmfit=lmfit,
    )
