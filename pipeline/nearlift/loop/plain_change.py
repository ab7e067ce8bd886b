"""A change along a covariate that has no form of its own: a straight line, or a step in time. What
it explains better than an effect is not that effect.
"""

from __future__ import annotations

import numpy as np

from nearlift.likelihood.covariates import varies
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.explanation import Explanation
from nearlift.loop.families import STEP
from nearlift.loop.search_problem import SearchProblem


def log_evidence(stage: SearchProblem, e: Explanation) -> float:
    """Log evidence of a plain change along the covariates of an explanation's effects, over that of
    what has no name: a straight line in gain or in force, or where a size differs by session a step
    in gain at any time; the largest.

    To first order, by unit information; minus infinity where no covariate of its own was logged.
    """
    data, absorbed = stage.data, orthonormal(stage.base_jacobian)
    lift_N = data.covariates["lift_inf_N"] * np.exp(
        stage.base_fit.candidate.log_ratio(stage.base_fit.vector)
    )
    gains = [-np.inf]
    for name in (effect.varies_with for effect in e.fitted.candidate.effects):
        if name in data.covariates and varies(data, name):
            along = data.covariates[name] - data.covariates[name].mean()
            white = stage.space.project(np.stack([along, along * np.median(lift_N) / lift_N])).T
            white = white - absorbed @ (absorbed.T @ white)
            length2 = np.maximum(np.sum(white**2, axis=0), 1e-300)
            gains.append(float(np.max((white.T @ stage.base_fit.residual) ** 2 / length2)))
    if e.fitted.candidate.by_session.any():
        gains.append(best_step(stage))
    beyond = stage.unnamed - stage.nothing_added[1]
    return 0.5 * (max(gains) - float(np.log(data.n))) - beyond


def best_step(stage: SearchProblem) -> float:
    """Drop of chi2 by one step at the best of the times tried."""
    hypotheses, basis = stage.hypotheses
    steps = [h.columns for h in hypotheses if h.name == STEP]
    if not steps:
        return 0.0
    columns = np.hstack(steps)
    columns = columns - stage.absorbed @ (stage.absorbed.T @ columns)
    along = columns.T @ (basis.T @ stage.base_fit.residual)
    return float(np.max(along**2 / np.maximum(np.sum(columns**2, axis=0), 1e-12)))
