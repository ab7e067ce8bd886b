"""Leave-one-visit-out selection of effects, for campaigns of few, long visits (throttle sweeps).

They identify neither the noise floor, which shows only between visits, nor the correlation within a
visit. Trials are therefore fitted as if independent, which is consistent whatever their correlation
(working independence). Uncertainties are jackknifed over visits. A candidate is accepted for its
prediction of visits left out. A gain per visit predicts nothing there and can never be accepted.
See docs/decisions.md#few-visits.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray
from nearlift.likelihood import noise
from nearlift.likelihood.problem import where_finite
from nearlift.loop import weigh
from nearlift.loop.candidate_fit import Fitted, minima
from nearlift.loop.confirmation import FEW_VISITS
from nearlift.loop.evidence import Explanation
from nearlift.loop.search import Answer
from nearlift.loop.search_problem import SearchProblem
from nearlift.results import IntArray, Observations

#: Fewest visits: `gain_is_significant` needs three, and each fold lacks one.
MIN_VISITS = 4
#: Least share of the squared error beyond noise that an accepted explanation removes.
GREATER_PART = 0.5
#: Significance level of the one-sided test of one candidate's gain over visits.
CHANCE = 0.05
#: Most effects of an explanation.
MOST_EFFECTS = 2


def visits_are_few(data: Observations) -> bool:
    """Whether visits are few enough to be left out in turn; not where the run order is unknown."""
    return data.ordered and len(np.unique(data.visit)) <= FEW_VISITS


def freedom(problem: SearchProblem, fitted: Fitted) -> FloatArray:
    """Satterthwaite's degrees of freedom of the jackknife over visits, (P,), at least 1.

    A coefficient that one visit determines has hardly more than one, however many visits there are
    (Bell and McCaffrey 2002, Survey Methodology 28, 169). The noise floor is taken as the noise,
    and the fit as linear.
    """
    _, weight = _weights(problem)
    levels = problem.data.level_design
    columns = np.hstack([levels, fitted.candidate.jacobian(fitted.vector)])
    prior = np.r_[np.zeros(levels.shape[1]), fitted.candidate.prior[1] ** -2.0]
    weighted = columns.T * weight[:, None]
    # estimates without each visit about their mean, as functions of log lift, (P, visits, n)
    known = np.linalg.pinv(weighted @ columns + np.diag(prior), rcond=1e-13, hermitian=True)
    each = (known @ weighted)[:, levels.shape[1] :].swapaxes(0, 1)
    each = each - each.mean(axis=1, keepdims=True)
    noise = problem.correlated.space.covariance
    within = (weight == 0).T
    by_visit = [(each * size) @ within for size in (noise.per_visit, noise.common)]
    of_trial = each * np.sqrt(noise.variance)
    errors = np.concatenate([of_trial, *by_visit, each @ noise.shared], axis=2)
    squares = np.linalg.svd(errors, compute_uv=False) ** 2
    with np.errstate(invalid="ignore"):
        dof = squares.sum(axis=1) ** 2 / np.sum(squares**2, axis=1)
    return np.asarray(np.maximum(np.nan_to_num(dof), 1.0))


def left_out(problem: SearchProblem, whole: Fitted) -> FloatArray:
    """Relative residual (n,) of every trial, predicted by a fit to the other visits; nan where
    these do not determine its L_inf.
    """
    visit, weight = _weights(problem)
    rest = problem.log_lift - whole.candidate.log_ratio(without_each(problem, whole))
    log_inf = _levels(problem, weight)(rest[:, None], np.arange(len(rest)))[:, 0]
    trial = np.arange(problem.data.n)
    predictable = [problem.data.level_known_from(visit != one) for one in range(len(rest))]
    return np.where(np.array(predictable)[visit, trial], (rest - log_inf)[visit, trial], np.nan)


def without_each(problem: SearchProblem, whole: Fitted) -> FloatArray:
    """Fitted vectors without each visit in turn, (visits, P), all refitted at once from the whole
    fit.

    The trials of the visit left out have weight zero. Parameters of a session without any other
    visit then take their prior's value.
    """
    _, weight = _weights(problem)
    root, levels = np.sqrt(weight)[:, None], _levels(problem, weight)
    return minima(
        whole.candidate,
        problem.log_lift,
        np.tile(whole.vector, (len(weight), 1)),
        lambda x, rows: (x - levels(x, rows)) * root[rows],
    )


def _weights(problem: SearchProblem) -> tuple[IntArray, FloatArray]:
    """The index of each trial's visit, (n,), and the inverse variance of each trial, 0 in the visit
    left out, (visits, n).
    """
    visits, visit = np.unique(problem.data.visit, return_inverse=True)
    mine = visit == np.arange(len(visits))[:, None]
    return visit, np.where(mine, 0.0, 1 / problem.space.covariance.variance)


def _levels(
    problem: SearchProblem, weight: FloatArray
) -> Callable[[FloatArray, IntArray], FloatArray]:
    """Weighted least squares of log L_inf, as a function of log lift (k, c, n) and of rows (k,) of
    `weight` (visits, n).
    """
    columns = problem.data.level_design
    weighted = columns * weight[:, :, None]
    # a level that no weighted trial determines, as of a throttle in one visit alone, stays 0
    solve = weighted @ np.linalg.pinv(columns.T @ weighted, rcond=1e-13, hermitian=True)
    return lambda x, rows: where_finite(lambda x: x @ solve[rows] @ columns.T, x)


def by_visit(
    problem: SearchProblem, residual: FloatArray, predictable: NDArray[np.bool_]
) -> FloatArray:
    """Sum of squared residuals of each visit over the trials that other visits predict, infinite
    where one of these has none.
    """
    _, label = np.unique(problem.data.visit, return_inverse=True)
    counted = np.where(predictable, np.where(np.isfinite(residual), residual, np.inf), 0.0)
    return np.bincount(label, counted**2).astype(float)


def gain_is_significant(before: FloatArray, after: FloatArray, noise: float) -> bool:
    """Whether the sums of squares by visit fall significantly, and by most of their excess.

    The test is a paired t test at level `CHANCE`. The fall must be `GREATER_PART` of the excess of
    `before` over `noise`, its total under the null.
    """
    from scipy.stats import t

    gained = before - after
    blocks = len(gained)
    if blocks < MIN_VISITS - 1 or not np.isfinite(gained).all():
        return False
    error = np.sqrt(blocks) * gained.std(ddof=1)
    sure = gained.sum() > float(t.ppf(1 - CHANCE, blocks - 1)) * error
    return bool(sure and gained.sum() >= GREATER_PART * (before.sum() - noise))


def run(problem: SearchProblem) -> Answer:
    """Test for structure, then forward selection of effects by their error on visits left out."""
    first = problem.nothing_added[0]
    working = dataclasses.replace(problem, independent=True)
    if not first.present:
        return Answer(problem=working, first=first)
    alone = left_out(working, working.base_fit)
    # without its visit a trial may have no L_inf, whatever the effect
    predictable = np.isfinite(alone)
    scatter = predictable.sum() * noise.floor(problem.data, problem.noise, problem.slope) ** 2
    none = to_beat = by_visit(working, alone, predictable)
    best: tuple[Effect, ...] = ()
    rounds: list[list[Explanation]] = [[], []]
    for tried in rounds[:MOST_EFFECTS]:
        errors = {}
        for effect in (e for e in working.visible if e not in best):
            fitted = working.best_fit(*best, effect)
            squares = by_visit(working, left_out(working, fitted), predictable)
            errors[effect.name] = squares
            # the log score on visits left out, each one observation
            finite, total = np.isfinite(squares.sum()), squares.sum()
            score = 0.5 * len(squares) * float(np.log(none.sum() / total)) if finite else -np.inf
            tried.append(
                Explanation(
                    fitted=fitted,
                    form_sd=0.0,
                    gain=working.base_fit.chi2 - fitted.chi2,
                    exact=score,
                    discrepant=score,
                    confirmed=gain_is_significant(to_beat, squares, scatter),
                )
            )
        leader = max((e for e in tried if e.accepted), key=lambda e: e.log_evidence, default=None)
        if leader is None:
            break
        best = leader.fitted.candidate.effects
        to_beat = errors[best[-1].name]
    singles, pairs = map(tuple, rounds)
    accepted = [e for e in pairs if e.accepted] or [e for e in singles if e.accepted]
    return Answer(
        problem=working,
        first=first,
        singles=singles,
        pairs=pairs,
        allowed=tuple(e for e in (*singles, *pairs) if e.may_be_named),
        accepted=weigh.credible_set(working, accepted),
    )
