"""What the verdict "adequate" demands beside the absence of structure: that visits left out are
predicted as well as noise allows, and that no declared error stands far from what was declared of
it.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from nearlift.likelihood import budget
from nearlift.likelihood.noise import floor
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.confirmation import HeldOut, misfit
from nearlift.loop.search_problem import SearchProblem

#: Chance with which visits left out of a right model stray by as much as to contradict it.
STRAY = 0.01
#: How far an error may stand from its declared value, in its declared standard uncertainties.
SIGMAS = 2.0


def contradictions(stage: SearchProblem, scored: HeldOut | None) -> tuple[str, ...]:
    """What contradicts an adequate base model, in words; empty where nothing does. `scored` are
    visits left out.
    """
    return (*_floor_missed(stage, scored), *_strained(stage))


def _floor_missed(stage: SearchProblem, scored: HeldOut | None) -> list[str]:
    """Whether visits left out stray from their prediction by more than the noise floor, beyond
    chance.

    Visit by visit in units of the floor, no trial for more than an outlier counts; the prediction's
    own uncertainty is allowed for.
    """
    from scipy.stats import t

    if scored is None:
        return []
    _, visit = np.unique(scored.visit[scored.predicted], return_inverse=True)
    free = stage.data.unknown_levels + len(stage.theta)
    beyond = np.bincount(
        visit,
        misfit(stage, stage.noise, scored, scored.before) - 1 - free / max(stage.data.n - free, 1),
    )
    blocks = len(beyond)
    if blocks < 3 or beyond.sum() <= t.isf(STRAY, blocks - 1) * np.sqrt(blocks) * beyond.std(
        ddof=1
    ):
        return []
    error = float(np.sqrt(np.mean(scored.before[scored.predicted] ** 2)))
    noise = floor(stage.data, stage.noise, stage.slope)
    return [
        (
            f"visits left out are predicted to {100 * error:.2g} %, where noise alone would be"
            f" {100 * noise:.2g} %"
        )
    ]


def _strained(stage: SearchProblem) -> list[str]:
    """The declared errors that stand beyond `SIGMAS` of their declared uncertainty; of several
    unknowns of one error, as rarely for all together.
    """
    from scipy.stats import norm

    # where visits are judged by leaving them out, the declared errors are no part of the fit
    stage = dataclasses.replace(stage, independent=False)
    absorbed, reasons = orthonormal(stage.base_fit.jacobian), []
    for part in stage.parts:
        columns = budget.columns(stage.data, part, stage.slope)
        if not columns.shape[1]:
            continue
        residual = stage.base_fit.residual - absorbed @ (absorbed.T @ stage.base_fit.residual)
        stands = np.abs(stage.space.project(columns.T) @ residual).max()
        if stands > norm.isf(norm.sf(SIGMAS) / columns.shape[1]):
            reasons.append(
                f"{part.name} stands {stands:.2g} of its declared standard uncertainties off"
            )
    return reasons
