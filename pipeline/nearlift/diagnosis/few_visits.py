"""Campaigns of few, long visits (a handful of throttle sweeps): candidates are ranked by what they predict of a visit left out.

The ordinary search asks whether an explanation leaves nothing beyond the noise floor. With few visits that floor cannot be known: how
well a whole visit repeats shows only between visits, where smooth families in time take up every degree of freedom there is.
Nor can the correlation within a visit: a marginal likelihood then mostly judges the noise model. So trials are fitted as if
independent, which is right on average whatever their correlation (working independence), uncertainties come from leaving out
whole visits (jackknife), and a candidate is accepted for what it predicts of visits that it has not seen. One that gives every
visit its own level predicts nothing there, and can never be accepted. See docs/decisions/0005-few-visits.md.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray
from nearlift.diagnosis import coefficients, noise_floor
from nearlift.diagnosis.candidate import Candidate, Fitted, fit, search
from nearlift.diagnosis.confirmation import FEW_VISITS, predict, standard_error
from nearlift.diagnosis.search import RIVAL, SILENT, Answer, Explanation, Stage, visibility
from nearlift.results import Observations

#: With fewer, nothing can be accepted.
LEAST_VISITS = 4
#: An explanation must account for this share of the squared error that is not noise: a small help is no explanation.
GREATER_PART = 0.5
#: Chance, for one candidate, of a gain over visits as large as what is asked for.
CHANCE = 0.05
MOST_EFFECTS = 2


def applies(data: Observations) -> bool:
    """Whether the visits are so few that they must be left out in turn."""
    return len(np.unique(data.visit)) <= FEW_VISITS


def choose(stage: Stage) -> Answer:
    """`run` without the listing, for folds."""
    return run(stage, listed=False)


def left_out(stage: Stage, effects: tuple[Effect, ...], parts: list[tuple[Stage, NDArray[np.bool_]]]) -> FloatArray:
    """Relative residual of every trial, predicted by a fit to the other visits; nan where that is impossible."""
    result = np.full(stage.data.n, np.nan)
    truth = np.log(stage.data.lift_N)
    start = search(stage.candidate(*effects), stage.space, stage.log_lift, stage.base_fit.vector).vector if effects else stage.theta
    for part, test in parts:
        known = test & np.isin(stage.data.throttle, part.data.throttle)
        candidate = part.candidate(*effects)
        # one visit less hardly moves the fit, so the whole's is the place to start; a vector without the last session is another vector
        if candidate.size == len(start):
            fitted = fit(candidate, part.space, part.log_lift, start)
        else:
            fitted = search(candidate, part.space, part.log_lift, part.base_fit.vector)
        result[known] = truth[known] - predict(part, fitted, stage.data.take(known))
    return result


def _without_each(stage: Stage) -> list[tuple[Stage, NDArray[np.bool_]]]:
    found = []
    for v in np.unique(stage.data.visit):
        test = stage.data.visit == v
        found.append((dataclasses.replace(stage, data=stage.data.take(~test), log_lift=stage.log_lift[~test]), test))
    return found


def by_visit(stage: Stage, residual: FloatArray) -> FloatArray:
    """Sum of squared residuals of each visit that could be predicted; infinite if a prediction failed."""
    _, label = np.unique(stage.data.visit, return_inverse=True)
    result: FloatArray = np.bincount(label, np.where(np.isfinite(residual), residual, np.inf) ** 2).astype(float)
    return result


def convinces(before: FloatArray, after: FloatArray, noise: float) -> bool:
    """Whether the sums of squares by visit fall by more than chance would let them, and by most of what is not `noise` (their total)."""
    from scipy.stats import t

    gained = before - after
    blocks = len(gained)
    if blocks < LEAST_VISITS - 1 or not np.isfinite(gained).all():
        return False
    error = np.sqrt(blocks) * gained.std(ddof=1)
    sure = gained.sum() > float(t.ppf(1 - CHANCE, blocks - 1)) * error
    return bool(sure and gained.sum() >= GREATER_PART * (before.sum() - noise))


def run(stage: Stage, listed: bool = True) -> Answer:
    """Test for structure, then add what predicts visits left out best, one effect at a time.

    With `listed`, each candidate is also tested for what it leaves; that decides nothing here.
    """
    first = stage.nothing_added[0]
    working = dataclasses.replace(stage, independent=True)
    if not first.present:
        return Answer(stage=working, first=first, singles=(), pairs=(), accepted=())
    visible = list({e.name: e for e, _ in working.library if visibility(working, e) > SILENT}.values())
    noise = stage.data.n * noise_floor.floor(stage.data, stage.noise, stage.slope) ** 2
    parts = _without_each(working)
    none = by_visit(working, left_out(working, (), parts))
    best: tuple[Effect, ...] = ()
    to_beat = none
    rounds: list[tuple[Explanation, ...]] = []
    while len(best) < MOST_EFFECTS:
        tried, errors = [], {}
        for effect in (e for e in visible if e not in best):
            squares = by_visit(working, left_out(working, (*best, effect), parts))
            explanation = _explanation(working, (*best, effect), none, squares, convinces(to_beat, squares, noise), listed)
            tried.append(explanation)
            errors[explanation.name] = squares
        rounds.append(tuple(tried))
        accepted = [e for e in tried if e.accepted]
        if not accepted:
            break
        leader = max(accepted, key=lambda e: e.log_evidence)
        best, to_beat = leader.fitted.candidate.effects, errors[leader.name]
    singles = rounds[0] if rounds else ()
    pairs = rounds[1] if len(rounds) > 1 else ()
    accepted = [e for e in pairs if e.accepted] or [e for e in singles if e.accepted]
    most = max((e.log_evidence for e in accepted), default=0.0)
    rivals = tuple(sorted((e for e in accepted if 2 * (most - e.log_evidence) <= RIVAL), key=lambda e: -e.plausibility))
    return Answer(stage=working, first=first, singles=singles, pairs=pairs, accepted=rivals)


def _explanation(stage: Stage, effects: tuple[Effect, ...], none: FloatArray, squares: FloatArray, confirmed: bool, listed: bool) -> Explanation:
    """The fit to all visits, its evidence the log score on visits left out, each visit counted as one observation."""
    total = squares.sum()
    score = 0.5 * len(squares) * float(np.log(none.sum() / total)) if np.isfinite(total) else -np.inf
    fitted = search(stage.candidate(*effects), stage.space, stage.log_lift, stage.base_fit.vector)
    tube = np.zeros((stage.data.n, 0))
    left = stage.structure(fitted, tube, stage.options.second_rate, 1)[0] if listed else stage.nothing_added[0]
    gain = stage.base_fit.chi2 - fitted.chi2
    return Explanation(fitted=fitted, tube=tube, left=left, gain=gain, log_evidence=score, over_none=score, plausibility=score, confirmed=confirmed)


def jackknife(stage: Stage, fitted: Fitted) -> FloatArray:
    """The fit's vector without each visit in turn, (visits, P)."""
    candidate = fitted.candidate
    rows = []
    for part, _ in _without_each(stage):
        without = Candidate(base=stage.base, effects=candidate.effects, data=part.data, session_spread=candidate.session_spread)
        # a session that is left out keeps its place in the vector only if it is not the last
        if without.size == candidate.size:
            rows.append(fit(without, part.space, part.log_lift, fitted.vector).vector)
    return np.array(rows).reshape(-1, candidate.size)


def quantile(stage: Stage) -> float:
    """Student's t for a two-sided 90 % interval, visits being the observations."""
    from scipy.stats import t

    return float(t.ppf(0.95, max(len(np.unique(stage.data.visit)) - 1, 1)))


def before_and_after(stage: Stage, answer: Answer, declared: dict[str, float]) -> dict[str, Any]:
    """The `coefficients` block of diagnosis.json, every uncertainty from visits left out."""
    p = len(stage.theta)
    k = quantile(stage)
    names = [q.name for q in stage.base.parameters]
    value, u = stage.base_fit.vector[:p], standard_error(jackknife(stage, stage.base_fit))[:p]
    before = {n: {"value": v, "lo90": v - k * s, "hi90": v + k * s} for n, v, s in zip(names, value, u, strict=True)}
    members = [e.fitted for e in answer.accepted] or [stage.base_fit]
    spans = [(f.vector[:p], standard_error(jackknife(stage, f))[:p]) for f in members]
    chosen = answer.accepted[0].effects if answer.accepted else ()
    nuisance = coefficients.constrained_columns(stage, chosen, declared)
    _, naive = coefficients.spread(stage, members[0])
    _, wide = coefficients.spread(stage, members[0], nuisance)
    value, u = spans[0]
    after = {}
    for i, name in enumerate(names):
        # what undetected effects add to the variance comes on top of what visits show
        total = float(np.sqrt(u[i] ** 2 + max(wide[i] ** 2 - naive[i] ** 2, 0.0)))
        after[name] = {
            "value": value[i],
            "lo90": min(v[i] - k * s[i] for v, s in spans),
            "hi90": max(v[i] + k * s[i] for v, s in spans),
            "conditional": [value[i] - k * u[i], value[i] + k * u[i]],
            "constrained": [value[i] - k * total, value[i] + k * total],
        }
    return {"before": before, "after": after}
