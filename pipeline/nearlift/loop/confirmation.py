"""Error on visits that took no part in choosing: the whole search repeated without some visits,
scored on them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray
from nearlift.likelihood import budget
from nearlift.likelihood.noise import trial_covariance
from nearlift.loop.candidate_fit import Fitted, search
from nearlift.loop.instruments import instruments
from nearlift.loop.search import Answer, run
from nearlift.loop.search_problem import SearchProblem
from nearlift.results import IntArray, Noise, Observations
from nearlift.results.diagnosis import Change, HeldOutRmse, LoopError

FOLDS = 3
#: With no more visits than this, each is left out in turn.
FEW_VISITS = 15
#: Whitened residuals beyond this count no more.
OUTLIER = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Relative residuals of every trial, predicted without its visit (nan where that is
    impossible); what each fold chose.

    `before` is the base model's, `after` that of what each fold chose, `named` that of the
    explanation found in all visits, its sizes estimated without the visit; `visit` is what was left
    out together, as `blocks` has it.
    """

    before: FloatArray
    after: FloatArray
    named: FloatArray
    visit: IntArray
    chosen: tuple[str, ...]

    @property
    def predicted(self) -> NDArray[np.bool_]:
        """Which trials could be predicted."""
        return np.isfinite(self.before) & np.isfinite(self.after)


#: Hears which fold, from 0, of how many begins.
Heard = Callable[[int, int], None]


def unheard(fold: int, of: int) -> None:
    """Nobody listens."""


def blocks(data: Observations) -> IntArray:
    """What is left out together: a visit; a trial by itself where nobody knows which trials one
    visit held.
    """
    return data.visit if data.ordered else np.arange(data.n)


def folds(data: Observations) -> list[NDArray[np.bool_]]:
    """Masks of the trials held out, whole `blocks` each: every station keeps some on both sides
    where it has several.
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
    stage: SearchProblem,
    again: Callable[[SearchProblem], Answer] = run,
    named: tuple[Effect, ...] = (),
    heard: Heard = unheard,
) -> HeldOut:
    """Repeat the search in every fold by `again`, and predict what was left out; also by the
    effects `named`, fitted to the fold. `heard` is told of each fold as it begins.
    """
    data = stage.data
    before, after, by_name = (
        np.full(data.n, np.nan),
        np.full(data.n, np.nan),
        np.full(data.n, np.nan),
    )
    chosen = []
    masks = folds(data)
    for i, test in enumerate(masks):
        heard(i, len(masks))
        train = ~test
        # a throttle that only the held-out visits have cannot be predicted: its L_inf is unknown,
        # and a curve of it says nothing beyond the trials that it is fitted to
        known = test & data.foretold_by(train)
        part = dataclasses.replace(
            stage,
            data=data.take(train),
            log_lift=stage.log_lift[train],
        )
        answer = again(part)
        part = answer.stage
        chosen.append(answer.accepted[0].name if answer.accepted else answer.verdict)
        truth = np.log(data.lift_N[known])
        before[known] = truth - predict(part, part.base_fit, data.take(known))
        after[known] = truth - predict(part, answer.best, data.take(known))
        if answer.best.candidate.effects == named:
            by_name[known] = after[known]
        elif named:
            refitted = search(
                part.candidate(*named), part.space, part.log_lift, part.base_fit.vector
            )
            by_name[known] = truth - predict(part, refitted, data.take(known))
    return HeldOut(
        before=before, after=after, named=by_name, visit=blocks(data), chosen=tuple(chosen)
    )


def predict(stage: SearchProblem, fitted: Fitted, at: Observations) -> FloatArray:
    """Log lift of other trials from a fit: its ratio, and L_inf from the fit's own trials."""
    levels = stage.space.best_levels(stage.log_lift - fitted.candidate.log_ratio(fitted.vector))
    vector = fitted.vector
    far = (
        levels[np.searchsorted(stage.data.levels, at.throttle)]
        if at.curve is None
        else at.level_columns @ levels
    )
    result: FloatArray = far + fitted.candidate.log_ratio(vector, at)
    return result


def improves(stage: SearchProblem, scored: HeldOut) -> bool:
    """Whether the effects named predict visits that they were not fitted to better than the base
    model does, by more than one standard error.

    Not what each fold chose: with a third of the trials less, a search that finds nothing has only
    lost its power, and refutes nobody. Residuals are weighed by the noise floor, visit by visit:
    beside a ceiling a few visits whose height was off would decide alone, and an effect that shows
    everywhere else would be lost with them. No trial counts for more than `OUTLIER` standard
    deviations.
    """
    _, visit = np.unique(scored.visit[scored.predicted], return_inverse=True)
    before, named = (
        misfit(stage, stage.assumed_noise, scored, residual)
        for residual in (scored.before, scored.named)
    )
    gained = np.bincount(visit, before - named)
    return bool(gained.sum() > np.sqrt(len(gained)) * gained.std(ddof=1))


def misfit(stage: SearchProblem, noise: Noise, scored: HeldOut, residual: FloatArray) -> FloatArray:
    """Squares of the residuals (n,) of those that were predicted, in units of the noise and of
    errors of single trials, no outlier counted as one.
    """
    keep = scored.predicted
    data, slope = stage.data.take(keep), stage.slope[keep]
    variance = budget.own_variance(data, stage.parts, slope)
    covariance = trial_covariance(data, noise, slope, None, variance, instruments(data))
    return np.minimum(covariance.whiten(residual[keep]) ** 2, OUTLIER**2)


def standard_error(without: FloatArray) -> FloatArray:
    """Standard uncertainty of each entry from the jackknife's values (visits, ...), one for each
    visit left out; infinite for a single one.
    """
    blocks = len(without)
    if blocks < 2:
        return np.full(without.shape[1:], np.inf)
    result: FloatArray = np.sqrt(
        (blocks - 1) / blocks * np.sum((without - without.mean(axis=0)) ** 2, axis=0)
    )
    return result


def _half90(without: FloatArray) -> float:
    """Half of a 90 % interval from the jackknife's values (visits,), with Student's t."""
    from scipy.stats import t

    return float(t.ppf(0.95, len(without) - 1) * standard_error(without))


def rmse(residual: FloatArray, visit: IntArray) -> tuple[float, float, float]:
    """Root mean square and its 90 % interval: log mean square by visits, jackknifed."""
    _, label = np.unique(visit, return_inverse=True)
    squares, count = np.bincount(label, residual**2), np.bincount(label)
    total = squares.sum() / count.sum()
    value = np.sqrt(total)
    if len(count) < 3 or total <= 0:
        return float(value), float("nan"), float("nan")
    half = _half90(np.log((squares.sum() - squares) / (count.sum() - count))) / 2
    return float(value), float(value * np.exp(-half)), float(value * np.exp(half))


def change(before: FloatArray, after: FloatArray, visit: IntArray) -> tuple[float, float, float]:
    """Relative change of the root mean square, negative where it falls, and its 90 % interval,
    visit by visit in pairs.

    The same trials stand on both sides and share their noise, so the change is known far better
    than either error: log ratio, jackknifed over visits. Nan where there are fewer than three
    visits or nothing is left to compare.
    """
    _, label = np.unique(visit, return_inverse=True)
    one, other = np.bincount(label, before**2), np.bincount(label, after**2)
    if len(one) < 3 or min(one.sum(), other.sum()) <= 0:
        return float("nan"), float("nan"), float("nan")
    log_ratio = np.log(other.sum() / one.sum()) / 2
    half = _half90(np.log((other.sum() - other) / (one.sum() - one)) / 2)
    return (
        float(np.expm1(log_ratio)),
        float(np.expm1(log_ratio - half)),
        float(np.expm1(log_ratio + half)),
    )


def error(answer: Answer, scored: HeldOut, noise_floor: float) -> LoopError:
    """Held-out errors before and after."""
    keep = scored.predicted

    def rmse_of(residual: FloatArray) -> HeldOutRmse:
        value, low, high = rmse(residual[keep], scored.visit[keep])
        return HeldOutRmse(held_out_rmse=value, lo90=low, hi90=high)

    before, named = rmse_of(scored.before), answer.verdict == "effect"
    changed = None
    if named:
        value, low, high = change(scored.before[keep], scored.after[keep], scored.visit[keep])
        changed = Change(value=value, lo90=low, hi90=high)
    return LoopError(
        noise_floor=noise_floor,
        before=before,
        # an adequate model is left alone, so nothing is gained and nothing is lost
        after=rmse_of(scored.after) if named else before,
        change=changed,
        held_out_trials=int(keep.sum()),
        chosen_in_folds=tuple(scored.chosen),
    )
