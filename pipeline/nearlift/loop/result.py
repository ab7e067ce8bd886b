"""What is to be quoted after the loop: the coefficients over all answers that may be right, with
budget, influence and doubts.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import gum
from nearlift.fit.estimator import Estimator, largest
from nearlift.fit.known_sources import without_each
from nearlift.likelihood import budget
from nearlift.likelihood.problem import Problem
from nearlift.loop import few_visits
from nearlift.loop.candidate import Candidate
from nearlift.loop.coefficients import Answers, Pair, joint
from nearlift.loop.search import Answer
from nearlift.results.diagnosis import LoopError
from nearlift.results.quotation import BoundaryResult, Correlation, Doubt, HeldOutError

VISITS = "visits left out in turn"


def result(answer: Answer, answers: Answers, error: LoopError | None) -> BoundaryResult:
    """The boundary's part of results.json; `answers` is what the coefficients are under
    every answer, `error` that on visits left out.
    """
    stage, estimator = answer.stage, _estimator(answer, answers)
    named = answer.accepted[0].effects if answer.accepted else ()
    others = dict.fromkeys(
        name for e in answer.accepted[1:] for name in e.effects if name not in named
    )
    doubts = estimator.doubts()
    which = (
        f"choice between {len(answer.accepted)} explanations"
        if len(answer.accepted) > 1
        else "shift by the form"
    )
    coefficients = {}
    for i, name in enumerate(answers.names):
        coefficients[name] = estimator.quoted(
            i,
            answers.spans(i),
            _holds(answer, answers),
            [*_doubts(estimator, answer, answers, i), *doubts[i]],
            which,
            max(len(answer.accepted), 1),
        )
    if stage.independent:
        # by refits: what the fit varies by, and the visit whose omission moves it most
        vectors = few_visits.without_each(stage, answer.best)
        centred = vectors - vectors.mean(axis=0)
        covariance = centred.T @ centred
        visits = stage.data.visit
        for i, (name, quoted) in enumerate(coefficients.items()):
            moved = vectors[:, i] - answer.best.vector[i]
            most = largest(np.unique(visits), moved, visits, stage.as_recorded.z_hat)
            influence = dataclasses.replace(quoted.influence, visit=most)
            coefficients[name] = dataclasses.replace(quoted, influence=influence)
    else:
        form_discrepancy = (
            answer.accepted[0].form_discrepancy if answer.accepted else answers.unnamed
        )
        covariance = joint(stage, answer.best, form_discrepancy)
    return BoundaryResult(
        verdict=answer.verdict,
        base_model=stage.base.name,
        effects=named,
        rivals=tuple(others),
        coefficients=coefficients,
        error=HeldOutError(
            before=error.before.held_out_rmse,
            after=error.after.held_out_rmse,
            noise_floor=error.noise_floor,
        )
        if error is not None
        else None,
        correlation=_correlation(answer.best.candidate, covariance),
    )


def _correlation(candidate: Candidate, covariance: FloatArray) -> Correlation:
    """Without what differs by session; what does not vary goes with nothing."""
    places = {s.parameter.name: s.start for s in candidate.slots if s.stop - s.start == 1}
    entries = list(places.values())
    covariance = covariance[np.ix_(entries, entries)]
    u = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(u > 0, u, 1.0)
    unit = np.clip(0.5 * (covariance + covariance.T) / np.outer(scale, scale), -1.0, 1.0)
    np.fill_diagonal(unit, 1.0)
    return Correlation(parameters=tuple(places), values=tuple(tuple(row) for row in unit.tolist()))


def _holds(answer: Answer, answers: Answers) -> str:
    """What an interval allows for."""
    stage = answer.stage
    errors = (
        "the scatter of whole visits"
        if stage.independent
        else f"the noise of trials{budget.and_declared(stage.parts)}"
    )
    if answers.carried:
        return (
            f"Allows for {errors}, and for what is unexplained along"
            f" {' and along '.join(answers.carried)}"
        )
    if not answer.accepted:
        none = (
            "nothing else was found"
            if stage.options.pairs
            else "nothing else was found that so few trials could show"
        )
        missing = (
            ", not for what is unexplained" if answer.verdict == "unexplained" else f"; {none}"
        )
        return f"Allows for {errors}{missing}"
    named = " and ".join(answer.accepted[0].effects)
    alike = ", and what this design cannot tell from it" if len(answer.accepted) > 1 else ""
    if stage.independent:
        return f"Allows for {errors} with {named} in the model{alike}"
    also = "; also for what this design cannot tell from it" if alike else ""
    return f"Allows for {errors}, and for an inexact formula of {named}, which is taken out{also}"


def _doubts(estimator: Estimator, answer: Answer, answers: Answers, i: int) -> list[Doubt]:
    """The coefficient by each answer alone, and with what was not seen."""

    def at(condition: str, pair: Pair, explanation: str | None = None) -> Doubt:
        doubt = estimator.doubt(i, condition, float(pair[0][i]), float(pair[1][i]))
        return dataclasses.replace(doubt, explanation=explanation)

    listed = []
    if answer.accepted:
        best = answer.accepted[0].name
        listed.append(at(f"{best} is all, exactly in its declared form", answers.conditional, best))
        listed += [
            at(f"it is {name} in place of {best}", pair, name) for name, pair in answers.members[1:]
        ]
    if answer.verdict != "adequate":
        listed.append(at("the base model lacks nothing", answers.before))
    listed.append(
        at("every effect too small to be seen acts at its plausible size", answers.constrained)
    )
    return listed


def _estimator(answer: Answer, answers: Answers) -> Estimator:
    """The best answer's, linearised about the values quoted: its effects, their form and what has
    no name are unknowns in the covariance.
    """
    stage, p = answer.stage, len(answers.names)
    value, u = answers.value, answers.members[0][1][1]
    low, high = answer.best.candidate.bounds
    problem, unknowns = _with_unknowns(answer, answers)
    fixed = (value <= low[:p]) | (value >= high[:p]) | ~np.isfinite(u)
    lines: tuple[gum.Line, ...] = ()
    without: dict[str, FloatArray] = {}
    if stage.independent:
        lines, without = (gum.further(VISITS, "A", np.diag(u)),), {VISITS: np.zeros(p)}
    elif p:
        g = gum.gain(problem, value)
        lines = gum.lines(problem, g, stage.parts, stage.noise, stage.slope)
        lines += tuple(
            gum.further(name, "B", g @ problem.covariance.shared[:, columns])
            for name, columns in unknowns.items()
        )
        parts = [(part, stage.slope) for part in stage.parts]
        without = without_each(problem, problem.jacobian(value), stage.noise, parts, u, unknowns)
    return Estimator(
        problem=problem,
        theta=value,
        u=u,
        dof=answers.dof,
        lines=lines,
        without=without,
        parts=stage.parts,
        slope=stage.slope,
        fixed=fixed,
        z_hat=stage.as_recorded.z_hat,
    )


def _with_unknowns(answer: Answer, answers: Answers) -> tuple[Problem, dict[str, slice]]:
    """The likelihood in the coefficients alone, and which of its shared unknowns are what."""
    stage, p = answer.stage, len(answers.names)
    space, candidate, vector = stage.space, answer.best.candidate, answer.best.vector
    data = dataclasses.replace(stage.data, lift_N=np.exp(stage.log_lift))
    jacobian, (mean, sd) = candidate.jacobian(vector), candidate.prior
    shift = (
        candidate.log_ratio(vector)
        - stage.candidate().log_ratio(vector[:p])
        - jacobian[:, p:] @ (vector - mean)[p:]
    )
    further: dict[str, FloatArray] = {}
    for effect in candidate.effects:
        mine = candidate.entries_of(effect.name)
        further[f"size of {effect.name}"] = jacobian[:, mine] * sd[mine]
    if answer.accepted and not stage.independent:
        further |= answer.accepted[0].nuisances
    if answers.carried:
        further[f"what has no name along {' and '.join(answers.carried)}"] = answers.unnamed
    shared, unknowns = space.covariance.shared, {}
    for name, columns in further.items():
        if columns.shape[1]:
            unknowns[name] = slice(shared.shape[1], shared.shape[1] + columns.shape[1])
            shared = np.hstack([shared, columns])
    covariance = dataclasses.replace(space.covariance, shared=shared)
    return Problem(model=stage.base, data=data, covariance=covariance, shift=shift), unknowns
