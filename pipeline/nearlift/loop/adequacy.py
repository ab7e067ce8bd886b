"""Adequacy of a base model without structure: held-out visits are predicted within the noise, and
shared errors are as large as stated.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from nearlift.likelihood import budget
from nearlift.likelihood.noise import floor
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.confirmation import HeldOut, declared_errors, misfit
from nearlift.loop.search_problem import SearchProblem

#: Significance level of the test of held-out visits against the noise, one-sided, and of that of
#: each stated uncertainty against its estimate, two-sided.
SIGNIFICANCE = 0.01


def contradictions(problem: SearchProblem, scored: HeldOut | None) -> tuple[str, ...]:
    """Contradictions of an adequate base model, in words; `scored` are held-out residuals."""
    return (*_floor_missed(problem, scored), *_strained(problem))


def _floor_missed(problem: SearchProblem, scored: HeldOut | None) -> list[str]:
    """One-sided t test over visits of the held-out `misfit` against what noise would make it."""
    from scipy.stats import t

    if scored is None:
        return []
    _, visit = np.unique(scored.visit[scored.predicted], return_inverse=True)
    # a stated uncertainty frees as much as the trials determine of it
    declared = problem.space.project(declared_errors(problem).T)
    free = problem.data.unknown_levels + len(problem.start) + np.sum(declared**2)
    left = misfit(problem, problem.noise, scored, scored.before)
    beyond = np.bincount(visit, left - 1 - free / max(problem.data.n - free, 1))
    blocks = len(beyond)
    if blocks < 3 or beyond.sum() <= t.isf(SIGNIFICANCE, blocks - 1) * np.sqrt(blocks) * beyond.std(
        ddof=1
    ):
        return []
    error = float(np.sqrt(np.mean(scored.before[scored.predicted] ** 2)))
    noise = floor(problem.data, problem.noise, problem.slope)
    return [
        (
            f"visits left out are predicted to {100 * error:.2g} %, where the noise floor is"
            f" {100 * noise:.2g} %"
        )
    ]


def _strained(problem: SearchProblem) -> list[str]:
    """Two-sided z test of each shared error's estimate, by Bonferroni where it has several."""
    from scipy.stats import norm

    # a fit of few visits leaves the shared errors out of its covariance
    problem = dataclasses.replace(problem, independent=False)
    absorbed, reasons = orthonormal(problem.base_fit.jacobian), []
    error = problem.base_fit.datum_chi2**0.5
    if error > norm.isf(SIGNIFICANCE / 2):
        reasons.append(
            f"the distance datum is off by {error:.2g} of its stated standard uncertainties"
        )
    for part in problem.linear_parts:
        columns = budget.columns(problem.data, part, problem.slope)
        if not columns.shape[1]:
            continue
        residual = problem.base_fit.residual - absorbed @ (absorbed.T @ problem.base_fit.residual)
        offset = np.abs(problem.space.project(columns.T) @ residual).max()
        if offset > norm.isf(SIGNIFICANCE / 2 / columns.shape[1]):
            reasons.append(
                f"{part.name} is off by {offset:.2g} of its stated standard uncertainties"
            )
    return reasons
