"""Findings of a search, as diagnosis.json holds them: effects with their rivals, structure, and
every round with its reasons.
"""

from __future__ import annotations

import numpy as np

from nearlift.likelihood import student
from nearlift.loop import few_visits
from nearlift.loop.coefficients import Answers
from nearlift.loop.evidence import Explanation
from nearlift.loop.search import Answer
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
#: Single effects whose share of the structure is reported, at most and from which share.
LISTED_PARTS, LEAST_PART = 3, 0.05
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
    fitted, problem = answer.best, answer.problem
    u = np.sqrt(np.maximum(np.diag(answers.covariance), 0.0))
    by_visits = problem.independent
    dof = few_visits.freedom(problem, fitted) if by_visits else np.full(len(u), np.inf)
    dof[: len(answers.names)] = answers.dof
    half = [student.quantile(0.95, float(d)) for d in dof] * u
    parameters = {}
    for slot in fitted.candidate.slots:
        name, unit = slot.parameter.name, slot.parameter.unit
        for i in range(slot.start, slot.stop):
            key = name if slot.stop - slot.start == 1 else f"{name}[{i - slot.start}]"
            v, h = float(fitted.vector[i]), float(half[i])
            parameters[key] = Estimate(value=v, lo90=v - h, hi90=v + h, u=u[i], unit=unit)
    return AcceptedExplanation(
        effects=answer.named,
        probability=answer.probability,
        parameters=parameters,
        covariance=ParameterCovariance.named(
            parameters, answers.covariance if by_visits else fitted.covariance
        ),
    )


def named_effects(answer: Answer, accepted: AcceptedExplanation | None) -> tuple[NamedEffect, ...]:
    """Effects of the best explanation, each with the rivals that could take its place."""
    if accepted is None:
        return ()
    best, candidate = set(answer.named), answer.best.candidate
    entries = [*accepted.parameters.items()]
    listed = []
    for effect in candidate.effects:
        rivals: list[str] = []
        for other in answer.accepted[1:]:
            shared = best & set(other.effects)
            # an explanation of the same length replaces what it does not share; a longer one shows
            # what may act besides
            if len(other.effects) > len(best) or shared - {effect.name} or not shared:
                rivals += [name for name in other.effects if name not in best]
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


def partial(answer: Answer) -> tuple[PartialEffect, ...]:
    """Shares of the structure's excess chi2 that the best single effects would explain."""
    # a size at a bound earns no share
    singles = (s for s in answer.singles if not s.fitted.at_bound)
    ranked = sorted(singles, key=lambda s: -s.gain)[:LISTED_PARTS]
    # by chance the excess may be less than one effect's gain
    whole = max(answer.problem.excess, *(s.gain for s in ranked), 0.0)
    return tuple(
        PartialEffect(name=s.name, share=s.gain / whole)
        for s in ranked
        if s.gain > LEAST_PART * whole
    )


def beyond_bounds(answer: Answer) -> tuple[str, ...]:
    """Single effects that explain `FAIR_SHARE` of the structure's excess with a size at a bound, in
    words.
    """
    texts, excess = [], answer.problem.excess
    for e in sorted(answer.singles, key=lambda e: -e.gain):
        if not e.fitted.at_bound or e.gain < FAIR_SHARE * excess:
            continue
        sizes = _sizes(e)
        for p in e.fitted.candidate.effects[0].parameters:
            size = sizes.get(p.name)
            if p.grid or size not in p.bounds:
                continue
            shown, unit = (1e3 * size, " mm") if p.unit == "m" else (size, f" {p.unit}")
            way = "above" if size == p.bounds[1] else "beyond" if size < 0 else "below"
            texts.append(
                f"{e.name} would explain {100 * min(e.gain / excess, 1):.0f} % with {p.name}"
                f" {way} {plain(shown, 3)}{'' if p.unit == '1' else unit}: check that bound"
            )
    return tuple(texts)


def rounds(answer: Answer) -> tuple[LoopRound, ...]:
    """Rounds of the search in order, with the reason for each decision, and the effects that
    held-out visits did not confirm.
    """
    listed = _search_rounds(answer, answer.refuted or answer.accepted)
    if not answer.refuted:
        return listed
    names = ", ".join(e.name for e in answer.refuted)
    why = f"{names}: nothing is gained on visits that it was not fitted to"
    return (*listed, LoopRound(candidates=(), decision="unexplained", reason=why))


def _search_rounds(answer: Answer, accepted: tuple[Explanation, ...]) -> tuple[LoopRound, ...]:
    if answer.contradicted:
        reason = "; ".join(answer.contradicted)
        return (LoopRound(candidates=(), decision="unexplained", reason=reason),)
    if not answer.first.present:
        reason = (
            "nothing exceeds the threshold"
            f" (p = {answer.first.p_value:.3g} for the largest of all tests)"
        )
        return (LoopRound(candidates=(), decision="adequate", reason=reason),)
    if answer.problem.independent:
        return tuple(_sweep(answer, tried) for tried in (answer.singles, answer.pairs) if tried)
    best, enough = accepted[0] if accepted else None, "nothing is left beyond the threshold"
    alone = [s for s in answer.singles if s.accepted]
    singles = _listing(answer, answer.singles)
    if best is not None and alone and len(best.effects) == 1:
        return (LoopRound(candidates=singles, decision=f"accept {best.name}", reason=enough),)
    why_not = (
        f"{max(alone, key=lambda e: e.log_evidence).name} would do, but two effects are plainly"
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
        LoopRound(candidates=singles, decision="no single effect will do", reason=why_not),
        LoopRound(
            candidates=_listing(answer, answer.pairs, LISTED_PAIRS),
            decision="unexplained" if best is None else f"accept {best.name}",
            reason=unnamed if best is None else enough,
        ),
    )


def _sweep(answer: Answer, tried: tuple[Explanation, ...]) -> LoopRound:
    """A round decided by visits left out."""
    chosen = [e for e in tried if e.accepted]
    if chosen:
        decision = f"accept {max(chosen, key=lambda e: e.log_evidence).name}"
        reason = "predicts visits left out best"
    else:
        decision = "add nothing"
        reason = (
            "none predicts visits left out better by more than chance and by most of what is not"
            " noise"
        )
    visits = f"({len(np.unique(answer.problem.data.visit))} visits, each in turn)"
    return LoopRound(
        candidates=_listing(answer, tried), decision=decision, reason=f"{reason} {visits}"
    )


def _listing(
    answer: Answer, tried: tuple[Explanation, ...], most: int | None = None
) -> tuple[TriedCandidate, ...]:
    """Candidates and the structure that they leave, the likeliest first, at most `most`."""
    # of few visits, remaining structure decides nothing
    by_visits = answer.problem.independent
    rows = []
    for e in sorted(tried, key=lambda e: -e.log_evidence)[:most]:
        left = answer.problem.left_by(e)
        shown = left.present and not by_visits
        rows.append(
            TriedCandidate(
                name=e.name,
                gain=e.gain,
                p_value=left.p_value,
                accepted=e.accepted,
                sizes=_sizes(e),
                at_bound=e.fitted.at_bound,
                log_evidence=e.log_evidence,
                left_in=next(iter(left.foremost()), None) if shown else None,
                judged_by="visits left out" if by_visits else None,
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
