"""Uncertainty of a fit's coefficients if one source of error were known exactly."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit.gum import NAMES, RECORD_NOISE, inverse_information
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.likelihood.budget import GROUPED, Component, groups, independent_variance
from nearlift.likelihood.covariance import LEAST_VARIANCE, Covariance
from nearlift.likelihood.problem import Problem
from nearlift.results import Noise


def u_without(fit: LeastSquaresFit) -> dict[str, FloatArray]:
    """`without_each` of a fit."""
    jacobian, u = fit.problem.jacobian(fit.theta), np.sqrt(np.diag(fit.covariance))
    return without_each(fit.problem, jacobian, fit.noise, fit.parts, fit.slope, u)


def without_each(
    problem: Problem,
    jacobian: FloatArray,
    scatter: Noise,
    parts: Sequence[Component],
    slope: FloatArray,
    u: FloatArray,
    further: Mapping[str, slice] | None = None,
) -> dict[str, FloatArray]:
    """Standard uncertainty of each coefficient, (p,), if one source of error were known exactly, by
    the source's name in the budget.

    The source is removed from the covariance, and the trials are weighted again. Sources are
    correlated through the fit, so the result is not the variance less the source's contribution. A
    zero error that adds little may limit the gain by knowing another source.

    Parameters
    ----------
    jacobian : (n, p)
        Of its log ratio.
    parts : sequence of Component
        Declared errors in the order of their columns in the covariance.
    slope : (n,)
        d log ratio / dz, which carries heights.
    u : (p,)
        Standard uncertainties of the full fit, to which the results are scaled.
    further : mapping of str to slice
        Further sources, as columns of the covariance's shared unknowns.
    """

    def spread(covariance: Covariance) -> FloatArray:
        white = replace(problem, covariance=covariance).project(jacobian.T)
        return np.asarray(
            np.sqrt(np.maximum(np.diag(inverse_information(white)), 0.0)), dtype=np.float64
        )

    whole = spread(problem.covariance)
    scale = u / np.where(whole > 0, whole, 1.0)
    return {
        name: scale * spread(covariance)
        for name, covariance in _covariances_without_each_source(
            problem, scatter, parts, slope, further or {}
        )
    }


def _covariances_without_each_source(
    problem: Problem,
    scatter: Noise,
    parts: Sequence[Component],
    slope: FloatArray,
    further: Mapping[str, slice],
) -> Iterator[tuple[str, Covariance]]:
    """The covariance without each source in turn."""
    data, whole = problem.data, problem.covariance
    trial_by_trial = {
        RECORD_NOISE: (data.u_lift_N / data.lift_N) ** 2,
        NAMES["relative"]: np.full(data.n, scatter.relative**2),
        NAMES["force_N"]: (scatter.force_N / data.lift_N) ** 2,
    }
    trial_by_trial |= {
        part.name: independent_variance(data, part, slope)
        for part in parts
        if part.scope not in GROUPED
    }
    for name, variance in trial_by_trial.items():
        yield name, replace(whole, variance=np.maximum(whole.variance - variance, LEAST_VARIANCE))
    yield NAMES["height_m"], replace(whole, per_visit=np.zeros(data.n))
    yield NAMES["common"], replace(whole, common=0.0)
    yield NAMES["drift"], replace(whole, drift=np.zeros(len(scatter.drift)))
    first = 0
    for part in parts:
        width = int(groups(data, part.scope).max()) + 1 if part.scope in GROUPED else 0
        if width:
            yield (
                part.name,
                replace(
                    whole, shared=np.delete(whole.shared, np.s_[first : first + width], axis=1)
                ),
            )
        first += width
    for name, columns in further.items():
        yield name, replace(whole, shared=np.delete(whole.shared, columns, axis=1))
