"""Case deletion: whether the answer rests on a single trial or visit.

Candidates are the trial of largest closed-form influence on the headline coefficient, those to
which a choice owes most of a narrow margin (a name over none, an optimum of its fit over another, a
rival in the set or outside), and those without which a test would turn: that for structure, or that
of what the likeliest explanation leaves. The whole diagnosis, noise and search included, is
repeated without each: the answer rests on a trial if the headline then moves by more than one
standard uncertainty, or the verdict changes. Visits are left out likewise, selected by the first
two criteria; of a small table each trial and each visit is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.loop.admission import few
from nearlift.loop.candidate_fit import Fitted, optima
from nearlift.loop.coefficients import Answers
from nearlift.loop.evidence import CREDIT
from nearlift.loop.explanation import MARGINAL
from nearlift.loop.search import PLAIN, Answer
from nearlift.results import Observations
from nearlift.results.diagnosis import RIVAL_MAX_2LNB
from nearlift.results.quotation import BoundaryResult, Doubt, RestsOn, Shift, Verdict

#: Closed-form influence below which the most influential trial is not left out, in standard
#: uncertainties of the headline.
LOOK = 0.05
#: Share of a margin of log evidence that a trial left out must contribute, the most trials, and the
#: least margin.
PART, TRIES, LEAST_MARGIN = 0.5, 3, 1e-3
#: How near its threshold a test must come without a trial, in log10 p: by so much the noise floor
#: that is estimated without it may differ.
NEAR = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Without:
    """Diagnosis without one trial or visit; `intervals` are (value, lo90, hi90) by coefficient."""

    verdict: Verdict
    effects: tuple[str, ...]
    intervals: Mapping[str, tuple[float, float, float]]


def decisive(
    answer: Answer, answers: Answers, quoted: BoundaryResult, label: NDArray[Any]
) -> tuple[Shift, ...]:
    """Trials or visits, by `label` (n,), to which a name owes its narrow margin over none, an
    optimum of its fit that over another one, or a rival its place in the set or outside: up to
    `TRIES`, those with the largest share of a margin first. Empty without a name; choices that keep
    the headline within one standard uncertainty do not count.
    """
    if not (answer.accepted and quoted.headline):
        return ()
    i, headline = answers.names.index(quoted.headline), quoted.coefficients[quoted.headline]
    stage, first = answer.stage, answer.accepted[0]
    labels, index, count = np.unique(label, return_inverse=True, return_counts=True)
    share = np.zeros(len(labels))

    def choose(one: Fitted, other: Fitted, margin: float, value: float, from_value: float) -> None:
        """Count the shares of a margin in log evidence that `one` has over the `other`."""
        if abs(value - from_value) > headline.u:
            each = np.bincount(index, 0.5 * (other.residual**2 - one.residual**2))
            np.maximum(share, each / max(margin, LEAST_MARGIN), out=share)

    fitted, enough = first.fitted, PLAIN if first.confirmed and first.by_chance else CREDIT
    margin = first.evidence.over_none - enough
    choose(fitted, stage.base_fit, margin, answers.before[0][i], headline.value)
    for other in optima(fitted.candidate, stage.space, stage.log_lift, stage.base_fit.vector):
        margin = (other.cost - fitted.cost) / 2
        choose(fitted, other, margin, other.vector[i], fitted.vector[i])
    best = max(answer.accepted, key=lambda e: e.evidence.log)
    named = {e.name for e in answer.accepted}
    for e in (*answer.singles, *answer.pairs):
        if e.possible and e.name != best.name:
            margin = RIVAL_MAX_2LNB / 2 - best.evidence.leads(e.evidence)
            pair = (e.fitted, best.fitted) if e.name in named else (best.fitted, e.fitted)
            if e.name in named or margin < 0:
                choose(*pair, abs(margin), e.fitted.vector[i], headline.value)
    where = np.bincount(index, stage.data.z_hat) / count
    return tuple(
        Shift.at(float(where[j]), str(labels[j]), 0.0)
        for j in np.argsort(-share)[:TRIES]
        if share[j] > PART
    )


def turning(answer: Answer) -> tuple[Shift, ...]:
    """Trials without which, to first order, a test turns on which the verdict rests: that for
    structure, or that of what the likeliest explanation leaves. Up to `TRIES`, those first without
    which the smallest p-value lies farthest beyond its threshold.
    """
    stage = answer.stage
    if stage.independent or not stage.hypotheses[0]:
        return ()
    tests = [(answer.first, stage.base_reading)]
    left = [(e, e.left) for e in (*answer.singles, *answer.pairs) if e.eligible and e.left]
    for e, test in sorted(left, key=lambda one: -one[0].evidence.log)[:1]:
        reading = stage.linearised(e.fitted, e.form_sd, e.wander)
        marginal = replace(test, threshold=stage.null.threshold(MARGINAL))
        tests += [(test, reading), (marginal, reading)]
    beyond = np.max(
        [
            (stage.least_without_each(reading) - test.threshold) * (1 if test.present else -1)
            for test, reading in tests
        ],
        axis=0,
    )
    return tuple(
        Shift.at(float(stage.data.z_hat[i]), str(stage.data.trial[i]), 0.0)
        for i in np.argsort(-beyond)[:TRIES]
        if beyond[i] > -NEAR
    )


def trials_to_try(answer: Answer, answers: Answers, quoted: BoundaryResult) -> tuple[Shift, ...]:
    """Trials to leave out: each one of a small table; else those that decide the name, and those
    without which a test would turn.
    """
    data = answer.stage.data
    if few(data, answer.stage.base):
        return each_of(data.trial, data)
    return (*decisive(answer, answers, quoted, data.trial), *turning(answer))


def visits_to_try(answer: Answer, answers: Answers, quoted: BoundaryResult) -> tuple[Shift, ...]:
    """Visits to leave out: each one of a small table; else those that decide the name, and the one
    that moves the headline by more than its standard uncertainty.
    """
    data = answer.stage.data
    if few(data, answer.stage.base):
        return each_of(data.visit, data)
    hangs = decisive(answer, answers, quoted, data.visit)
    hinge = quoted.hinge
    if hinge and hinge[0] == "visit" and hinge[1].id not in [one.id for one in hangs]:
        return (hinge[1], *hangs)
    return hangs


def each_of(label: NDArray[Any], data: Observations) -> tuple[Shift, ...]:
    """Every trial or visit, by `label` (n,)."""
    return tuple(
        Shift.at(float(data.z_hat[label == one].mean()), str(one), 0.0) for one in np.unique(label)
    )


def with_decisive_trial(
    quoted: BoundaryResult, without: Callable[[str], Without | None], others: Sequence[Shift] = ()
) -> BoundaryResult:
    """The result with the exact shift of the headline without its most influential trial, and
    `rests_on` if that exceeds one standard uncertainty or the verdict changes.

    `without` repeats the diagnosis without one trial, by its id, and is None where the other trials
    cannot be diagnosed; the `others` are tried, too.
    """
    name = quoted.headline
    most = quoted.coefficients[name].influence.trial if name else None
    if most is None or not np.isfinite(quoted.coefficients[name].u):
        return quoted
    headline = quoted.coefficients[name]
    foremost = [most] if abs(most.shift) >= LOOK * headline.u else []
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
        key=lambda one: (
            abs(one[2]) > headline.u or one[1].verdict != quoted.verdict,
            abs(one[2]),
        ),
    )
    value, low, high = again.intervals[name]
    influence = replace(headline.influence, trial=replace(most, shift=shift))
    coefficients = {
        **quoted.coefficients,
        name: replace(headline, influence=influence),
    }
    result = replace(quoted, coefficients=coefficients)
    if abs(shift) <= headline.u and again.verdict == quoted.verdict:
        return result
    doubt = Doubt(condition=f"trial {most.id} is left out", value=value, lo90=low, hi90=high)
    rests = RestsOn(trial=most.id, shift=shift, verdict=again.verdict, effects=again.effects)
    return replace(result, rests_on=rests).doubting({name: (doubt,)})


def with_decisive_visits(
    quoted: BoundaryResult, without: Callable[[str], Without | None], visits: Sequence[Shift]
) -> BoundaryResult:
    """The result with a doubt for each of these visits whose omission changes the verdict, and the
    exact shift of the headline without the most influential one.

    `without` repeats the diagnosis without a visit, by its label; None where the other visits
    cannot be diagnosed.
    """
    name = quoted.headline
    if not name or not np.isfinite(quoted.coefficients[name].u):
        return quoted
    headline = quoted.coefficients[name]
    tried = [
        (replace(visit, shift=float(again.intervals[name][0] - headline.value)), again)
        for visit in visits
        for again in [without(visit.id)]
        if again is not None
    ]
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
        Doubt(condition=f"visit {visit.place} is left out", value=value, lo90=low, hi90=high)
        for visit, again in turned
        for value, low, high in [again.intervals[name]]
    ]
    return replace(result, rests_on_visit=rests).doubting({name: doubts})
