"""Whether the answer rests on a single trial or visit.

The closed form says which trial moves the headline most, and the residuals on which ones a name
hangs that is hardly earned; the whole diagnosis made again without it, noise, search and all, says
how far the headline moves and whether anything else would be said. Where that is more than one
standard uncertainty, or another verdict, the answer rests on the trial. Visits are left out
likewise, of a small table each, else those to which the same signs point.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.loop.admission import few
from nearlift.loop.coefficients import Answers
from nearlift.loop.evidence import CREDIT
from nearlift.loop.search import Answer
from nearlift.results.quotation import BoundaryResult, Doubt, RestsOn, Shift, Verdict

#: No trial is left out if the closed form says that none moves the headline by this part of its
#: standard uncertainty.
LOOK = 0.05
#: Left out are so many trials on each of which at least this part of a name's margin hangs.
PART, TRIES = 0.5, 3
#: The median of a squared normal deviate.
MEDIAN = 0.455


@dataclass(frozen=True, slots=True, kw_only=True)
class Without:
    """What a campaign without one trial comes to: `intervals` are value, lo90 and hi90 by
    coefficient.
    """

    verdict: Verdict
    effects: tuple[str, ...]
    intervals: Mapping[str, tuple[float, float, float]]


def tipping(
    margin: float, before: FloatArray, after: FloatArray, label: NDArray[Any], z_hat: FloatArray
) -> tuple[Shift, ...]:
    """The trials or visits on which a name hangs, the foremost first: of their share in its log
    evidence.

    `margin` is what the evidence exceeds the least by that earns a name; `before` and `after` (n,)
    are the residuals without and with it, `label` (n,) the trials or their visits, `z_hat` (n,)
    where they stood.
    """
    gain = 0.5 * (before**2 - after**2) * MEDIAN / np.median(after**2)
    labels, index, count = np.unique(label, return_inverse=True, return_counts=True)
    each = np.bincount(index, gain)
    where = np.bincount(index, z_hat) / count
    foremost = np.argsort(-each)[:TRIES]
    return tuple(
        Shift.at(float(where[i]), str(labels[i]), 0.0) for i in foremost if each[i] > PART * margin
    )


def hanging(
    answer: Answer,
    answers: Answers,
    quoted: BoundaryResult,
    residuals: Mapping[str, NDArray[Any]],
    label: NDArray[Any],
) -> tuple[Shift, ...]:
    """The trials, or the visits, on which the name hangs, where the headline without a name would
    be another; `label` (n,) is that of each trial.
    """
    if not (answer.accepted and quoted.headline):
        return ()
    i, headline = answers.names.index(quoted.headline), quoted.coefficients[quoted.headline]
    if not abs(answers.before[0][i] - headline.value) > headline.u:
        return ()
    return tipping(
        answer.accepted[0].evidence.over_none - CREDIT,
        residuals["before"],
        residuals["after"],
        label,
        answer.stage.data.z_hat,
    )


def visits_to_try(
    answer: Answer,
    answers: Answers,
    quoted: BoundaryResult,
    residuals: Mapping[str, NDArray[Any]],
) -> tuple[Shift, ...]:
    """The visits to be left out: of a small table each; else those on which the name hangs, and the
    one that moves the headline by more than its standard uncertainty.
    """
    data = answer.stage.data
    if few(data, answer.stage.base):
        return tuple(
            Shift.at(float(data.z_hat[data.visit == label].mean()), str(label), 0.0)
            for label in np.unique(data.visit)
        )
    hangs = hanging(answer, answers, quoted, residuals, data.visit)
    hinge = quoted.hinge
    if hinge and hinge[0] == "visit" and hinge[1].id not in [one.id for one in hangs]:
        return (hinge[1], *hangs)
    return hangs


def told(
    quoted: BoundaryResult, without: Callable[[str], Without], others: Sequence[Shift] = ()
) -> BoundaryResult:
    """The result with the headline's largest shift by a single trial made exact, and where the
    answer rests on that trial, saying so.

    `without` makes the diagnosis again without one trial, by its id; besides the trial of the
    largest influence the `others` are tried.
    """
    name = quoted.headline
    most = quoted.coefficients[name].influence.trial if name else None
    if most is None or not np.isfinite(quoted.coefficients[name].u):
        return quoted
    headline = quoted.coefficients[name]
    tried = [
        (one, again, again.intervals[name][0] - headline.value)
        for one in (*([most] if abs(most.shift) >= LOOK * headline.u else []), *others)
        for again in [without(one.id)]
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


def told_of_visits(
    quoted: BoundaryResult, without: Callable[[str], Without | None], visits: Sequence[Shift]
) -> BoundaryResult:
    """The result with what it would be without each of these visits that turns the verdict, and
    the largest shift by one of them made exact.

    `without` makes the diagnosis again without a visit, by its label; None where the others cannot
    be diagnosed.
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
