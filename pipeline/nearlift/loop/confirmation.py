"""Cross-validation by visits: the whole search repeated without some visits and scored on them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray
from nearlift.likelihood import budget, student
from nearlift.likelihood.noise import trial_covariance
from nearlift.loop.candidate_fit import Fitted, search
from nearlift.loop.search import Answer, run
from nearlift.loop.search_problem import SearchProblem
from nearlift.results import IntArray, Noise, Observations
from nearlift.results.diagnosis import HeldOutRmse, LoopError
from nearlift.results.estimate import Estimate

#: Folds, where visits are more than `FEW_VISITS`; else each visit is left out in turn.
FOLDS = 3
FEW_VISITS = 15
#: Absolute value at which whitened residuals are clipped, in standard deviations.
OUTLIER = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Relative held-out residuals of every trial, nan where it cannot be predicted.

    `before` is by the base model, `after` by the answer of each fold's search (`chosen`). `named`
    is by the explanation found in all visits, refitted in each fold. `visit` holds the `blocks`.
    """

    before: FloatArray
    after: FloatArray
    named: FloatArray
    visit: IntArray
    chosen: tuple[str, ...]

    @property
    def predicted(self) -> NDArray[np.bool_]:
        """Mask of the trials that could be predicted."""
        return np.isfinite(self.before) & np.isfinite(self.after)


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
    block = blocks(data)
    visits, first = np.unique(block, return_index=True)
    if len(visits) <= FEW_VISITS:
        return [block == v for v in visits]
    turn = np.zeros(len(visits), dtype=int)
    z = data.z_hat[first]
    for offset, station in enumerate(np.unique(z)):
        mine = np.flatnonzero(z == station)
        turn[mine] = (np.arange(len(mine)) + offset) % FOLDS
    fold = dict(zip(visits.tolist(), turn.tolist(), strict=True))
    label = np.array([fold[v] for v in block.tolist()])
    return [label == f for f in range(FOLDS)]


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
        mine = (
            best
            if best and best.candidate.effects == named
            else search(part.candidate(*named), part.starts, part.log_lift)
        )
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
    if len(named) < 2:
        return True
    together = misfit(problem, problem.assumed_noise, scored, scored.named).sum()
    for effect in named:
        others = tuple(e for e in named if e is not effect)
        alone = held_out(problem, None, others)
        if misfit(problem, problem.assumed_noise, scored, alone.named).sum() <= together:
            return False
    return True


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
    """Log of the root mean square, or of its ratio to that of a `reference`, and half of its 90 %
    interval by the jackknife over visits.

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


def error(answer: Answer, scored: HeldOut, noise_floor: float) -> LoopError:
    """Held-out errors before and after the loop, with their change where effects are named."""
    keep = scored.predicted
    visit, before, after = scored.visit[keep], scored.before[keep], scored.after[keep]

    def rmse(residual: FloatArray) -> HeldOutRmse:
        middle, half = log_rms(visit, residual)
        value, low, high = np.exp([middle, middle - half, middle + half]).tolist()
        return HeldOutRmse(held_out_rmse=value, lo90=low, hi90=high)

    changed, named = None, answer.verdict == "effect"
    if named:
        middle, half = log_rms(visit, after, before)
        value, low, high = np.expm1([middle, middle - half, middle + half]).tolist()
        changed = Estimate(value=value, lo90=low, hi90=high)
    # without a named effect the base model predicts, and nothing changes
    return LoopError(
        noise_floor=noise_floor,
        before=rmse(before),
        after=rmse(after if named else before),
        change=changed,
        held_out_trials=int(keep.sum()),
        chosen_in_folds=tuple(scored.chosen),
    )
