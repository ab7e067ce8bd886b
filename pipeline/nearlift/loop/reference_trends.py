"""Reference trends that an effect's form must beat: a straight line along its covariate, or a step
in time.
"""

from __future__ import annotations

import numpy as np

from nearlift.likelihood.covariates import varies
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.explanation import Explanation
from nearlift.loop.families import STEP
from nearlift.loop.search_problem import SearchProblem


def log_evidence(problem: SearchProblem, e: Explanation) -> float:
    """Log evidence of the likeliest reference trend of an explanation, over that of the null.

    The references are straight lines in gain and in force along the covariate of each effect. Where
    a size differs by session, one step in gain at any time is added. A line that an effect's form
    contains (`Effect.contains_line`) is no reference, since it could win only by having fewer
    parameters.

    Evidence is to first order, with unit information; minus infinity where no reference exists.
    """
    data, absorbed = problem.data, orthonormal(problem.base_jacobian)
    lift_N = data.covariates["lift_inf_N"] * np.exp(
        problem.base_fit.candidate.log_ratio(problem.base_fit.vector)
    )
    lines = {"gain": np.ones(data.n), "force": np.median(lift_N) / lift_N}
    gains = [-np.inf]
    for effect in e.fitted.candidate.effects:
        name = effect.varies_with
        if name not in data.covariates or not varies(data, name):
            continue
        contained = ("force" if effect.additive else "gain") if effect.contains_line else ""
        along = data.covariates[name] - data.covariates[name].mean()
        white = problem.space.project(
            np.stack([along * line for kind, line in lines.items() if kind != contained])
        ).T
        white = white - absorbed @ (absorbed.T @ white)
        length2 = np.maximum(np.sum(white**2, axis=0), 1e-300)
        gains.append(float(np.max((white.T @ problem.base_fit.residual) ** 2 / length2)))
    if e.fitted.candidate.by_session.any():
        gains.append(best_step(problem))
    beyond = problem.unnamed - problem.nothing_added[1]
    return 0.5 * (max(gains) - float(np.log(data.n))) - beyond


def best_step(problem: SearchProblem) -> float:
    """Drop of chi2 by one step at the best of the times tried."""
    hypotheses, basis = problem.hypotheses
    steps = [h.columns for h in hypotheses if h.name == STEP]
    if not steps:
        return 0.0
    columns = np.hstack(steps)
    columns = columns - problem.absorbed @ (problem.absorbed.T @ columns)
    along = columns.T @ (basis.T @ problem.base_fit.residual)
    return float(np.max(along**2 / np.maximum(np.sum(columns**2, axis=0), 1e-12)))
