"""Throttle collapse: whether Delta L is the same at all throttles, tested and bounded.

Three F tests use the full covariance of the trials, with the budget's shared errors. The first is
of one headline coefficient per throttle, the second of one scale of the curve per throttle. The
third needs no model: it is of an interaction between distance and throttle. L_inf is free per
throttle in all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import solver
from nearlift.fit.information import parameter_covariance
from nearlift.fit.significance import REJECTS, chance, f_test, percent
from nearlift.likelihood import student
from nearlift.likelihood.noise import MOST_MEANS
from nearlift.likelihood.problem import Problem
from nearlift.likelihood.subspace import framed, left_singular
from nearlift.results import IntArray
from nearlift.results.assumptions import (
    CollapseTest,
    LargestDeparture,
    ThrottleCoefficient,
    ThrottleCollapse,
)

#: Confidence level of the largest departure.
CONFIDENCE = 0.95
#: Effective degrees of freedom (m,) of linear estimators (m, n) of the trials' log lift.
Freedom = Callable[[FloatArray], FloatArray]


def examine(
    problem: Problem, theta: FloatArray, freedom: Freedom, reach90: float
) -> ThrottleCollapse:
    """Test the collapse at the optimum `theta` (p,) of a model common to all throttles.

    Departures are simultaneous over all pairs of throttles (Bonferroni), relative to the common
    coefficient and to the common log ratio.

    Parameters
    ----------
    freedom : callable
        Effective degrees of freedom of linear estimators, as by `information.freedom`. Errors
        common to a visit cancel from contrasts between its throttles, whose degrees of freedom
        therefore differ from the coefficient's.
    reach90 : float
        Half of a coefficient's 90 % interval, in standard uncertainties.
    """
    throttles, name = problem.data.levels, problem.names[0] if problem.names else ""
    coefficient = curve = of_coefficient = of_curve = None
    each: dict[float, ThrottleCoefficient] = {}
    if len(throttles) > 1 and name:
        values, covariance, chi2 = per_throttle(problem, theta)
        known = np.isfinite(np.diag(covariance))
        # trials at one distance determine no throttle's coefficient
        if known.any():
            throttle, values = throttles[known], values[known]
            covariance = covariance[np.ix_(known, known)]
            centred = np.eye(known.sum()) - 1 / known.sum()
            u_apart = np.sqrt(np.diag(centred @ covariance @ centred))
            each = {
                t: ThrottleCoefficient.around(value, u, reach90, u_apart=float(apart))
                for t, value, u, apart in zip(
                    throttle, values, np.sqrt(np.diag(covariance)), u_apart, strict=True
                )
            }
            curve, of_curve = scale_per_throttle(problem, theta, freedom)
            apart = _directions(problem, theta, problem.jacobian(theta)[:, :1])
            dof = student.several(freedom(problem.covariance.unwhiten(apart.T)))
            gain = float(problem.chi2(theta)) - chi2
            coefficient = f_test(gain, int(known.sum()) - 1, dof)
            of_coefficient = largest(throttle, values, covariance, abs(float(theta[0])), dof)
    collapse = ThrottleCollapse(
        coefficient=name,
        per_throttle=each,
        tests={"coefficient": coefficient, "curve": curve, "cells": cells(problem, freedom)},
        largest_departure={"coefficient": of_coefficient, "delta_L": of_curve},
        text="",
    )
    return replace(collapse, text=_words(len(throttles), collapse))


def _words(throttles: int, collapse: ThrottleCollapse) -> str:
    """Outcome of the tests, and 95 % bounds on differences between throttles."""
    if throttles < 2:
        return "All trials ran at one throttle: whether Delta L depends on it cannot be tested."
    claims = {
        "coefficient": f"one {collapse.coefficient}",
        "curve": "one curve",
        "cells": "one Delta L in all cells of a distance, no model",
    }
    made = [
        (f"{claims[name]} ({chance(test.p_value)})", test)
        for name, test in collapse.tests.items()
        if test is not None
    ]
    if not made:
        return "These trials cannot test whether Delta L depends on throttle."
    rejected = [claim for claim, test in made if test.p_value < REJECTS]
    kept = [claim for claim, test in made if test.p_value >= REJECTS and not test.quiet]
    quiet = [claim for claim, test in made if test.quiet]
    parts = [
        f"{verdict} across throttles: {'; '.join(listed)}."
        for verdict, listed in (("Rejected", rejected), ("Not rejected", kept))
        if listed
    ]
    if quiet:
        parts.append(
            f"Not tested: {'; '.join(quiet)}. Trials scatter less than their noise: it is"
            " overestimated or shared by trials. That is no evidence of a collapse."
        )
    bounds = [
        f"{percent(d.bound95)} % in {what} (between {100 * d.between[0]:.3g} and"
        f" {100 * d.between[1]:.3g} %)"
        for what, d in zip(
            (collapse.coefficient, "Delta L"), collapse.largest_departure.values(), strict=True
        )
        if d is not None and np.isfinite(d.bound95)
    ]
    if bounds:
        parts.append(f"95 % upper limits of the difference between throttles: {', '.join(bounds)}.")
    return " ".join(parts)


def per_throttle(problem: Problem, theta: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """The headline coefficient of each throttle (K,), their covariance (K, K) with the others free,
    and chi2.

    An undetermined coefficient has infinite variance.
    """
    data, k = problem.data, len(problem.data.levels)
    low, high = (np.r_[np.full(k, end[0]), end[1:]] for end in problem.model.bounds)

    def each(x: FloatArray) -> FloatArray:
        return np.column_stack([x[:k], np.broadcast_to(x[k:], (k, len(x) - k))])

    def left(x: FloatArray) -> FloatArray:
        return problem.left(problem.log_ratio(each(x))[data.level, np.arange(data.n)])

    def jacobian(x: FloatArray) -> FloatArray:
        slopes = problem.slopes(each(x))[data.level, :, np.arange(data.n)]
        return np.hstack([np.eye(k)[data.level] * slopes[:, :1], slopes[:, 1:]]).T

    def linearised(x: FloatArray, _: IntArray) -> tuple[FloatArray, FloatArray]:
        return left(x[0])[None], -problem.project(jacobian(x[0]))[None]

    inset = np.where(np.isfinite(high - low), 1e-9 * (high - low), 0.0)
    start = np.clip(np.r_[np.full(k, theta[0]), theta[1:]], low + inset, high - inset)
    size = np.maximum(np.abs(start), 0.05)
    minimum = solver.minimise(linearised, start[None], (low, high), size).theta
    [best] = solver.refine(linearised, minimum, (low, high))
    rows = jacobian(best)
    covariance, determined = parameter_covariance(
        np.nan_to_num(problem.project(rows)),
        np.linalg.norm(problem.covariance.whiten(rows), axis=1),
    )
    covariance[~determined, ~determined] = np.inf
    return best[:k], covariance[:k, :k], float(np.sum(left(best) ** 2))


def _contrasts(throttles: int) -> FloatArray:
    """Orthonormal contrasts (k, k - 1) between throttles."""
    level = np.column_stack([np.ones(throttles), np.eye(throttles)[:, 1:]])
    return np.linalg.qr(level)[0][:, 1:]


def _directions(problem: Problem, theta: FloatArray, column: FloatArray) -> FloatArray:
    """Orthonormal basis (n, m) of one `column` (n, 1) per throttle, free of theta and L_inf."""
    k = len(problem.data.levels)
    each = ((np.eye(k)[problem.data.level] * column) @ _contrasts(k)).T
    q, _ = np.linalg.qr(problem.project(problem.jacobian(theta).T).T)
    free = problem.project(each).T
    u, size = left_singular(free - q @ (q.T @ free))
    return u[
        :, size > 1e-6 * np.linalg.norm(problem.covariance.whiten(each), axis=1).max(initial=0.0)
    ]


def scale_per_throttle(
    problem: Problem, theta: FloatArray, freedom: Freedom
) -> tuple[CollapseTest | None, LargestDeparture | None]:
    """Test of one scale of log ratio per throttle, theta free in common, to first order about
    `theta`; and the largest difference between scales.
    """
    data, k = problem.data, len(problem.data.levels)
    contrast, residual = _contrasts(k), problem.residuals(theta)
    each = ((np.eye(k)[data.level] * problem.log_ratio(theta)[:, None]) @ contrast).T
    q, _ = np.linalg.qr(problem.project(problem.jacobian(theta).T).T)
    free = problem.project(each).T
    free = free - q @ (q.T @ free)
    residual = residual - q @ (q.T @ residual)
    covariance, determined = parameter_covariance(
        free.T, np.linalg.norm(problem.covariance.whiten(each), axis=1)
    )
    if not determined.all():
        return None, None
    scale = covariance @ (free.T @ residual)
    gain = float(residual @ residual - (residual - free @ scale) @ (residual - free @ scale))
    dof = student.several(freedom(problem.covariance.unwhiten(np.linalg.qr(free)[0].T)))
    return f_test(gain, k - 1, dof), largest(
        data.levels, contrast @ scale, contrast @ covariance @ contrast.T, 1.0, dof
    )


def cells(problem: Problem, freedom: Freedom) -> CollapseTest | None:
    """Interaction of distance and throttle, tested with a noise model but no lift model."""
    data = problem.data
    distance = np.unique(data.z_hat, return_inverse=True)[1]
    both = np.unique(np.stack([distance, data.level]), axis=1, return_inverse=True)[1].ravel()
    if len(data.levels) < 2 or both.max() + 1 >= min(data.n, MOST_MEANS + 1):
        return None
    (common, left), (each, rest) = (
        _left(problem, np.eye(group.max() + 1)[group]) for group in (distance, both)
    )
    extra = each.shape[1] - common.shape[1]
    if extra <= 0:
        return None
    apart = framed(left_singular(each - common @ (common.T @ each))[0][:, :extra])
    return f_test(
        left - rest, extra, student.several(freedom(problem.covariance.unwhiten(apart.T)))
    )


def _left(problem: Problem, indicator: FloatArray) -> tuple[FloatArray, float]:
    """Orthonormal basis (n, m) of an indicator's columns free of L_inf, and the residual chi2."""
    white = problem.project(indicator.T).T
    u, size = left_singular(white)
    # a column in the span of L_inf leaves only rounding
    u = u[:, size > 1e-7 * np.linalg.norm(problem.covariance.whiten(indicator.T), axis=1).max()]
    target = problem.project(np.log(problem.data.lift_N))
    rest = target - u @ (u.T @ target)
    return u, float(rest @ rest)


def largest(
    throttles: FloatArray, values: FloatArray, covariance: FloatArray, unit: float, noise_dof: float
) -> LargestDeparture | None:
    """Pair of throttles with the largest simultaneous bound on its difference, over `unit`."""
    i, j = np.triu_indices(len(throttles), 1)
    if not len(i) or not unit > 0:
        return None
    difference = values[j] - values[i]
    u = np.sqrt(np.maximum(covariance[i, i] + covariance[j, j] - 2 * covariance[i, j], 0.0))
    tail = 0.5 + 0.5 * (1 - (1 - CONFIDENCE) / len(i))
    quantile = student.quantile(tail, noise_dof)
    bound = np.abs(difference) + quantile * u
    at = int(np.argmax(bound))
    return LargestDeparture(
        between=(float(throttles[i[at]]), float(throttles[j[at]])),
        value=float(difference[at]) / unit,
        u=float(u[at]) / unit,
        bound95=float(bound[at]) / unit,
    )
