"""Case deletion: whether the answer depends on a single trial or visit.

Three kinds of trials are candidates. One is that of largest closed-form influence on the headline
coefficient. The others contribute most to a narrow decision (see `influential_decisions`), or flip
a test when they are left out. The whole diagnosis, noise and search included, is repeated without
each. The repeat first tries the explanations of `search.Shortlist`, and all of them where these
name another. The answer depends on a trial if the headline then moves by more than one standard
uncertainty, or the verdict changes. Visits are selected by the first two criteria. Each trial and
each visit of a small table is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.likelihood import student
from nearlift.loop import structure, weigh
from nearlift.loop.admission import is_small_table
from nearlift.loop.candidate_fit import Fitted, optima
from nearlift.loop.evidence import CREDIT, Explanation, LinearFit
from nearlift.loop.search import Answer
from nearlift.loop.search_problem import SearchProblem
from nearlift.results import Observations
from nearlift.results.quotation import BoundaryResult, Doubt, RestsOn, Shift, Verdict
from nearlift.rounding import plain

#: Closed-form influence below which the most influential trial is not left out, in standard
#: uncertainties of the headline.
LEAST_SHIFT = 0.05
#: Share of a margin of log evidence that a trial left out must contribute, the most trials, and the
#: least margin.
PART, TRIES, LEAST_MARGIN = 0.5, 3, 1e-3
#: How near its threshold a test must come without a trial, in log10 p: by so much the noise floor
#: that is estimated without it may differ.
NEAR = 0.1
#: Standardised shift beyond which a visit contradicts the rest, and the least standard deviation of
#: a shift, in standard uncertainties of the headline.
CONTRADICTS, LEAST_SPREAD = 2.0, 0.1
#: A fit that was preferred to another, and by how much in log evidence.
Choice = tuple[Fitted, Fitted, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Without:
    """Diagnosis without one trial or visit.

    `intervals` are (value, lo90, hi90) by coefficient. `widths` are those of the 90 % intervals
    before they are cut at a bound.
    """

    verdict: Verdict
    effects: tuple[str, ...]
    intervals: Mapping[str, tuple[float, float, float]]
    widths: Mapping[str, float]


def likeliest(answer: Answer) -> Explanation | None:
    """The explanation that comes first, as it was tried, or else the likeliest of those that
    nothing forbids to name.
    """
    if answer.accepted:
        first = answer.accepted[0]
        return next((e for e in answer.tried if e.name == first.name), first)
    eligible = (e for e in answer.tried if e.eligible)
    return max(eligible, key=lambda e: e.log_evidence, default=None)


def influential_decisions(answer: Answer, quoted: BoundaryResult) -> list[Choice]:
    """Decisions of the search that influence the headline, each with its margin of log evidence.

    One is whether an effect is named. The others are the choice of optimum and of rivals, if the
    headline moves by more than its standard uncertainty.
    """
    first, problem = likeliest(answer), answer.problem
    if first is None or not quoted.headline:
        return []
    headline = quoted.coefficients[quoted.headline]
    i = [p.name for p in problem.base.parameters].index(quoted.headline)
    fitted, margin = first.fitted, first.over_none - CREDIT
    if not answer.accepted:
        return [(problem.base_fit, fitted, -margin)] if margin < 0 else []
    # where visits are few, those left out decide, and no evidence
    chosen = [] if problem.independent else [(fitted, problem.base_fit, margin)]
    for other in optima(fitted.candidate, problem.starts, problem.log_lift):
        if abs(other.vector[i] - fitted.vector[i]) > headline.u and np.isfinite(other.cost):
            chosen.append((fitted, other, (other.cost - fitted.cost) / 2))
    log_weight = weigh.log_weights(problem, answer.allowed)
    for j, e in enumerate(answer.allowed):
        far = abs(e.fitted.vector[i] - headline.value) > headline.u
        if far and e.effects != first.effects:
            within = weigh.membership_margin(log_weight, j)
            chosen.append((e.fitted, fitted, within) if within > 0 else (fitted, e.fitted, -within))
    return chosen


def influential_trials(
    answer: Answer, quoted: BoundaryResult, label: NDArray[Any]
) -> tuple[Shift, ...]:
    """Trials or visits, by `label` (n,), that contribute most to an influential decision.

    Up to `TRIES`, those with the largest share of a margin first.
    """
    chosen = influential_decisions(answer, quoted)
    if not chosen:
        return ()
    labels, index = np.unique(label, return_inverse=True)
    share, order = np.zeros(len(labels)), answer.problem.space.covariance.order
    for one, other, margin in chosen:
        each = np.bincount(index[order], 0.5 * (other.residual**2 - one.residual**2))
        np.maximum(share, each / max(margin, LEAST_MARGIN), out=share)
    most = np.argsort(-share)[:TRIES]
    return _shifts(answer.problem.data, label, labels[most[share[most] > PART]])


def trials_flipping_a_test(answer: Answer) -> tuple[Shift, ...]:
    """Trials without which a test would turn, to first order.

    The tests are that for structure and the lack-of-fit test of the likeliest explanation. Up to
    `TRIES`, those first without which the smallest p-value is farthest beyond its threshold.
    """
    problem = answer.problem
    if problem.independent or not problem.hypotheses[0]:
        return ()
    tests = [(problem.base_linear_fit, answer.first)]
    first = likeliest(answer)
    if first and first.left:
        linear_fit = problem.linearised(first.fitted, first.form_sd, first.random_walk_gain)
        tests.append((linear_fit, first.left))
    beyond = np.max(
        [
            (_least_without_each(problem, linear_fit) - test.threshold) * (2 * test.present - 1)
            for linear_fit, test in tests
        ],
        axis=0,
    )
    most = np.argsort(-beyond)[:TRIES]
    trial = problem.data.trial
    decisive = problem.space.covariance.order[most[beyond[most] > -NEAR]]
    return _shifts(problem.data, trial, trial[decisive])


def _least_without_each(problem: SearchProblem, linear_fit: LinearFit) -> FloatArray:
    """Smallest log10 p of all tests on a linear fit's residuals without each trial, (n,), to first
    order.
    """
    left = linear_fit.left
    hypotheses = structure.mapped(problem.hypotheses[0], left.whiten)
    _, stacked, ranks = structure.bases(hypotheses, left.removed)
    each = left.deform(np.hstack(linear_fit.basis).T * linear_fit.fitted.residual)
    return structure.least_log10_p((left.scores - each).T, stacked, ranks)


def trials_to_try(answer: Answer, quoted: BoundaryResult) -> tuple[Shift, ...]:
    """Trials to leave out: each one of a small table; else those that decide the name, and those
    without which a test would turn.
    """
    data = answer.problem.data
    if is_small_table(data, answer.problem.base):
        return _shifts(data, data.trial, np.unique(data.trial))
    return (*influential_trials(answer, quoted, data.trial), *trials_flipping_a_test(answer))


def visits_to_try(answer: Answer, quoted: BoundaryResult) -> tuple[Shift, ...]:
    """Visits to leave out: each one of a small table, else the influential ones.

    These decide the name, or move the headline by more than its standard uncertainty.
    """
    data = answer.problem.data
    if is_small_table(data, answer.problem.base):
        return _shifts(data, data.visit, np.unique(data.visit))
    influential = influential_trials(answer, quoted, data.visit)
    most = quoted.most_influential
    if most and most[0] == "visit" and most[1].id not in [one.id for one in influential]:
        return (most[1], *influential)
    return influential


def _shifts(data: Observations, label: NDArray[Any], wanted: NDArray[Any]) -> tuple[Shift, ...]:
    """The `wanted` trials or visits, by `label` (n,), with an unknown shift."""
    return tuple(Shift.at(float(data.z_hat[label == one].mean()), str(one), 0.0) for one in wanted)


def with_decisive_trial(
    quoted: BoundaryResult, without: Callable[[str], Without | None], others: Sequence[Shift] = ()
) -> BoundaryResult:
    """The result with the exact shift of the headline without its most influential trial.

    `rests_on` is set if that exceeds one standard uncertainty or the verdict changes. `without`
    repeats the diagnosis without one trial, by its id; None where the other trials cannot be
    diagnosed. The `others` are tried, too.
    """
    name = quoted.headline
    most = quoted.coefficients[name].influence.trial if name else None
    if most is None or not np.isfinite(quoted.coefficients[name].u):
        return quoted
    headline = quoted.coefficients[name]
    foremost = [most] if abs(most.shift) >= LEAST_SHIFT * headline.u else []
    tried = [
        (one, again, again.intervals[name][0] - headline.value)
        for one in {one.id: one for one in (*foremost, *others)}.values()
        for again in [without(one.id)]
        if again is not None
    ]
    if not tried:
        return quoted
    most, again, shift = max(
        tried,
        key=lambda one: (abs(one[2]) > headline.u or one[1].verdict != quoted.verdict, abs(one[2])),
    )
    value, low, high = again.intervals[name]
    influence = replace(headline.influence, trial=replace(most, shift=shift))
    coefficients = {**quoted.coefficients, name: replace(headline, influence=influence)}
    result = replace(quoted, coefficients=coefficients)
    if abs(shift) <= headline.u and again.verdict == quoted.verdict:
        return result
    doubt = Doubt(condition=f"without trial {most.id}", value=value, lo90=low, hi90=high)
    rests = RestsOn(trial=most.id, shift=shift, verdict=again.verdict, effects=again.effects)
    return replace(result, rests_on=rests).doubting({name: (doubt,)})


def without_visits(
    answer: Answer,
    quoted: BoundaryResult,
    without: Callable[[str], Without | None],
    visits: Sequence[Shift],
) -> list[tuple[Shift, Without]]:
    """Each visit with the exact shift of the headline and the diagnosis without it.

    `without` repeats the diagnosis without a visit, by its label. Visits without which the others
    cannot be diagnosed, for which it is None, are missing.
    """
    name = quoted.headline
    if not name or not np.isfinite(quoted.coefficients[name].u):
        return []
    c, tried, problem, fitted = quoted.coefficients[name], [], answer.problem, answer.best
    i = [p.name for p in problem.base.parameters].index(name)
    gain = fitted.information().gain[i]
    for visit in visits:
        again = without(visit.id)
        if again is None:
            continue
        # the variance of a difference from an efficient estimate is the difference of variances
        # (Hausman 1978, Econometrica 46, 1251); half of a 90 % interval is in proportion to u
        half = student.quantile(0.95, c.dof) * c.u
        spread = c.u * np.sqrt(max((again.widths[name] / (2 * half)) ** 2 - 1, LEAST_SPREAD**2))
        shift = again.intervals[name][0] - c.value
        a_mm = 1e-3 * problem.slope * (problem.data.visit.astype(str) == visit.id)
        moved = replace(
            visit,
            shift=float(shift),
            standardised=float(abs(shift) / spread) if again.verdict == quoted.verdict else None,
            shift_per_mm=float(gain @ a_mm),
        )
        tried.append((moved, again))
    return tried


def contradicting(quoted: BoundaryResult, tried: Sequence[tuple[Shift, Without]]) -> list[str]:
    """Visits that contradict the rest, in words: without one the headline moves by more than its
    standard uncertainty, and by more than chance.
    """
    return [
        f"visit {visit.place} contradicts the rest: without it {quoted.headline} moves by"
        f" {plain(visit.shift, 2)}, {plain(visit.standardised or 0.0, 2)} standard deviations"
        for visit, _ in tried
        if abs(visit.shift) > quoted.coefficients[quoted.headline].u
        and (visit.standardised or 0.0) > CONTRADICTS
    ]


def with_decisive_visits(
    quoted: BoundaryResult, tried: Sequence[tuple[Shift, Without]]
) -> BoundaryResult:
    """The result with a doubt for each of the `tried` visits whose omission changes the verdict.

    It also has the exact shift of the headline without the most influential one.
    """
    if not tried:
        return quoted
    name = quoted.headline
    headline = quoted.coefficients[name]
    most = headline.influence.visit
    if most is not None and most.id in [visit.id for visit, _ in tried]:
        moved = max((visit for visit, _ in tried), key=lambda visit: abs(visit.shift))
        headline = replace(headline, influence=replace(headline.influence, visit=moved))
    result = replace(quoted, coefficients={**quoted.coefficients, name: headline})
    turned = [one for one in tried if one[1].verdict != quoted.verdict]
    if not turned:
        return result
    visit, again = max(turned, key=lambda one: abs(one[0].shift))
    rests = RestsOn(
        visit=visit.id,
        z_hat=visit.z_hat,
        shift=visit.shift,
        verdict=again.verdict,
        effects=again.effects,
    )
    doubts = [
        Doubt(condition=f"without visit {visit.place}", value=value, lo90=low, hi90=high)
        for visit, again in turned
        for value, low, high in [again.intervals[name]]
    ]
    return replace(result, rests_on_visit=rests).doubting({name: doubts})
