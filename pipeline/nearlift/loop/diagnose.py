"""The loop, closed: find the residual, trace it to an effect, add it, and report the error before
and after.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray, LiftModel
from nearlift.errors import NotConverged
from nearlift.fit import inputs
from nearlift.fit.heights import Plan
from nearlift.fit.least_squares import fit
from nearlift.likelihood import budget, noise, student
from nearlift.likelihood.problem import usable
from nearlift.loop import (
    absorption,
    adequacy,
    coefficients,
    confirmation,
    few_visits,
    sensitivity,
    separation,
    stability,
)
from nearlift.loop import result as loop_result
from nearlift.loop.admission import admit, could_act, few
from nearlift.loop.candidate import Fitted
from nearlift.loop.interim import InterimLook
from nearlift.loop.search import (
    SILENT,
    Answer,
    Explanation,
    Options,
    Stage,
    prepare,
    run,
    settle,
)
from nearlift.loop.setting import derive
from nearlift.loop.within_trial import heating
from nearlift.quotation import BoundaryResult, Correlation, HeldOutError
from nearlift.results import Observations

#: Share of the structure from which an effect that is refused for its size is named as such.
FAIR_SHARE = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnosis:
    """What the loop found at one boundary: its block of diagnosis.json, its part of results.json,
    and every trial's residual before and after.

    `residuals` holds arrays of one length: `trial`, `before` and `after` (relative, about the fit
    to all trials), and the same `held_out_before`, `held_out_after` where the trial's visit took no
    part (nan if that could not be predicted).
    """

    findings: dict[str, Any]
    residuals: dict[str, NDArray[Any]]
    quoted: BoundaryResult


def close_loop(
    data: Observations,
    base: LiftModel,
    parts: tuple[budget.Component, ...] = (),
    *,
    seed: int = 0,
    false_alarm_rate: float = 0.05,
    effects: tuple[Effect, ...] | None = None,
    form_sd: float | None = None,
    multiplicity: bool = True,
    confirm: bool = True,
) -> dict[str, Any]:
    """The findings of `diagnose`, with options by keyword."""
    options = Options(seed=seed, false_alarm_rate=false_alarm_rate, multiplicity=multiplicity)
    if form_sd is not None:
        options = dataclasses.replace(options, form_sd=form_sd)
    return diagnose(data, base, parts, options, effects=effects, confirm=confirm).findings


def diagnose(
    data: Observations,
    base: LiftModel,
    parts: tuple[budget.Component, ...],
    options: Options,
    *,
    effects: tuple[Effect, ...] | None = None,
    confirm: bool = True,
    look: InterimLook | None = None,
) -> Diagnosis:
    """Diagnose one boundary.

    Parameters
    ----------
    data : Observations
        Accepted trials in run order.
    base : LiftModel
    parts : tuple of Component
        The declared budget: an error of a declared size is not structure.
    options : Options
        Seed, false-alarm rate; form uncertainty and the correction for many candidates, switched
        off only to show their use.
    effects : tuple of Effect or None
        The library; the catalogue's if None.
    confirm : bool
        Repeat the search in folds and score held-out visits (most of the time).
    look : InterimLook or None
        Where trials are still to come: what is found is then claimed only beyond the look's
        boundary.

    Raises
    ------
    NotConverged
        Too few trials to tell a noise floor from structure, or the base model cannot be fitted.
    """
    ground, library, untestable = set_up(data, base, parts, options, effects)
    declared = declared_sizes(parts, library)
    rate = options.false_alarm_rate if look is None else look.level(options.false_alarm_rate)
    decided = decide(ground, confirm, rate)
    answer, refuted, scored = decided.answer, decided.refuted, decided.scored
    stage = answer.stage
    findings = _findings(stage, answer, refuted)
    if look is not None:
        findings["look"] = look.record(options.false_alarm_rate)
    residuals: dict[str, NDArray[Any]] = {
        "trial": stage.data.trial,
        "before": (
            np.log(stage.data.lift_N) - confirmation.predict(stage, stage.base_fit, stage.data)
        ),
        "after": np.log(stage.data.lift_N) - confirmation.predict(stage, answer.best, stage.data),
    }
    if scored is not None:
        after = scored.before if refuted else scored.after
        residuals |= {"held_out_before": scored.before, "held_out_after": after}
        findings["error"] = confirmation.error(
            answer, scored, noise.floor(stage.data, stage.noise, stage.slope)
        )
    findings["noise_floor"] = stage.noise.record()
    answers = coefficients_of(answer, declared)
    findings["coefficients"] = answers.block()
    findings["shifts"] = absorption.shifts(stage, answer, findings["coefficients"])
    findings["limits"] = absorption.limits(stage, answer)
    findings["within_trial"] = heating(stage.data, library, rate)
    findings["untestable"] = untestable
    if few(stage.data, base):
        findings["sensitivity"] = sensitivity.sensitivity(
            stage, {name for e in answer.accepted for name in e.effects}
        )
    findings["silent"] = coefficients.silent(stage, library, SILENT)
    findings["next_experiment"] = separation.next_experiment(
        stage, answer
    ) + separation.to_part_visits(findings["limits"])
    error = findings.get("error")
    scores = (
        HeldOutError(
            **{w: error[w]["held_out_rmse"] for w in ("before", "after")},
            noise_floor=error["noise_floor"],
        )
        if error
        else None
    )
    quoted = loop_result.result(
        stage, answer, answers, _correlation(stage, answer, answers.unnamed), scores
    )
    if confirm:
        quoted = stability.told(
            quoted, lambda trial: _without(ground, trial, rate, decided, declared)
        )
    return Diagnosis(findings=findings, residuals=residuals, quoted=quoted)


@dataclass(frozen=True, slots=True, kw_only=True)
class Decided:
    """The search's answer after visits left out had their say: `refuted` are explanations that
    these did not confirm.
    """

    answer: Answer
    refuted: tuple[Explanation, ...]
    scored: confirmation.HeldOut | None

    @property
    def found(self) -> tuple[str, ...] | None:
        """What the search would name, confirmed or not; None where it sees no structure."""
        named = self.refuted or self.answer.accepted
        return (named[0].effects if named else ()) if self.answer.first.present else None


def decide(stage: Stage, confirm: bool, rate: float, like: Decided | None = None) -> Decided:
    """Search, and with `confirm` repeat it without part of the visits; not where the search finds
    what it found in `like`, which then tells.

    `rate` is the false-alarm rate of a claim; a look at a growing campaign has less than the
    options' own, and no other reason for a claim.
    """
    few = few_visits.applies(stage.data)
    answer = few_visits.run(stage) if few else settle(stage)
    early = rate < stage.options.false_alarm_rate
    if early:
        answer = answer.claimed_below((stage if few else answer.stage).null.threshold(rate))
    own = Decided(answer=answer, refuted=(), scored=None)
    if like is not None and own.found == like.found:
        unconfirmed = bool(like.refuted)
        answer = dataclasses.replace(answer, contradicted=like.answer.contradicted)
    else:
        # each fold makes its own choice of how to weigh trials, so it starts from the stage as it
        # was
        named = answer.best.candidate.effects
        scored = (
            confirmation.held_out(
                stage if few else answer.stage, few_visits.choose if few else run, named
            )
            if confirm
            else None
        )
        if scored is not None and not scored.predicted.any():
            # every visit has a throttle or a session that no other visit has
            scored = None
        own = dataclasses.replace(own, scored=scored)
        unconfirmed = (
            scored is not None
            and bool(answer.accepted)
            and not confirmation.improves(answer.stage, scored)
        )
        if answer.verdict == "adequate" and not early:
            answer = dataclasses.replace(
                answer, contradicted=adequacy.contradictions(answer.stage, scored)
            )
    if unconfirmed:
        # what does not help where it was not fitted gets no credit, however well it fits
        return dataclasses.replace(
            own, refuted=answer.accepted, answer=dataclasses.replace(answer, accepted=())
        )
    return dataclasses.replace(own, answer=answer)


def coefficients_of(answer: Answer, declared: dict[str, float]) -> coefficients.Answers:
    """What the coefficients are under every answer that may be right."""
    answers = few_visits.answers if answer.stage.independent else coefficients.answers
    return answers(answer.stage, answer, declared)


def _without(
    ground: Stage, trial: str, rate: float, like: Decided, declared: dict[str, float]
) -> stability.Without:
    """The diagnosis made again without one trial: noise, search and coefficients."""
    data = ground.data.take(ground.data.trial != trial)
    stage = prepare(
        data,
        ground.base,
        ground.effects,
        ground.parts,
        ground.theta,
        ground.options,
        start=ground.noise,
    )
    answer = decide(stage, True, rate, like).answer
    after = coefficients_of(answer, declared).block()["after"]
    intervals = {name: (c["value"], c["lo90"], c["hi90"]) for name, c in after.items()}
    return stability.Without(
        verdict=answer.verdict,
        effects=answer.accepted[0].effects if answer.accepted else (),
        intervals=intervals,
    )


def set_up(
    data: Observations,
    base: LiftModel,
    parts: tuple[budget.Component, ...],
    options: Options,
    effects: tuple[Effect, ...] | None = None,
) -> tuple[Stage, tuple[Effect, ...], list[dict[str, Any]]]:
    """The search's ground: usable trials with derived covariates, testable effects, base fit, noise
    floor.
    """
    kept = data.take(usable(base, data))
    where = f"diagnosis of the {data.boundary}"
    if kept.n and not np.isfinite(kept.z_hat).any():
        raise NotConverged(
            where, "all trials are in free air", "at least two visits near the boundary are wanted"
        )
    if len(np.unique(kept.visit)) == 1 < kept.n:
        raise NotConverged(
            where,
            "all trials belong to one visit",
            "at least two visits are wanted, to leave one out",
        )
    admit(where, kept, base)
    first = fit(base, kept, parts, plan=Plan())
    kept = derive(kept, np.array([first.levels[float(t)].value for t in kept.levels]))
    known, untestable = could_act(kept, base, effects)
    # effects within a trial leave no mark on trial means; they have a test of their own
    between = tuple(e for e in known if "drift_hat" not in e.needs)
    if few(kept, base):
        options = dataclasses.replace(options, pairs=False)
    stage = prepare(
        kept, base, between, inputs.acting(parts, base, first.theta), first.theta, options
    )
    return stage, known, untestable


def declared_sizes(
    parts: tuple[budget.Component, ...], library: tuple[Effect, ...]
) -> dict[str, float]:
    """What the bench declares of an effect's size, in units of its physical prior: a height
    component bounds the datum's offset.
    """
    heights = [
        p.standard for p in parts if p.on == "height" and p.scope in ("boundary", "campaign")
    ]
    sizes = {}
    for effect in library:
        if effect.name == "height_offset" and heights:
            prior = next(p for p in effect.parameters if not p.grid).prior
            sizes[effect.name] = float(np.hypot.reduce(heights)) / prior.scale
    return sizes


def _findings(stage: Stage, answer: Answer, refuted: tuple[Explanation, ...]) -> dict[str, Any]:
    """Verdict, effects, structure and rounds; `refuted` are explanations that held-out visits did
    not confirm.
    """
    found: dict[str, Any] = {
        "base_model": stage.base.name,
        "false_alarm_rate": stage.options.false_alarm_rate,
        "verdict": answer.verdict,
        "effects": [],
    }
    if answer.accepted:
        found["effects"] = _effects(stage, answer)
        found["explanations"] = [list(e.effects) for e in answer.accepted]
    if answer.verdict == "unexplained":
        found["partial"] = _partial(stage, answer)
    if answer.contradicted:
        found["contradicted"] = list(answer.contradicted)
    found["p_value"] = answer.first.p_value
    found["threshold_log10_p"] = answer.first.threshold
    found["structure"] = [
        {
            "covariate": c,
            "family": family,
            "p_value": float(10.0 ** max(p, -300.0)),
            "significant": p < answer.first.threshold,
        }
        for c, (p, family) in answer.first.foremost().items()
    ]
    found["rounds"] = _rounds(dataclasses.replace(answer, accepted=refuted or answer.accepted))
    if refuted:
        found["not_confirmed"] = [list(e.effects) for e in refuted]
        names = ", ".join(e.name for e in refuted)
        found["rounds"].append(
            {
                "candidates": [],
                "decision": "unexplained",
                "reason": f"{names}: nothing is gained on visits that it was not fitted to",
            }
        )
    return found


def _effects(stage: Stage, answer: Answer) -> list[dict[str, Any]]:
    """The named effects of the best explanation, each with the rivals that could stand in its
    place.
    """
    best = answer.accepted[0]
    listed = []
    for effect in best.fitted.candidate.effects:
        others_kept = set(best.effects) - {effect.name}
        rivals = []
        for other in answer.accepted[1:]:
            shared = set(best.effects) & set(other.effects)
            # an explanation of the same length stands in for what it does not share; a longer one
            # tells who may act beside it
            if (
                len(other.effects) > len(best.effects)
                or len(other.effects) == 1
                or others_kept & shared
                or not shared
            ):
                rivals += [name for name in other.effects if name not in best.effects]
        listed.append(
            {
                "name": effect.name,
                "rivals": list(dict.fromkeys(rivals)),
                "parameters": _parameters(stage, best, effect.name),
                "mechanism": effect.mechanism,
            }
        )
    return listed


def _correlation(stage: Stage, answer: Answer, unnamed: FloatArray) -> Correlation:
    """How the best answer's coefficients and effects go together: of all its scalar parameters."""
    fitted = answer.best
    if stage.independent:
        vectors = few_visits.without_each(stage, fitted)
        centred = (
            vectors - vectors.mean(axis=0) if len(vectors) else np.zeros((1, fitted.candidate.size))
        )
        covariance = centred.T @ centred
    else:
        covariance = coefficients.joint(
            stage, fitted, answer.accepted[0].tube if answer.accepted else unnamed
        )
    places = {s.parameter.name: s.start for s in fitted.candidate.slots if s.stop - s.start == 1}
    own = list(places.values())
    return loop_result.correlation(list(places), covariance[np.ix_(own, own)])


def _parameters(stage: Stage, explanation: Explanation, effect: str) -> dict[str, Any]:
    """An effect's fitted parameters with 90 % intervals, its form uncertain; one entry per session
    where it has one each.
    """
    fitted = explanation.fitted
    if stage.independent:
        errors = confirmation.standard_error(few_visits.without_each(stage, fitted))
        return _intervals(fitted, effect, errors, student.quantile(0.95, few_visits.freedom(stage)))
    spread = np.sqrt(np.maximum(np.diag(coefficients.joint(stage, fitted, explanation.tube)), 0))
    return _intervals(fitted, effect, spread, 1.645)


def _intervals(fitted: Fitted, effect: str, u: FloatArray, quantile: float) -> dict[str, Any]:
    result = {}
    for slot in fitted.candidate.slots:
        if slot.effect != effect:
            continue
        for i in range(slot.start, slot.stop):
            name = (
                slot.parameter.name
                if slot.stop - slot.start == 1
                else f"{slot.parameter.name}[{i - slot.start}]"
            )
            v, half = fitted.vector[i], quantile * u[i]
            result[name] = {
                "value": v,
                "lo90": v - half,
                "hi90": v + half,
                "unit": slot.parameter.unit,
            }
    return result


def _partial(stage: Stage, answer: Answer) -> list[dict[str, Any]]:
    """What the best single effects would explain of the structure, as shares of the chi2 that
    exceeds the noise.
    """
    # a size that is not possible earns no share
    ranked = sorted((s for s in answer.singles if not s.fitted.at_bound), key=lambda s: -s.gain)[:3]
    # noise that happens to be small elsewhere can leave less in sum than one effect takes
    whole = max(stage.excess, *(s.gain for s in ranked), 0.0)
    return [{"name": s.name, "share": s.gain / whole} for s in ranked if s.gain > 0.05 * whole]


def _rounds(answer: Answer) -> list[dict[str, Any]]:
    """What was tried, in order, with the reason for each decision."""
    first = answer.first
    if answer.contradicted:
        return [
            {"candidates": [], "decision": "unexplained", "reason": "; ".join(answer.contradicted)}
        ]
    if not first.present:
        return [
            {
                "candidates": [],
                "decision": "adequate",
                "reason": (
                    f"nothing exceeds the threshold (p = {first.p_value:.3g} for the largest of all"
                    " tests)"
                ),
            }
        ]

    def listing(tried: tuple[Explanation, ...]) -> list[dict[str, Any]]:
        rows = [
            {
                "name": e.name,
                "gain": e.gain,
                "p_value": e.left.p_value,
                "accepted": e.accepted,
                "sizes": _sizes(e),
                "at_bound": e.fitted.at_bound,
                "log_evidence": e.log_evidence,
                "plausibility": e.plausibility,
                "left_in": next(iter(e.left.by_covariate()), None) if e.left.present else None,
            }
            for e in tried
        ]
        return sorted(rows, key=lambda r: -r["log_evidence"])

    if answer.stage.independent:
        return [_sweep(listing, tried, answer) for tried in (answer.singles, answer.pairs) if tried]
    rounds = []
    enough = "nothing is left beyond the threshold"
    if answer.accepted and answer.accepted[0].confirmed:
        share = min(answer.accepted[0].gain / answer.stage.excess, 1.0)
        enough = (
            f"accounts for {100 * share:.0f} % of the structure; the declared form is not quite the"
            " true one"
        )
    single = any(s.accepted for s in answer.singles) and not (
        answer.accepted and len(answer.accepted[0].effects) > 1
    )
    alone = [s for s in answer.singles if s.accepted]
    why_not = (
        "each one leaves structure beyond the threshold, or explains too little"
        + _impossible(answer)
    )
    if alone and not single:
        why_not = (
            f"{max(alone, key=lambda e: e.log_evidence).name} would do, but two effects are plainly"
            " likelier: its form would have to be far off"
        )
    rounds.append(
        {
            "candidates": listing(answer.singles),
            "decision": (
                f"accept {answer.accepted[0].name}" if single else "no single effect will do"
            ),
            "reason": enough if single else why_not,
        }
    )
    if not single:
        pair = bool(answer.accepted)
        rounds.append(
            {
                "candidates": listing(answer.pairs)[:12],
                "decision": f"accept {answer.accepted[0].name}" if pair else "unexplained",
                "reason": enough if pair else "no pair of declared effects does better",
            }
        )
    return rounds


def _sizes(explanation: Explanation) -> dict[str, float]:
    """What an explanation's parameters would be, those aside that differ by session."""
    slots = explanation.fitted.candidate.slots
    return {
        s.parameter.name: float(explanation.fitted.vector[s.start])
        for s in slots
        if s.effect and s.stop - s.start == 1
    }


def _impossible(answer: Answer) -> str:
    """Which single effects could account for a fair share, were their size possible; empty if none
    could.
    """
    share = FAIR_SHARE * answer.stage.excess
    ends = [
        f"{e.name} ({_at_end(e)})"
        for e in sorted(answer.singles, key=lambda e: -e.gain)
        if e.fitted.at_bound and e.gain > share
    ]
    return (
        f"; refused, since the size that it takes is not possible: {', '.join(ends)}"
        if ends
        else ""
    )


def _at_end(explanation: Explanation) -> str:
    """The sizes that stand at an end of their range."""
    ends = {
        p.name: p.bounds
        for e in explanation.fitted.candidate.effects
        for p in e.parameters
        if not p.grid
    }
    return ", ".join(
        f"{name} runs into {size:.3g}"
        for name, size in _sizes(explanation).items()
        if size in ends.get(name, ())
    )


def _sweep(
    listing: Callable[[tuple[Explanation, ...]], list[dict[str, Any]]],
    tried: tuple[Explanation, ...],
    answer: Answer,
) -> dict[str, Any]:
    """A round in which visits left out decided."""
    # what is left decides nothing here
    rows = [{**row, "left_in": None, "judged_by": "visits left out"} for row in listing(tried)]
    chosen = [e for e in tried if e.accepted]
    visits = len(np.unique(answer.stage.data.visit))
    if chosen:
        best = max(chosen, key=lambda e: e.log_evidence)
        return {
            "candidates": rows,
            "decision": f"accept {best.name}",
            "reason": f"predicts visits left out best ({visits} visits, each in turn)",
        }
    reason = (
        "none predicts visits left out better by more than chance and by most of what is not noise"
        f" ({visits} visits, each in turn)"
    )
    return {"candidates": rows, "decision": "add nothing", "reason": reason}
