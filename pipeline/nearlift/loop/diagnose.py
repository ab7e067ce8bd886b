"""Diagnosis of one boundary: test for structure, search for effects, cross-validation by visits,
and the coefficients and errors before and after.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, LiftModel
from nearlift.errors import NotConverged
from nearlift.fit.density import Density
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget, noise
from nearlift.likelihood.problem import usable
from nearlift.likelihood.variance_components import PRIORS
from nearlift.loop import (
    coefficients,
    confirmation,
    few_visits,
    findings,
    limits,
    result,
    separation,
    stability,
    within_trial,
)
from nearlift.loop.admission import is_small_table, problem_of_trials, require_enough_trials
from nearlift.loop.candidate import stated_datum
from nearlift.loop.confirmation import Progress, ignore_progress
from nearlift.loop.families import exceed_levels
from nearlift.loop.interim import InterimLook
from nearlift.loop.noise_floor import LARGE_CAMPAIGN, prepare
from nearlift.loop.predictions import sensitivity
from nearlift.loop.search import Answer, Shortlist, run, search_to_convergence
from nearlift.loop.search_problem import SILENT, Options, SearchProblem
from nearlift.results import Noise, Observations
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.outlook import UntestableEffect
from nearlift.results.quotation import BoundaryResult

#: Noise of the fit from which the search's own noise is estimated: the scales of its priors.
USUAL = Noise(
    relative=PRIORS["relative"][0], height_m=PRIORS["height_m"][0], common=PRIORS["common"][0]
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopDiagnosis:
    """One boundary's block of diagnosis.json, its part of results.json, residuals, and the
    posterior density of the quoted coefficients.

    `residuals` holds arrays (n,). `before` and `after` are relative, about the fit to all trials.
    With cross-validation, `held_out_before` and `held_out_after` are about fits without the trial's
    visit, nan if it could not be predicted.
    """

    findings: BoundaryDiagnosis
    residuals: dict[str, NDArray[Any]]
    quoted: BoundaryResult
    density: Density | None


def diagnose(
    data: Observations,
    base: LiftModel,
    parts: tuple[budget.Component, ...],
    options: Options,
    *,
    effects: tuple[Effect, ...] | None = None,
    confirm: bool = True,
    look: InterimLook | None = None,
    progress: Progress = ignore_progress,
) -> LoopDiagnosis:
    """Diagnose one boundary.

    Parameters
    ----------
    data : Observations
        Accepted trials in run order.
    base : LiftModel
    parts : tuple of Component
        The declared uncertainty budget: errors of declared size are not structure.
    options : Options
        Seed, false-alarm rate, form uncertainty and what is not feasible.
    effects : tuple of Effect or None
        The library; the catalogue's if None.
    confirm : bool
        Whether to cross-validate by visits (most of the run time).
    look : InterimLook or None
        The progress of an unfinished campaign, whose claims need the interim boundary.
    progress : callable
        Called as each fold begins.

    Raises
    ------
    NotConverged
        Too few trials or visits to distinguish noise from structure, no trial near the boundary, or
        the base model cannot be fitted.
    """
    ground, library, untestable = set_up(data, base, parts, options, effects)
    rate = options.false_alarm_rate if look is None else look.level(options.false_alarm_rate)
    answer = decide(ground, confirm, rate, progress=progress)

    def described(answer: Answer) -> LoopDiagnosis:
        return _described(answer, library, untestable, look)

    diagnosis = described(answer)
    if not confirm:
        return diagnosis
    quoted, like, data = diagnosis.quoted, answer, ground.data
    visits = stability.without_visits(
        answer,
        quoted,
        lambda visit: _without(ground, data.visit.astype(str) != visit, rate, like),
        stability.visits_to_try(answer, quoted),
    )
    against = tuple(stability.contradicting(quoted, visits))
    if answer.verdict == "adequate" and look is None and against:
        answer = dataclasses.replace(answer, contradicted=against)
        diagnosis = described(answer)
        name = quoted.headline
        less, more = (q.coefficients[name].value for q in (quoted, diagnosis.quoted))
        quoted = diagnosis.quoted
        visits = [(dataclasses.replace(v, shift=v.shift + less - more), w) for v, w in visits]
    quoted = stability.with_decisive_trial(
        quoted,
        lambda trial: _without(ground, data.trial != trial, rate, answer),
        stability.trials_to_try(answer, quoted),
    )
    quoted = stability.with_decisive_visits(quoted, visits)
    return dataclasses.replace(diagnosis, quoted=quoted)


def _described(
    answer: Answer,
    library: tuple[Effect, ...],
    untestable: tuple[UntestableEffect, ...],
    look: InterimLook | None,
) -> LoopDiagnosis:
    """The answer's findings, residuals and quotation; no trial or visit left out."""
    problem, scored, data = answer.problem, answer.scored, answer.problem.data
    rate = problem.options.false_alarm_rate
    shared = confirmation.declared_errors(problem)
    residuals: dict[str, NDArray[Any]] = {"trial": data.trial}
    for name, fitted in (("before", problem.base_fit), ("after", answer.best)):
        residuals[name] = confirmation.held_out_residuals(problem, fitted, shared, data, shared)
    if scored is not None:
        after = scored.before if answer.refuted else scored.after
        residuals |= {"held_out_before": scored.before, "held_out_after": after}
    error = confirmation.error(answer, noise.floor(data, problem.noise, problem.slope))
    answers = coefficients.answers(answer)
    lacking = limits.unidentifiable_coefficients(problem, answer.best)
    accepted = findings.accepted_explanation(answer, answers)
    named = findings.named_effects(answer, accepted)
    unexplained, best = answer.verdict == "unexplained", answer.accepted[:1]
    seen = {name for e in answer.accepted for name in e.effects}
    block = BoundaryDiagnosis(
        base_model=problem.base.name,
        false_alarm_rate=rate,
        verdict=answer.verdict,
        effects=named,
        explanations=tuple(e.effects for e in answer.accepted) or None,
        accepted=accepted,
        probabilities=answer.probabilities,
        partial=findings.partial(answer) if unexplained else None,
        at_bound=(findings.beyond_bounds(answer) or None) if unexplained else None,
        contradicted=answer.contradicted or None,
        random_walk_gain=answer.random_walk_gain or None,
        p_value=answer.first.p_value,
        structure=findings.structure_tests(answer),
        rounds=findings.rounds(answer),
        not_confirmed=tuple(e.effects for e in answer.refuted) or None,
        look=look.claim(rate) if look else None,
        error=error,
        noise=problem.noise,
        L_inf_N=coefficients.far_lift(
            problem, answer.best, best[0].form_discrepancy if best else answers.unnamed
        ),
        coefficients=answers.estimates(),
        limits=lacking,
        within_trial=within_trial.heating(data, library, look.level(rate) if look else rate),
        not_testable=untestable,
        sensitivity=sensitivity(problem, seen) if is_small_table(data, problem.base) else None,
        silent=limits.silent(problem, library, SILENT),
        next_experiment=(
            *separation.next_experiment(answer),
            *limits.visits_to_add(lacking),
        ),
    )
    return LoopDiagnosis(
        findings=block,
        residuals=residuals,
        quoted=result.result(answer, answers, named, error),
        density=result.posterior_density(answer, answers),
    )


def decide(
    problem: SearchProblem,
    confirm: bool,
    rate: float,
    like: Answer | None = None,
    shortlist: Shortlist | None = None,
    progress: Progress = ignore_progress,
) -> Answer:
    """Search, and with `confirm` cross-validate by visits.

    Where the search agrees with `like`, the confirmation and contradictions of `like` are kept.
    Where it does not, the search is repeated without the `shortlist`. `rate` is the false-alarm
    rate of a claim. At an interim analysis it is below that of the options, and an adequate model
    is not tested for contradictions.
    """
    few = few_visits.visits_are_few(problem.data)
    answer = few_visits.run(problem) if few else search_to_convergence(problem, shortlist)
    # folds of few visits start from the original problem, which is not yet `independent`
    ground = problem if few else answer.problem
    early = rate < problem.options.false_alarm_rate
    if early:
        answer = answer.claimed_below(ground.null.threshold(rate))
    agrees = like is not None and answer.would_name == like.would_name
    if like is not None and shortlist and not agrees:
        del answer, ground
        return decide(problem, confirm, rate, like, progress=progress)
    if like is not None and agrees:
        unconfirmed = bool(like.refuted)
        answer = dataclasses.replace(answer, contradicted=like.contradicted)
    else:
        named, scored = answer.best.candidate.effects, None
        if confirm:
            # a fold's own search is reported for the whole diagnosis alone, and costs most of it
            search_again = like is None and problem.data.n <= LARGE_CAMPAIGN
            again = few_visits.run if few else run if search_again else None
            scored = confirmation.held_out(ground, again, named, progress)
            if not scored.predicted.any():
                # the other visits determine the L_inf of no held-out trial
                scored = None
        answer = dataclasses.replace(answer, scored=scored)
        unconfirmed = (
            scored is not None
            and bool(answer.accepted)
            and not (
                confirmation.improves(answer.problem, scored)
                and confirmation.each_helps(ground, scored, named)
            )
        )
        if answer.verdict == "adequate" and not early:
            against = confirmation.contradictions(answer.problem, scored)
            answer = dataclasses.replace(answer, contradicted=against)
    if unconfirmed:
        # effects that do not improve held-out predictions are not named, however well they fit
        return dataclasses.replace(answer, refuted=answer.accepted, accepted=())
    return answer


def _without(
    ground: SearchProblem,
    keep: NDArray[np.bool_],
    rate: float,
    like: Answer,
) -> stability.Without | None:
    """The diagnosis of the trials `keep` alone; None where they cannot be diagnosed."""
    whole = like.problem
    data = whole.data.take(keep)
    if len(np.unique(data.visit)) < 2 or not np.isfinite(data.z_hat).any():
        return None
    about, begin = whole.about, whole
    if about is not None:
        about = dataclasses.replace(about[0], data=data), about[1]
        if about[0].size != len(about[1]):
            # the last session, of which nothing is left, had a size of its own
            about, begin = None, ground
    try:
        part = dataclasses.replace(
            whole, data=data, log_lift=np.log(data.lift_N), theta=begin.theta, independent=False
        )
        problem = prepare(part, about, begin.noise)
        # where visits are few, they decide, and no evidence
        shortlist = None if whole.independent else like.shortlist(~keep)
        answer = decide(problem, True, rate, like, shortlist)
        answers = coefficients.answers(answer)
    except NotConverged:
        return None
    return stability.Without(
        verdict=answer.verdict,
        effects=answer.named,
        intervals={
            name: (c.value, c.lo90, c.hi90) for name, c in answers.estimates().after.items()
        },
        widths={name: answers.width90(i) for i, name in enumerate(answers.names)},
    )


def set_up(
    data: Observations,
    base: LiftModel,
    parts: tuple[budget.Component, ...],
    options: Options,
    effects: tuple[Effect, ...] | None = None,
    *,
    first_order: bool = False,
) -> tuple[SearchProblem, tuple[Effect, ...], tuple[UntestableEffect, ...]]:
    """Search problem of a boundary (usable trials, base fit, noise floor), testable effects, and
    untestable ones.

    With `first_order` a stated zero error of the distance is a column of the covariance, and
    `height_offset` an effect: what is predicted is small.

    Raises
    ------
    NotConverged
        As `diagnose`.
    """
    kept = data.take(usable(base, data))
    where = f"diagnosis of the {data.boundary}"
    if kept.n and not np.isfinite(kept.z_hat).any():
        raise NotConverged(
            where, "all trials are in free air", "measure at least two visits near the boundary"
        )
    if len(np.unique(kept.visit)) == 1 < kept.n:
        raise NotConverged(
            where,
            "all trials belong to one visit",
            "measure at least two visits, so that one can be left out",
        )
    require_enough_trials(where, kept, base)
    first = fit(base, kept, parts, USUAL, offset_m=0.0)
    lift_inf_N = kept.lift_inf_N(first.level_coefficients)
    problem, known, untestable = problem_of_trials(
        kept, base, parts, first.noise, options, first.theta, lift_inf_N, effects
    )
    kept = problem.data
    absorbed = {e.name for e, c in problem.library if not exceed_levels(c, kept)}
    between = tuple(e for e in problem.effects if e.name not in absorbed)
    datum = stated_datum(parts, base, kept)
    if datum and (first_order or few_visits.visits_are_few(kept)):
        # few visits are fitted without shared errors: the datum competes as an effect
        stated, datum = dataclasses.replace(datum, name="height_offset"), None
        between = tuple(stated if e.name == stated.name else e for e in between)
    if datum:
        known, between = (
            tuple(e for e in among if e.name != "height_offset") for among in (known, between)
        )
    if is_small_table(kept, base):
        options = dataclasses.replace(options, pairs=False)
    problem = dataclasses.replace(problem, effects=between, datum=datum, options=options)
    return prepare(problem), known, untestable
