"""Error of the distance that all trials share, where the slope of the curve does not carry it.

To first order a height error e adds ``e f'`` to the log ratio f, and is a column of the covariance.
This omits the even part, ``(f(z + e) + f(z - e)) / 2 - f(z)``. Where that would shift a coefficient
by more than `LIMIT` standard uncertainties, f is linearised about the most probable e, not about
zero. This is the effect `height_offset` with the stated distribution as its prior.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from nearlift.declare import FloatArray, LiftModel
from nearlift.likelihood.budget import GROUPED, Component, groups
from nearlift.likelihood.problem import Problem
from nearlift.results import Observations

#: Shift of a coefficient, in standard uncertainties, above which the slope does not suffice; it
#: costs a 90 % interval 0.2 % of coverage.
LIMIT = 0.1
#: Largest error that is allowed for, in stated standard uncertainties: beyond, an effect is
#: likelier.
FARTHEST = 3.0
#: Share of the nearest trial's distance within the model's range that the error may take.
CLOSEST = 0.9


def common(parts: Iterable[Component], data: Observations) -> tuple[Component, ...]:
    """The stated height errors that all of these trials share."""
    return tuple(
        part
        for part in parts
        if part.on == "height"
        and part.standard > 0
        and part.scope in GROUPED
        and groups(data, part.scope).max(initial=0) == 0
    )


def standard_m(parts: Iterable[Component]) -> float:
    """Standard uncertainty of the sum of some errors, m."""
    return float(np.sqrt(sum(part.standard**2 for part in parts)))


def room_m(model: LiftModel, data: Observations) -> float:
    """Largest error towards the boundary, m, by which no trial is moved through it."""
    return CLOSEST * data.radius_m * (float(data.z_hat.min()) - model.valid_z_hat[0])


def limits_m(model: LiftModel, data: Observations, standard: float) -> tuple[float, float]:
    """Least and greatest height error, m: no trial is moved through the boundary."""
    return max(-FARTHEST * standard, -room_m(model, data)), FARTHEST * standard


def bends(problem: Problem, theta: FloatArray, standard: float) -> bool:
    """Whether the even part of a height error shifts a coefficient by more than `LIMIT` of u."""
    if not standard or not len(theta):
        return False
    up, here, down = (problem.moved(e).log_ratio(theta) for e in (standard, 0.0, -standard))
    white = problem.project(problem.jacobian(theta).T)
    inverse = np.linalg.pinv(white @ white.T, rcond=1e-13, hermitian=True)
    shift = inverse @ white @ problem.project((up + down) / 2 - here)
    u = np.sqrt(np.diag(inverse))
    # where the model has no value so far off, the slope does not suffice either
    return bool(np.any((u > 0) & ~(np.abs(shift) <= LIMIT * u)))


def most_probable_m(
    problem: Problem, theta: FloatArray, slope: FloatArray, standard: float
) -> float:
    """Posterior mean of the height error, m, to first order about the problem's own; within
    `limits_m`.
    """
    mean = standard**2 * float(problem.project(slope) @ problem.residuals(theta))
    return float(np.clip(mean, *limits_m(problem.model, problem.data, standard)))


def u_m(problem: Problem, theta: FloatArray, slope: FloatArray, standard: float) -> float:
    """Standard uncertainty of the height error after the fit, m."""
    white = problem.project(problem.jacobian(theta).T).T
    column = problem.project(slope)
    rest = column - white @ np.linalg.lstsq(white, column, rcond=None)[0]
    return standard * float(np.sqrt(max(1 - standard**2 * float(rest @ rest), 0.0)))
