"""Lift far from the boundary by the accepted model, per throttle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.loop.candidate_fit import Fitted, inverse
from nearlift.loop.search_problem import SearchProblem
from nearlift.results.estimate import Estimate


def far_lift(problem: SearchProblem, fitted: Fitted, nuisance: FloatArray) -> dict[float, Estimate]:
    """L_inf at each throttle, in the average conditions of the trials at that throttle.

    Effects that act far away, such as a sagging supply, are included at their mean over those
    trials. `nuisance` (n, t) are columns of further unit-variance unknowns. Where trials count as
    independent, the uncertainty is that of a sum over whole visits (a sandwich estimate).
    """
    data, candidate, vector = problem.data, fitted.candidate, fitted.vector
    far = replace(candidate, data=replace(data, z_hat=np.full(data.n, np.inf)))
    design = np.hstack([data.level_design, candidate.jacobian(vector), nuisance])
    free = data.unknown_levels
    sd = np.concatenate([np.full(free, np.inf), candidate.prior[1], np.ones(nuisance.shape[1])])
    white = problem.space.covariance.whiten(design.T).T
    covariance = inverse(white.T @ white + np.diag(1 / sd**2))
    if problem.independent:
        visits, visit = np.unique(data.visit, return_inverse=True)
        scores = np.zeros((len(visits), len(covariance)))
        np.add.at(scores, visit, white * fitted.residual[:, None])
        scores *= np.sqrt(len(visits) / max(len(visits) - 1, 1))
        covariance = covariance @ scores.T @ scores @ covariance
    levels = problem.space.best_levels(problem.log_lift - candidate.log_ratio(vector))
    change, slope = np.nan_to_num(far.log_ratio(vector)), far.jacobian(vector)
    shown = data.shown(np.eye(free))
    by_throttle = {}
    for k, throttle in enumerate(data.levels):
        here = data.level == k
        weight = np.concatenate([shown[k], slope[here].mean(axis=0), np.zeros(nuisance.shape[1])])
        value = float(np.exp(shown[k] @ levels + change[here].mean()))
        u = value * float(np.sqrt(weight @ covariance @ weight))
        by_throttle[float(throttle)] = Estimate(value=value, u=u)
    return by_throttle
