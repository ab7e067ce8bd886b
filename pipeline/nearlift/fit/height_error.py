"""Error of the distance that all trials share: the effect `height_offset` with its stated prior.

The model is linearised about the most probable error. A column of the covariance carries what
remains of it, by the slope there. That is the posterior to first order about its mode.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from nearlift.declare import FloatArray, LiftModel
from nearlift.likelihood.budget import GROUPED, Component, groups
from nearlift.likelihood.problem import Likelihood
from nearlift.results import Observations

#: Share of the nearest trial's distance within the model's range that the error may take.
#: Ours: at the end of the range itself some models have a pole.
MAX_DISTANCE_SHARE = 0.9


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
    return MAX_DISTANCE_SHARE * data.radius_m * (float(data.z_hat.min()) - model.valid_z_hat[0])


def most_probable_m(
    problem: Likelihood, theta: FloatArray, slope: FloatArray, standard: float
) -> float:
    """Posterior mean of the height error, m, to first order about the problem's own; it moves no
    trial through the boundary.
    """
    mean = standard**2 * float(problem.project(slope) @ problem.residuals(theta))
    return max(mean, -room_m(problem.model, problem.data))


def u_m(problem: Likelihood, theta: FloatArray, slope: FloatArray, standard: float) -> float:
    """Standard uncertainty of the height error after the fit, m."""
    white = problem.project(problem.jacobian(theta).T).T
    column = problem.project(slope)
    rest = column - white @ np.linalg.lstsq(white, column, rcond=None)[0]
    return standard * float(np.sqrt(max(1 - standard**2 * float(rest @ rest), 0.0)))
