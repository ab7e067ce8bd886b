"""A fit's likelihood with every height error carried by its covariance."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood import budget
from nearlift.likelihood.problem import Problem

if TYPE_CHECKING:
    from nearlift.fit.least_squares import LeastSquaresFit


def linear_problem(fit: LeastSquaresFit) -> tuple[Problem, float, FloatArray]:
    """The fit's likelihood with every height error in its covariance, the height error in m about
    which it is linearised, and the slope there, (n,).

    The fit's own unless a shared height error was integrated over.
    """
    if fit.marginal is None:
        return fit.problem, 0.0, fit.slope
    offset = fit.marginal.offset()[0]
    slope = fit.problem.height_slope(fit.theta, offset)
    whole = fit.problem.covariance
    more = budget.shared(fit.problem.data, fit.plan.shared, slope)
    return (
        replace(fit.problem, covariance=replace(whole, shared=np.hstack([whole.shared, more]))),
        offset,
        slope,
    )


def carried(fit: LeastSquaresFit) -> list[tuple[budget.Component, FloatArray]]:
    """Every declared error with the slope that carries heights there, in the order of their columns
    in `linear_problem`.
    """
    slope = linear_problem(fit)[2]
    return [
        *((part, fit.slope) for part in fit.parts),
        *((part, slope) for part in fit.plan.shared),
    ]


def stand_in(fit: LeastSquaresFit) -> Problem:
    """The fit's likelihood in its coefficients alone, linear in any integrated height error."""
    return about(*linear_problem(fit))


def about(problem: Problem, offset_m: float, slope: FloatArray) -> Problem:
    """The problem with heights shifted by `offset_m`, less the first-order effect
    ``slope * offset_m`` of the shift on the log ratio.
    """
    if not offset_m:
        return problem
    data = replace(problem.data, z_hat=problem.data.z_hat + offset_m / problem.data.radius_m)
    return replace(problem, data=data, shift=problem.shift - slope * offset_m)
