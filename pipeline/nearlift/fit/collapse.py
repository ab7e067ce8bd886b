"""Throttle collapse: whether Delta L is the same at all throttles, tested and bounded.

An F test of one scale of the log ratio per throttle, with the full covariance of the trials. The
coefficients and one L_inf per throttle are free, to first order about the fit. The difference of
every pair of throttles has a simultaneous 95 % bound (Bonferroni).
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import information
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.likelihood import student
from nearlift.results import Estimate
from nearlift.results.fit import CollapseTest, LargestDeparture, ThrottleCollapse
from nearlift.rounding import chance

#: Confidence level of the largest departure, and of the test (convention).
CONFIDENCE = 0.95


def examine(fit: LeastSquaresFit) -> ThrottleCollapse:
    """Test of the collapse at the optimum of a model common to all throttles.

    Errors common to a visit cancel from contrasts between its throttles, whose degrees of freedom
    therefore differ from the coefficient's.
    """
    problem, theta = fit.problem, fit.theta
    data, k = problem.data, len(problem.data.levels)
    contrast = np.linalg.qr(np.column_stack([np.ones(k), np.eye(k)[:, 1:]]))[0][:, 1:]
    each = ((np.eye(k)[data.level] * problem.log_ratio(theta)[:, None]) @ contrast).T
    jacobian = problem.jacobian(theta)
    joint = information.joint_information(problem, np.hstack([jacobian, each.T]))
    p = jacobian.shape[1]
    if k < 2 or not joint.determined[p:].all():
        text = "These trials cannot test whether Delta L depends on throttle."
        return ThrottleCollapse(per_throttle={}, test=None, largest_departure=None, text=text)
    covariance, gain = joint.parameter_covariance[p:, p:], joint.gain[p:]
    scale = gain @ (np.log(data.lift_N) - problem.log_ratio(theta))
    # independent combinations of unit variance
    basis = np.linalg.cholesky(np.linalg.inv(covariance)).T
    lines = information.lines(problem, basis @ gain, fit.parts, fit.noise, fit.slope)
    dof = student.several(information.effective_dof(lines, fit.noise))
    values, spread = contrast @ scale, contrast @ covariance @ contrast.T
    reach90 = student.quantile(0.95, dof)
    test = f_test(float(np.sum((basis @ scale) ** 2)), k - 1, dof)
    largest = largest_departure(data.levels, values, spread, dof)
    verdict = "Rejected" if test.p_value < 1 - CONFIDENCE else "Not rejected"
    text = f"{verdict} across throttles: one curve ({chance(test.p_value)})."
    if np.isfinite(largest.bound95):
        low, high = (100 * t for t in largest.between)
        bound = 100 * largest.bound95
        text += (
            f" 95 % upper limit of the difference of Delta L between throttles:"
            f" {bound:{'.0f' if bound >= 10 else '.2g'}} % (between {low:.3g} and {high:.3g} %)."
        )
    return ThrottleCollapse(
        per_throttle={
            float(t): Estimate.around(1 + value, u, reach90)
            for t, value, u in zip(data.levels, values, np.sqrt(np.diag(spread)), strict=True)
        },
        test=test,
        largest_departure=largest,
        text=text,
    )


def f_test(gain: float, extra: int, noise_dof: float) -> CollapseTest:
    """F test of a fall of chi2 by `gain` for `extra` unknowns; chi-square for known noise."""
    from scipy.stats import chi2, f

    p = chi2.sf(gain, extra) if np.isinf(noise_dof) else f.sf(gain / extra, extra, noise_dof)
    return CollapseTest(statistic=gain / extra, dof=(extra, float(noise_dof)), p_value=float(p))


def largest_departure(
    throttles: FloatArray, values: FloatArray, covariance: FloatArray, noise_dof: float
) -> LargestDeparture:
    """Pair of throttles with the largest simultaneous bound on its difference."""
    i, j = np.triu_indices(len(throttles), 1)
    difference = values[j] - values[i]
    u = np.sqrt(np.maximum(covariance[i, i] + covariance[j, j] - 2 * covariance[i, j], 0.0))
    bound = np.abs(difference) + student.quantile(1 - (1 - CONFIDENCE) / 2 / len(i), noise_dof) * u
    at = int(np.argmax(bound))
    return LargestDeparture(
        between=(float(throttles[i[at]]), float(throttles[j[at]])),
        value=float(difference[at]),
        u=float(u[at]),
        bound95=float(bound[at]),
    )
