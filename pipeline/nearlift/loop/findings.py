"""Findings of a search, as diagnosis.json holds them: effects with their rivals, structure, and
every round with its reasons.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from nearlift.likelihood import student
from nearlift.loop import few_visits
from nearlift.loop.coefficients import Answers
from nearlift.loop.explanation import Explanation
from nearlift.loop.search import Answer
from nearlift.loop.search_problem import SearchProblem
from nearlift.results.diagnosis import (
    AcceptedExplanation,
    LoopEstimate,
    LoopRound,
    NamedEffect,
    PartialEffect,
    StructureTest,
    TriedCandidate,
)
from nearlift.results.estimate import Estimate
from nearlift.results.fit import ParameterCovariance
from nearlift.rounding import plain

#: Share of the structure's excess chi2 from which an effect refused at a bound is reported.
FAIR_SHARE = 0.5
#: Most pairs that a round lists, the likeliest.
LISTED_PAIRS = 12


def structure_tests(answer: Answer) -> tuple[StructureTest, ...]:
    """Most significant test of structure along each covariate."""
    return tuple(
        StructureTest(
            covariate=c,
            family=family,
            p_value=float(10.0 ** max(p, -300.0)),
            significant=bool(p < answer.first.threshold),
        )
        for c, (p, family) in answer.first.foremost().items()
    )


def accepted_explanation(answer: Answer, answers: Answers) -> AcceptedExplanation | None:
    """The best explanation by itself, as fitted; None where none is accepted.

    Parameters that differ by session have an entry for each, as "name[0]".
    """
    if not answer.accepted:
        return None
    fitted, p = answer.best, len(answers.names)
    u = np.sqrt(np.maximum(np.diag(answers.covariance), 0.0))
    problem = answer.problem
    further = few_visits.freedom(problem) if problem.independent else np.inf
    dof = np.concatenate([answers.dof, np.full(len(u) - p, further)])
    parameters = {}
    for slot in fitted.candidate.slots:
        name, unit = slot.parameter.name, slot.parameter.unit
        for i in range(slot.start, slot.stop):
            key = name if slot.stop - slot.start == 1 else f"{name}[{i - slot.start}]"
            half = student.quantile(0.95, float(dof[i])) * u[i]
            v = float(fitted.vector[i])
            parameters[key] = Estimate(value=v, lo90=v - half, hi90=v + half, u=u[i], unit=unit)
    return AcceptedExplanation(
        effects=answer.accepted[0].effects,
        probability=answer.probability,
        parameters=parameters,
        covariance=ParameterCovariance.named(
            parameters, answers.covariance if problem.independent else fitted.covariance
        ),
    )


def named_effects(answer: Answer, accepted: AcceptedExplanation | None) -> tuple[NamedEffect, ...]:
    """Effects of the best explanation, each with the rivals that could take its place."""
    if accepted is None:
        return ()
    best, candidate = answer.accepted[0], answer.best.candidate
    entries = [*accepted.parameters.items()]
    listed = []
    for effect in candidate.effects:
        others_kept = set(best.effects) - {effect.name}
        rivals = []
        for other in answer.accepted[1:]:
            shared = set(best.effects) & set(other.effects)
            # an explanation of the same length replaces what it does not share; a longer one shows
            # what may act besides
            if len(other.effects) > len(best.effects) or others_kept & shared or not shared:
                rivals += [name for name in other.effects if name not in best.effects]
        listed.append(
            NamedEffect(
                name=effect.name,
                rivals=tuple(dict.fromkeys(rivals)),
                parameters={
                    name: LoopEstimate(value=e.value, lo90=e.lo90, hi90=e.hi90, unit=e.unit)
                    for name, e in (entries[i] for i in candidate.entries_of(effect.name))
                },
                mechanism=effect.mechanism,
            )
        )
    return tuple(listed)


def partial(problem: SearchProblem, answer: Answer) -> tuple[PartialEffect, ...]:
    """Shares of the structure's excess chi2 that the best single effects would explain."""
    # a size at a bound earns no share
    ranked = sorted((s for s in answer.singles if not s.fitted.at_bound), key=lambda s: -s.gain)[:3]
    # by chance the excess may be less than one effect's gain
    whole = max(problem.excess, *(s.gain for s in ranked), 0.0)
    return tuple(
        PartialEffect(name=s.name, share=s.gain / whole) for s in ranked if s.gain > 0.05 * whole
    )


def rounds(answer: Answer, refuted: tuple[Explanation, ...]) -> tuple[LoopRound, ...]:
    """Rounds of the search in order, with the reason for each decision; `refuted` are explanations
    that held-out visits did not confirm.
    """
    if not refuted:
        return _search_rounds(answer)
    names = ", ".join(e.name for e in refuted)
    why = f"{names}: nothing is gained on visits that it was not fitted to"
    return (
        *_search_rounds(dataclasses.replace(answer, accepted=refuted)),
        LoopRound(candidates=(), decision="unexplained", reason=why),
    )


def _search_rounds(answer: Answer) -> tuple[LoopRound, ...]:
    if answer.contradicted:
        return (_round((), "unexplained", "; ".join(answer.contradicted)),)
    if not answer.first.present:
        largest = f"(p = {answer.first.p_value:.3g} for the largest of all tests)"
        return (_round((), "adequate", f"nothing exceeds the threshold {largest}"),)
    if answer.problem.independent:
        return tuple(_sweep(tried, answer) for tried in (answer.singles, answer.pairs) if tried)
    best = answer.accepted[0] if answer.accepted else None
    enough = "nothing is left beyond the threshold"
    alone = [s for s in answer.singles if s.accepted]
    singles = _listing(answer.problem, answer.singles)
    if best is not None and alone and len(best.effects) == 1:
        return (_round(singles, f"accept {best.name}", enough),)
    why_not = (
        f"{max(alone, key=lambda e: e.evidence.log).name} would do, but two effects are plainly"
        " likelier: its form would have to be far off"
        if alone
        else "each one leaves structure beyond the threshold, or explains too little"
    )
    size = answer.random_walk_gain
    unnamed = (
        f"a gain that wanders at random ({100 * size:.2g} % of lift) is as likely"
        if size
        else "no pair of declared effects does better"
    )
    return (
        _round(singles, "no single effect will do", why_not),
        _round(
            _listing(answer.problem, answer.pairs, LISTED_PAIRS),
            f"accept {best.name}" if best is not None else "unexplained",
            enough if best is not None else unnamed,
        ),
    )


def _round(candidates: tuple[TriedCandidate, ...], decision: str, reason: str) -> LoopRound:
    return LoopRound(candidates=candidates, decision=decision, reason=reason)


def _listing(
    problem: SearchProblem, tried: tuple[Explanation, ...], most: int | None = None
) -> tuple[TriedCandidate, ...]:
    """Candidates and the structure that they leave, the likeliest first, at most `most`."""
    rows = []
    for e in sorted(tried, key=lambda e: -e.evidence.log)[:most]:
        left = problem.left_by(e)
        rows.append(
            TriedCandidate(
                name=e.name,
                gain=e.gain,
                p_value=left.p_value,
                accepted=e.accepted,
                sizes=_sizes(e),
                at_bound=e.fitted.at_bound,
                log_evidence=e.evidence.log,
                left_in=next(iter(left.foremost()), None) if left.present else None,
            )
        )
    return tuple(rows)


def _sizes(explanation: Explanation) -> dict[str, float]:
    """Fitted parameters of an explanation's effects, without those that differ by session."""
    return {
        s.parameter.name: float(explanation.fitted.vector[s.start])
        for s in explanation.fitted.candidate.slots
        if s.effect in explanation.effects and s.stop - s.start == 1
    }


def beyond_bounds(answer: Answer) -> tuple[str, ...]:
    """Single effects that explain `FAIR_SHARE` of the structure's excess with a size at a bound, in
    words.
    """
    texts, excess = [], answer.problem.excess
    for e in sorted(answer.singles, key=lambda e: -e.gain):
        if not e.fitted.at_bound or e.gain < FAIR_SHARE * excess:
            continue
        (effect,) = e.fitted.candidate.effects
        sizes = _sizes(e)
        for p in effect.parameters:
            size = sizes.get(p.name)
            if p.grid or size not in p.bounds:
                continue
            shown, unit = (1e3 * size, "mm") if p.unit == "m" else (size, p.unit)
            way = "above" if size == p.bounds[1] else "beyond" if size < 0 else "below"
            beyond = f"{way} {plain(shown, 3)}"
            texts.append(
                f"{effect.name} would explain {100 * min(e.gain / excess, 1):.0f} % with {p.name}"
                f" {beyond}{'' if unit == '1' else f' {unit}'}: check that bound"
            )
    return tuple(texts)


def _sweep(tried: tuple[Explanation, ...], answer: Answer) -> LoopRound:
    """A round decided by visits left out."""
    # remaining structure decides nothing here
    rows = tuple(
        dataclasses.replace(row, left_in=None, judged_by="visits left out")
        for row in _listing(answer.problem, tried)
    )
    chosen = [e for e in tried if e.accepted]
    visits = f"({len(np.unique(answer.problem.data.visit))} visits, each in turn)"
    if chosen:
        best = max(chosen, key=lambda e: e.evidence.log)
        return _round(rows, f"accept {best.name}", f"predicts visits left out best {visits}")
    reason = (
        "none predicts visits left out better by more than chance and by most of what is not noise"
        f" {visits}"
    )
    return _round(rows, "add nothing", reason)
