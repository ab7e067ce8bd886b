"""Cross-validation by visits: the whole search repeated without some visits and scored on them.

A base model without structure must predict held-out visits within the noise, with shared errors as
large as stated.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray
from nearlift.likelihood import budget, student
from nearlift.likelihood.noise import floor, trial_covariance
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.candidate_fit import Fitted
from nearlift.loop.search import Answer, HeldOut, run
from nearlift.loop.search_problem import SearchProblem
from nearlift.results import IntArray, Noise, Observations
from nearlift.results.diagnosis import HeldOutRmse, LoopError
from nearlift.results.estimate import Estimate

#: Folds, where visits are more than `FEW_VISITS`; else each visit is left out in turn.
FOLDS = 3
FEW_VISITS = 15
#: Absolute value at which whitened residuals are clipped, in standard deviations.
OUTLIER = 4.0
#: Significance level of the test of held-out visits against the noise, one-sided, and of that of
#: each stated uncertainty against its estimate, two-sided.
SIGNIFICANCE = 0.01
#: Called as a fold begins, with its index from 0 and the number of folds.
Progress = Callable[[int, int], None]


def ignore_progress(fold: int, of: int) -> None:
    """Ignore the beginning of a fold."""


def blocks(data: Observations) -> IntArray:
    """Cross-validation block of each trial: its visit; itself where the run order is unknown."""
    return data.visit if data.ordered else np.arange(data.n)


def folds(data: Observations) -> list[NDArray[np.bool_]]:
    """Masks of the trials held out, whole `blocks` each, stratified by distance; one block each
    where blocks are few.
    """
    visits, first, index = np.unique(blocks(data), return_index=True, return_inverse=True)
    if len(visits) <= FEW_VISITS:
        return [index == v for v in range(len(visits))]
    turn, z = np.zeros(len(visits), dtype=int), data.z_hat[first]
    for offset, station in enumerate(np.unique(z)):
        mine = np.flatnonzero(z == station)
        turn[mine] = (np.arange(len(mine)) + offset) % FOLDS
    return [turn[index] == f for f in range(FOLDS)]


def held_out(
    problem: SearchProblem,
    again: Callable[[SearchProblem], Answer] | None = run,
    named: tuple[Effect, ...] = (),
    progress: Progress = ignore_progress,
) -> HeldOut:
    """Held-out residuals of the search, repeated in every fold, and of the effects `named`,
    refitted there.

    `again` is the search; if it is None, only the effects are refitted. Stated errors that visits
    share are predicted from the trials of the fold.
    """
    data, declared = problem.data, declared_errors(problem)
    before, after, by_name = np.full((3, data.n), np.nan)
    chosen = []
    masks = folds(data)
    for i, test in enumerate(masks):
        progress(i, len(masks))
        train = ~test
        # L_inf is unknown at a throttle that only held-out visits have, and a curve of L_inf is not
        # extrapolated
        known = test & data.level_known_from(train)
        part = dataclasses.replace(
            problem,
            data=data.take(train),
            log_lift=problem.log_lift[train],
            drawn=problem.null,
        )
        best = None
        if again:
            answer = again(part)
            part, best = answer.problem, answer.best
            chosen.append(answer.accepted[0].name if answer.accepted else answer.verdict)
        same = best and best.candidate.effects == named
        mine = best if best and same else part.best_fit(*named)
        there = data.take(known)
        for residual, fitted in ((before, part.base_fit), (by_name, mine), (after, best or mine)):
            residual[known] = held_out_residuals(
                part, fitted, declared[train], there, declared[known]
            )
    return HeldOut(
        before=before, after=after, named=by_name, visit=blocks(data), chosen=tuple(chosen)
    )


def predict(problem: SearchProblem, fitted: Fitted, at: Observations) -> FloatArray:
    """Log lift of other trials from a fit: its ratio, and L_inf from the fit's own trials."""
    levels = problem.space.best_levels(problem.log_lift - fitted.candidate.log_ratio(fitted.vector))
    far = (
        levels[np.searchsorted(problem.data.levels, at.throttle)]
        if at.curve is None
        else at.level_design @ levels
    )
    return np.asarray(far + fitted.candidate.log_ratio(fitted.vector, at))


def declared_errors(problem: SearchProblem) -> FloatArray:
    """Sensitivities (n, m) of log lift to the stated errors that trials share, each per standard
    uncertainty.
    """
    return budget.shared(problem.data, problem.linear_parts, problem.slope)


def held_out_residuals(
    problem: SearchProblem,
    fitted: Fitted,
    declared: FloatArray,
    at: Observations,
    declared_at: FloatArray,
) -> FloatArray:
    """Relative residuals of trials `at`, corrected for the stated errors that trials share.

    `declared` and `declared_at` are the `declared_errors` of the fitted trials and of those `at`.
    The correction is the best linear unbiased prediction (Robinson 1991, Statistical Science 6,
    15). A fit with independent trials makes none.
    """
    residual = np.log(at.lift_N) - predict(problem, fitted, at)
    if not problem.independent:
        residual -= declared_at @ (fitted.space.project(declared.T) @ fitted.residual)
    return np.asarray(residual, dtype=np.float64)


def improves(problem: SearchProblem, scored: HeldOut) -> bool:
    """Whether the named effects reduce the held-out `misfit` by more than one standard error over
    visits.

    The answers of the folds' own searches do not count. With a third fewer trials a search that
    finds nothing has lost its power and refutes nothing. Residuals are whitened by the noise floor,
    else a few visits near a ceiling with a wrong height would decide alone.
    """
    _, visit = np.unique(scored.visit[scored.predicted], return_inverse=True)
    before, named = (
        misfit(problem, problem.assumed_noise, scored, residual)
        for residual in (scored.before, scored.named)
    )
    gained = np.bincount(visit, before - named)
    return bool(gained.sum() > np.sqrt(len(gained)) * gained.std(ddof=1))


def each_helps(problem: SearchProblem, scored: HeldOut, named: tuple[Effect, ...]) -> bool:
    """Whether each member of a pair reduces the held-out `misfit` of the other; true of one effect.

    A second effect that only imitates an error of the first one's form makes predictions worse.
    """

    def total(residual: FloatArray) -> float:
        return float(misfit(problem, problem.assumed_noise, scored, residual).sum())

    others = [tuple(e for e in named if e is not effect) for effect in named if len(named) > 1]
    return all(total(held_out(problem, None, o).named) > total(scored.named) for o in others)


def misfit(
    problem: SearchProblem, noise: Noise, scored: HeldOut, residual: FloatArray
) -> FloatArray:
    """Squared residuals of the predicted trials, whitened by the noise and by stated errors that
    are independent between trials, clipped at `OUTLIER`.
    """
    keep = scored.predicted
    data, slope = problem.data.take(keep), problem.slope[keep]
    variance = budget.own_variance(data, problem.parts, slope)
    covariance = trial_covariance(data, noise, slope, None, variance)
    return np.minimum(covariance.whiten(residual[keep]) ** 2, OUTLIER**2)


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
    text = f"visits left out are predicted to {100 * error:.2g} %, where the noise floor is"
    return [f"{text} {100 * noise:.2g} %"]


def _strained(problem: SearchProblem) -> list[str]:
    """Two-sided z test of each shared error's estimate, by Bonferroni where it has several."""
    from scipy.stats import norm

    # a fit of few visits leaves the shared errors out of its covariance
    problem = problem.correlated
    absorbed, base = orthonormal(problem.base_fit.jacobian), problem.base_fit
    residual = base.residual - absorbed @ (absorbed.T @ base.residual)
    offsets = [("the distance datum", np.array([base.datum_chi2**0.5]))]
    for part in problem.linear_parts:
        columns = budget.columns(problem.data, part, problem.slope)
        offsets.append((part.name, np.abs(problem.space.project(columns.T) @ residual)))
    return [
        f"{name} is off by {each.max():.2g} of its stated standard uncertainties"
        for name, each in offsets
        if each.max(initial=0.0) > norm.isf(SIGNIFICANCE / 2 / max(len(each), 1))
    ]


def jackknife(without: FloatArray) -> FloatArray:
    """Covariance (P, P) of estimates from those `without` each visit, (visits, P); infinite for a
    single visit.
    """
    blocks = len(without)
    if blocks < 2:
        return np.diag(np.full(without.shape[1], np.inf))
    centred = without - without.mean(axis=0)
    return np.asarray((blocks - 1) / blocks * centred.T @ centred)


def log_rms(
    visit: IntArray, residual: FloatArray, reference: FloatArray | None = None
) -> tuple[float, float]:
    """Log of the root mean square and half of its 90 % interval, by the jackknife over visits. With
    a `reference`, of the ratio to its root mean square.

    Both sides of a ratio share the noise of the same trials, so it is known far better than either.
    Half of the interval is nan for fewer than three visits, or where a side has no residual.
    """
    _, label = np.unique(visit, return_inverse=True)
    squares = np.bincount(label, residual**2)
    below = np.bincount(label, None if reference is None else reference**2)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = float(np.log(squares.sum() / below.sum()) / 2)
        without = np.log((squares.sum() - squares) / (below.sum() - below)) / 2
    if len(squares) < 3 or not np.isfinite(middle):
        return middle, float("nan")
    u = float(np.sqrt(jackknife(without[:, None])[0, 0]))
    return middle, student.quantile(0.95, len(squares) - 1.0) * u


def error(answer: Answer, noise_floor: float) -> LoopError | None:
    """Held-out errors before and after the loop, with their change where effects are named; None
    without cross-validation.
    """
    scored, named = answer.scored, answer.verdict == "effect"
    if scored is None:
        return None
    keep = scored.predicted
    visit, before = scored.visit[keep], scored.before[keep]
    # without a named effect the base model predicts, and nothing changes
    after = scored.after[keep] if named else before

    def rmse(residual: FloatArray) -> HeldOutRmse:
        middle, half = log_rms(visit, residual)
        value, low, high = np.exp([middle, middle - half, middle + half]).tolist()
        return HeldOutRmse(held_out_rmse=value, lo90=low, hi90=high)

    changed = None
    if named:
        middle, half = log_rms(visit, after, before)
        value, low, high = np.expm1([middle, middle - half, middle + half]).tolist()
        changed = Estimate(value=value, lo90=low, hi90=high)
    return LoopError(
        noise_floor=noise_floor,
        before=rmse(before),
        after=rmse(after),
        change=changed,
        chosen_in_folds=tuple(scored.chosen),
    )
