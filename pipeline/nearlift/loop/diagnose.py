"""Diagnosis of one boundary: test for structure, search for effects, cross-validation by visits,
and the coefficients and errors before and after.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, LiftModel
from nearlift.errors import NotConverged
from nearlift.fit import inputs
from nearlift.fit.density import Density
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget, noise
from nearlift.likelihood.covariates import derive
from nearlift.likelihood.problem import lift_ratio, usable
from nearlift.likelihood.variance_components import PRIORS
from nearlift.loop import (
    absorption,
    adequacy,
    coefficients,
    confirmation,
    few_visits,
    separation,
    stability,
)
from nearlift.loop.admission import admit, could_act, few
from nearlift.loop.candidate import library_columns
from nearlift.loop.confirmation import Progress, ignore_progress
from nearlift.loop.datum import stated_datum
from nearlift.loop.explanation import Explanation
from nearlift.loop.families import exceed_levels
from nearlift.loop.far_lift import far_lift
from nearlift.loop.findings import (
    accepted_explanation,
    beyond_bounds,
    named_effects,
    partial,
    rounds,
    structure_tests,
)
from nearlift.loop.interim import InterimLook
from nearlift.loop.noise_floor import MANY, prepare
from nearlift.loop.predictions import sensitivity
from nearlift.loop.result import posterior_density, result
from nearlift.loop.search import Answer, Shortlist, run, search_to_convergence
from nearlift.loop.search_problem import SILENT, Options, SearchProblem
from nearlift.loop.within_trial import heating
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
        Seed, false-alarm rate, form uncertainty and correction for multiplicity.
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
    decided = decide(ground, confirm, rate, progress=progress)

    def described(decided: Decided) -> LoopDiagnosis:
        return _described(decided, library, untestable, look)

    result = described(decided)
    if not confirm:
        return result

    def without(label: NDArray[Any], like: Decided) -> Callable[[str], stability.Without | None]:
        return lambda one: _without(ground, label != one, rate, like)

    answer, quoted = decided.answer, result.quoted
    to_try = stability.visits_to_try(answer, quoted)
    visits = stability.without_visits(
        answer, quoted, without(ground.data.visit.astype(str), decided), to_try
    )
    against = stability.contradicting(quoted, visits)
    if answer.verdict == "adequate" and look is None and against:
        decided = dataclasses.replace(
            decided, answer=dataclasses.replace(answer, contradicted=tuple(against))
        )
        result = described(decided)
        more = result.quoted.coefficients[quoted.headline].value
        less = quoted.coefficients[quoted.headline].value
        quoted = result.quoted
        visits = [(dataclasses.replace(v, shift=v.shift + less - more), w) for v, w in visits]
    quoted = stability.with_decisive_trial(
        quoted,
        without(ground.data.trial, decided),
        stability.trials_to_try(decided.answer, quoted),
    )
    quoted = stability.with_decisive_visits(quoted, visits)
    return dataclasses.replace(result, quoted=quoted)


def _described(
    decided: Decided,
    library: tuple[Effect, ...],
    untestable: tuple[UntestableEffect, ...],
    look: InterimLook | None,
) -> LoopDiagnosis:
    """The answer's findings, residuals and quotation; no trial or visit left out."""
    answer, refuted, scored = decided.answer, decided.refuted, decided.scored
    problem = answer.problem
    options = problem.options
    rate = options.false_alarm_rate if look is None else look.level(options.false_alarm_rate)
    shared = confirmation.declared_errors(problem)
    residuals: dict[str, NDArray[Any]] = {
        "trial": problem.data.trial,
        "before": confirmation.held_out_residuals(
            problem, problem.base_fit, shared, problem.data, shared
        ),
        "after": confirmation.held_out_residuals(
            problem, answer.best, shared, problem.data, shared
        ),
    }
    error = None
    if scored is not None:
        after = scored.before if refuted else scored.after
        residuals |= {"held_out_before": scored.before, "held_out_after": after}
        error = confirmation.error(
            answer, scored, noise.floor(problem.data, problem.noise, problem.slope)
        )
    answers = coefficients.answers(answer)
    limits = absorption.unidentifiable_coefficients(problem, answer.best)
    accepted = accepted_explanation(answer, answers)
    effects_named = named_effects(answer, accepted)
    findings = BoundaryDiagnosis(
        base_model=problem.base.name,
        false_alarm_rate=problem.options.false_alarm_rate,
        verdict=answer.verdict,
        effects=effects_named,
        explanations=tuple(e.effects for e in answer.accepted) or None,
        accepted=accepted,
        probabilities=answer.probabilities,
        partial=partial(problem, answer) if answer.verdict == "unexplained" else None,
        at_bound=(beyond_bounds(answer) or None) if answer.verdict == "unexplained" else None,
        contradicted=answer.contradicted or None,
        wander=answer.random_walk_gain or None,
        p_value=answer.first.p_value,
        threshold_log10_p=answer.first.threshold,
        structure=structure_tests(answer),
        rounds=rounds(answer, refuted),
        not_confirmed=tuple(e.effects for e in refuted) or None,
        look=look.claim(options.false_alarm_rate) if look else None,
        error=error,
        noise=problem.noise,
        L_inf_N=far_lift(
            problem,
            answer.best,
            answer.accepted[0].form_discrepancy if answer.accepted else answers.unnamed,
        ),
        coefficients=answers.estimates(),
        limits=limits,
        within_trial=heating(problem.data, library, rate),
        not_testable=untestable,
        sensitivity=(
            sensitivity(problem, {name for e in answer.accepted for name in e.effects})
            if few(problem.data, problem.base)
            else None
        ),
        silent=coefficients.silent(problem, library, SILENT),
        next_experiment=(
            *separation.next_experiment(problem, answer),
            *separation.to_part_visits(limits),
        ),
    )
    return LoopDiagnosis(
        findings=findings,
        residuals=residuals,
        quoted=result(answer, answers, effects_named, error),
        density=posterior_density(answer, answers),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Decided:
    """The search's answer after cross-validation: `refuted` are explanations that held-out visits
    did not confirm, `scored` the held-out residuals, None without cross-validation.
    """

    answer: Answer
    refuted: tuple[Explanation, ...]
    scored: confirmation.HeldOut | None

    @property
    def would_name(self) -> tuple[str, ...] | None:
        """Effects that the search names, confirmed or not; None where it finds no structure."""
        named = self.refuted or self.answer.accepted
        return (named[0].effects if named else ()) if self.answer.first.present else None


def decide(
    problem: SearchProblem,
    confirm: bool,
    rate: float,
    like: Decided | None = None,
    shortlist: Shortlist | None = None,
    progress: Progress = ignore_progress,
) -> Decided:
    """Search, and with `confirm` cross-validate by visits.

    Where the search agrees with `like`, the confirmation and contradictions of `like` are kept.
    Where it does not, the search is repeated without the `shortlist`. `rate` is the false-alarm
    rate of a claim. At an interim analysis it is below that of the options, and an adequate model
    is not tested for contradictions.
    """
    few = few_visits.applies(problem.data)
    answer = few_visits.run(problem) if few else search_to_convergence(problem, shortlist)
    early = rate < problem.options.false_alarm_rate
    if early:
        answer = answer.claimed_below((problem if few else answer.problem).null.threshold(rate))
    decided = Decided(answer=answer, refuted=(), scored=None)
    if like is not None and shortlist and decided.would_name != like.would_name:
        del answer, decided
        return decide(problem, confirm, rate, like, progress=progress)
    if like is not None and decided.would_name == like.would_name:
        unconfirmed = bool(like.refuted)
        answer = dataclasses.replace(answer, contradicted=like.answer.contradicted)
    else:
        # folds of few visits start from the original problem, which is not yet `independent`
        named = answer.best.candidate.effects
        scored = None
        if confirm:
            # a fold's own search is reported for the whole diagnosis alone, and costs most of it
            search_again = like is None and problem.data.n <= MANY
            again = few_visits.run if few else run if search_again else None
            ground = problem if few else answer.problem
            scored = confirmation.held_out(ground, again, named, progress)
            if not scored.predicted.any():
                # the other visits determine the L_inf of no held-out trial
                scored = None
        decided = dataclasses.replace(decided, scored=scored)
        unconfirmed = (
            scored is not None
            and bool(answer.accepted)
            and not (
                confirmation.improves(answer.problem, scored)
                and confirmation.each_helps(ground, scored, named)
            )
        )
        if answer.verdict == "adequate" and not early:
            answer = dataclasses.replace(
                answer, contradicted=adequacy.contradictions(answer.problem, scored)
            )
    if unconfirmed:
        # effects that do not improve held-out predictions are not named, however well they fit
        return dataclasses.replace(decided, refuted=answer.accepted, answer=answer.without_names())
    return dataclasses.replace(decided, answer=answer)


def _without(
    ground: SearchProblem,
    keep: NDArray[np.bool_],
    rate: float,
    like: Decided,
) -> stability.Without | None:
    """The diagnosis of the trials `keep` alone; None where they cannot be diagnosed."""
    whole = like.answer.problem
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
        named = like.refuted or like.answer.accepted
        # where visits are few, they decide, and no evidence
        shortlist = None if whole.independent else like.answer.shortlist(named, ~keep)
        answer = decide(problem, True, rate, like, shortlist).answer
        answers = coefficients.answers(answer)
    except NotConverged:
        return None
    return stability.Without(
        verdict=answer.verdict,
        effects=answer.accepted[0].effects if answer.accepted else (),
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
    admit(where, kept, base)
    first = fit(base, kept, parts, USUAL, offset_m=0.0)
    kept = derive(
        kept,
        kept.lift_inf_N(first.level_coefficients),
        lift_ratio(base, kept, base.named(first.theta)),
    )
    known, untestable = could_act(kept, base, effects)
    # effects within a trial leave no mark on trial means; they have a test of their own
    between = tuple(e for e in known if not e.within_trial)
    absorbed = {
        e.name
        for e, c in library_columns(base, between, kept, first.theta)
        if not exceed_levels(c, kept)
    }
    between = tuple(e for e in between if e.name not in absorbed)
    datum = stated_datum(parts, base, kept)
    if datum and (first_order or few_visits.applies(kept)):
        # few visits are fitted as if they shared no error: it competes as an effect
        stated, datum = dataclasses.replace(datum, name="height_offset"), None
        between = tuple(stated if e.name == stated.name else e for e in between)
    if datum:
        known, between = (
            tuple(e for e in among if e.name != "height_offset") for among in (known, between)
        )
    if few(kept, base):
        options = dataclasses.replace(options, pairs=False)
    acting = inputs.acting(parts, base, first.theta)
    problem = SearchProblem(
        data=kept,
        base=base,
        effects=between,
        parts=acting,
        noise=first.noise,
        log_lift=np.log(kept.lift_N),
        theta=first.theta,
        options=options,
        datum=datum,
    )
    problem = prepare(problem)
    return problem, known, untestable
