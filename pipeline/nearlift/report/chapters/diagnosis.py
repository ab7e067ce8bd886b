"""Findings of the closed loop: the facts of each boundary's section."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from markupsafe import Markup

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import BOUNDARIES, Boundary, Effect
from nearlift.report import blocks, sources, tables, words
from nearlift.report.evidence import Evidence
from nearlift.report.findings import RankedCandidate, ranked
from nearlift.report.number import Number, Place, Quoted
from nearlift.report.phrases import along, listed
from nearlift.results.diagnosis import BoundaryDiagnosis, LoopError, NamedEffect
from nearlift.rounding import plain
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import RESULTS

#: So many lines of structure, and of silent effects, are shown.
MAX_LINES = 12
#: More parameters than this (a gain for every session) are shown by their range.
MAX_SIZES = 3
#: Nearer to a bound than this part of the allowed range, a parameter is at it.
AT_BOUND = 1e-6


def facts(evidence: Evidence) -> Markup:
    """A section for each boundary that was diagnosed, and why the others were not."""
    rate = Place(evidence, DIAGNOSIS, ("false_alarm_rate",))
    known = rate.content is not None
    return blocks.join(
        blocks.paragraph("False-alarm rate: {} % per boundary.", rate.percent(digits=3))
        if known
        else "",
        *(
            blocks.join(
                blocks.heading(f"{b.capitalize()}: not diagnosed"),
                blocks.paragraph(
                    "{}. The coefficients may include effects of any size.",
                    reason[0].upper() + reason[1:],
                ),
            )
            for b in BOUNDARIES
            if (reason := evidence.not_diagnosed(b))
        ),
        *(
            blocks.join(*_section(evidence, b, diagnosis))
            for b in BOUNDARIES
            if (diagnosis := evidence.diagnosed(b))
        ),
    )


def _section(evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis) -> list[Markup]:
    place = Place(evidence, DIAGNOSIS, ("boundaries", boundary))
    candidates = ranked(diagnosis)
    effects = _effects(evidence, boundary, place, diagnosis)
    verdict = Markup('<p class="verdict">{}</p>').format(
        tables.typeset(words.verdict(evidence, boundary))
    )
    return [
        blocks.heading(boundary.capitalize()),
        verdict,
        _residuals(place, diagnosis),
        *(_effect(e, candidates) for e in effects),
        _unexplained(place, diagnosis),
        _error(place, diagnosis, evidence.left_out),
        _within_trial(place, diagnosis),
        *(blocks.paragraph("{}", tables.typeset(limit.text)) for limit in diagnosis.limits),
        _untestable(diagnosis),
        *(_next(place.at("next_experiment", i)) for i in range(len(diagnosis.next_experiment))),
        *(_sizes(e) for e in effects if len(e.sizes) > MAX_SIZES),
        _structure(place, diagnosis),
        _candidates(place, diagnosis, candidates),
        _silent(place, diagnosis),
    ]


def _p(p: Number) -> Markup:
    return Markup("<i>p</i> {}{}").format("" if p.text.startswith("<") else "= ", p)


def _residuals(place: Place, diagnosis: BoundaryDiagnosis) -> Markup:
    """Covariates that the residuals of the base model follow."""
    tested = place.content.get("p_value") is not None
    largest = (
        Markup(" {} for the largest of all tests.").format(_p(place.chance("p_value")))
        if tested
        else ""
    )
    look = f"{diagnosis.look.text[0].upper()}{diagnosis.look.text[1:]}. " if diagnosis.look else ""
    lines = [
        (
            s,
            Markup("{} ({})").format(
                along(s.covariate), _p(place.chance("structure", i, "p_value"))
            ),
        )
        for i, s in enumerate(diagnosis.structure[:MAX_LINES])
    ]
    if diagnosis.verdict == "adequate":
        return blocks.paragraph("{}No effect was added to the model.{}", look, largest)
    shown = [line for s, line in lines if s.significant] or [line for _, line in lines[:1]]
    also = Markup(" They also vary with {}, probably for the same reason.").format(
        Markup(" and ").join(filter(None, (Markup(", ").join(shown[1:3]), *shown[3:4])))
    )
    return blocks.paragraph(
        "{}The residuals of the base model follow {}.{}{}",
        look,
        shown[0] if shown else "no single covariate",
        also if len(shown) > 1 else "",
        largest,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectFacts:
    """An identified effect with its sizes; `at_bound` where one is at the end of its range."""

    effect: NamedEffect
    title: str
    rivals: str
    sizes: list[Quoted]
    at_bound: bool


def _effects(
    evidence: Evidence, boundary: Boundary, place: Place, diagnosis: BoundaryDiagnosis
) -> list[EffectFacts]:
    """Identified effects; a size as results.json quotes it."""
    known = {e.name: e for e in catalogue.effects()}
    here = Place(evidence, RESULTS, ("boundaries", boundary, "sizes"))
    quotes = {
        (s.effect, s.parameter): here.quote(i, name=s.parameter)
        for i, s in enumerate(evidence.quoted(boundary).sizes)
    }
    listed_effects = []
    for i, effect in enumerate(diagnosis.effects):
        declared = known.get(effect.name)
        sizes = {p.name for p in declared.parameters if not p.grid} if declared else set()
        quoted = [
            _marked(
                place.quote("effects", i, "parameters", name),
                declared,
                quotes.get((effect.name, name)),
            )
            for name in effect.parameters
        ]
        rivals = [titled(o.replace(" + ", " with ")) for o in diagnosis.stand_ins(effect)]
        title = titled(effect.name)
        listed_effects.append(
            EffectFacts(
                effect=effect,
                title=title[0].upper() + title[1:],
                rivals=listed(rivals, "or"),
                sizes=quoted,
                # that a length or an exponent is at an end is no wonder; a size there is
                # implausible
                at_bound=any(q.at_bound and q.name.partition("[")[0] in sizes for q in quoted),
            )
        )
    return listed_effects


def _marked(quoted: Quoted, effect: Effect | None, size: Quoted | None) -> Quoted:
    """The size if there is one, else the parameter; marked where the fit ended at a bound."""
    for p in effect.parameters if effect is not None else ():
        low, high = p.bounds
        if p.name == quoted.name.partition("[")[0] and min(
            quoted.value.value - low, high - quoted.value.value
        ) < AT_BOUND * (high - low):
            return dataclasses.replace(size or quoted, at_bound=True)
    return size or quoted


def _effect(e: EffectFacts, candidates: list[RankedCandidate]) -> Markup:
    """Mechanism and sizes of an effect, and why it was identified."""
    ends = sorted(e.sizes, key=lambda q: q.value.value)
    shown = Markup(", ").join(e.sizes)
    if len(e.sizes) > MAX_SIZES:
        shown = Markup("{} values, from {} to {}").format(
            len(e.sizes), ends[0].estimate, ends[-1].estimate
        )
    why = ""
    if e.rivals:
        why = f" This design cannot distinguish it from {e.rivals}."
    elif sum(c.tried.accepted for c in candidates) > 1:
        why = " Other candidates fit, but their evidence is too low to be rivals."
    bound = " Its size is at a bound of its plausible range, which makes it doubtful."
    return blocks.paragraph(
        "{}{}{}.{}{}",
        blocks.bold(e.title),
        f": {e.effect.mechanism}" if e.effect.mechanism else "",
        Markup("; {}").format(shown) if shown else "",
        bound if e.at_bound else "",
        why,
    )


def _unexplained(place: Place, diagnosis: BoundaryDiagnosis) -> Markup:
    """Partial explanations, and what the intervals include instead."""
    if diagnosis.verdict != "unexplained":
        return Markup("")
    refuted = listed([titled(" + ".join(n)) for n in diagnosis.not_confirmed or ()], "or")
    text = (
        f"Fitted to all trials, {refuted} would explain it. It does not improve the prediction of"
        " visits left out, so it is not identified."
        if refuted
        else "No candidate effect, alone or in pairs, explains it."
    )
    shares = Markup(", ").join(
        Markup("{} ({} % of what exceeds the noise)").format(
            titled(p.content["name"]), p.percent("share", digits=2)
        )
        for p in (place.every("partial") if diagnosis.partial else ())
    )
    carried = listed([along(c) for c in diagnosis.coefficients.carried])
    include = f"; their intervals include an unexplained dependence on {carried}" if carried else ""
    return blocks.paragraph(
        "{}{} The coefficients are the base model's{}.",
        text,
        Markup(" Partial explanations: {}.").format(shares) if shares else "",
        include,
    )


def _of_lift(place: Place, *path: str, digits: int = 3) -> Number:
    return place.percent(*path, digits=digits, how="in percent of lift")


def _error(place: Place, diagnosis: BoundaryDiagnosis, left_out: str) -> Markup:
    """Cross-validated error before and after, its change, and the answers of the folds."""
    at = place.at("error")
    if not at.content:
        return Markup("")
    before, after = (
        Markup("{} %{}").format(
            _of_lift(e, "held_out_rmse"),
            blocks.span("90 %: {} to {}", _of_lift(e, "lo90"), _of_lift(e, "hi90")),
        )
        for e in (at.at("before"), at.at("after"))
    )
    floor = _of_lift(at, "noise_floor")
    head = "Cross-validated over {}, the error is {} of lift; noise floor {} %."
    if diagnosis.verdict != "effect":
        return blocks.paragraph(head, left_out, before, floor)
    how = outcome(diagnosis.error)
    change, value = at.at("change"), ""
    if change.content and change.content["lo90"] is not None:
        low, high = (change.percent(k, digits=2) for k in ("lo90", "hi90"))
        text = " Visit by visit, the change is {} %{}."
        span = blocks.span("90 %: {} to {}", low, high)
        value = Markup(text).format(change.percent("value", digits=2), span)
    remark = {
        "same": " This change is not significant.",
        "rises": " The correction makes predictions worse: do not predict with it.",
        "falls": " What remains is noise." if how["at_floor"] else "",
    }[str(how["word"])]
    if not how["at_floor"]:
        remark += " It is above the noise floor: the correction is incomplete."
    verb = {"falls": "falls from", "rises": "rises from", "same": "goes from"}[str(how["word"])]
    return blocks.paragraph(
        "Cross-validated over {}, the error {} {} of lift to {}; noise floor {} %.{}{}{}",
        left_out,
        verb,
        before,
        after,
        floor,
        value,
        remark,
        _folds(place, diagnosis),
    )


def _folds(place: Place, diagnosis: BoundaryDiagnosis) -> Markup:
    """How many folds, searched without the visits held out, came to the same answer."""
    chosen = diagnosis.error.chosen_in_folds if diagnosis.error else ()
    if not chosen:
        return Markup("")
    named = {e.name for e in diagnosis.effects}
    same = sum({part.strip() for part in c.split("+")} == named for c in chosen)
    source = place.source("error", "chosen_in_folds")
    numbers = [
        Number(text=str(n), value=float(n), source=source, how=how)
        for n, how in ((same, "count of the same answer"), (len(chosen), "count"))
    ]
    text = (
        " Repeated searches without the held-out trials gave the same answer in {} of {} folds.{}"
    )
    each = " The error after is that of each fold's own choice." if same < len(chosen) else ""
    return Markup(text).format(*numbers, each)


def _within_trial(place: Place, diagnosis: BoundaryDiagnosis) -> Markup:
    """Change of lift within a record."""
    within = diagnosis.within_trial
    if not within:
        return Markup("")
    at = place.at("within_trial", "change_over_record")
    value, low, high = (_of_lift(at, k, digits=2) for k in ("value", "lo90", "hi90"))
    names = listed([titled(c) for c in within.candidates], "or")
    significant = Markup(" significantly ({}){}").format(
        _p(place.chance("within_trial", "p_value")), f": {names}" if names else ""
    )
    return blocks.paragraph(
        "Within a record, lift changes by {} %{}{}.",
        value,
        blocks.span("90 %: {} to {}", low, high),
        significant if within.significant else ": not significant",
    )


def _untestable(diagnosis: BoundaryDiagnosis) -> Markup:
    """Effects that a small or unlogged campaign cannot test."""
    parts = []
    if could := diagnosis.sensitivity:
        effects = listed([titled(e) for e in could.effects])
        text = "With {} trials only single effects were tested: {}. They {}."
        parts.append(blocks.paragraph(text, could.trials, effects, titled(str(could))))
    if diagnosis.not_testable:
        names = ", ".join(titled(u.effect) for u in diagnosis.not_testable)
        text = "Untestable here: {}. {} {}."
        log = ", ".join(words.to_log(diagnosis))
        parts.append(blocks.paragraph(text, names, blocks.bold("Log next time:"), log))
    return blocks.join(*parts)


def _next(at: Place) -> Markup:
    """An experiment that would distinguish, with its cost and alternatives."""
    n = at.content
    pair = " from ".join(titled(s) for s in n.get("separates") or ())
    known = n.get("trials") and n.get("expected_evidence")
    numbers = [at.number("trials", digits=6), at.number("expected_evidence", digits=2)]
    cost = Markup(" ({} trials, expected 2 ln <i>B</i> = {})").format(*numbers)
    others = Markup("; ").join(
        Markup("{} ({})").format(
            tables.typeset(o.content["measure"]), o.number("expected_evidence", digits=2)
        )
        for o in (at.every("alternatives") if n.get("alternatives") else ())
    )
    return blocks.paragraph(
        "{} {}{}{}.{}",
        blocks.bold("Next:"),
        tables.typeset(n["measure"]),
        f", to distinguish {pair}" if pair else "",
        cost if known else "",
        Markup(" Instead: {}.").format(others) if others else "",
    )


def _sizes(e: EffectFacts) -> Markup:
    return blocks.fold(f"{e.title}: all {len(e.sizes)} numbers", blocks.items(e.sizes))


def _structure(place: Place, diagnosis: BoundaryDiagnosis) -> Markup:
    """Tests of residual structure, the most significant first."""
    rows = [
        (
            along(s.covariate).capitalize(),
            place.chance("structure", i, "p_value"),
            "yes" if s.significant else "no",
        )
        for i, s in enumerate(diagnosis.structure[:MAX_LINES])
    ]
    if not rows:
        return Markup("")
    caption = f"Tests of residual structure ({len(rows)} covariates)"
    heads = ("covariate", "p of its most significant test", "significant among all tests")
    return blocks.fold(caption, blocks.table(caption, heads, rows, hidden=True))


def _candidates(
    place: Place, diagnosis: BoundaryDiagnosis, candidates: list[RankedCandidate]
) -> Markup:
    """Every candidate with its gain, its evidence and what it leaves."""
    if not candidates:
        return Markup("")
    by_visits = any(c.judged_by for r in diagnosis.rounds for c in r.candidates)
    rows = []
    for c in candidates:
        i, j = c.place
        at = place.at("rounds", i, "candidates", j)
        behind = Number(
            text=plain(c.behind, 3),
            value=c.behind,
            source=at.source("log_evidence"),
            how="less that of the best, times −2",
        )
        leaves = "nothing" if c.tried.accepted else "too little explained"
        if c.tried.left_in:
            leaves = along(c.tried.left_in)
        elif by_visits:
            leaves = "decided by visits left out"
        name = titled(c.tried.name)
        name = f"{name[0].upper()}{name[1:]}{' (accepted)' if c.tried.accepted else ''}"
        rows.append((name, at.number("gain", places=1), behind, leaves))
    rounds = " ".join(
        f"Round {i}: {titled(r.decision)}: {titled(r.reason)}."
        for i, r in enumerate(diagnosis.rounds, 1)
    )
    caption = f"Every candidate, with the reason ({len(rows)})"
    heads = ("candidate", "drop of χ²", "2 ln B behind the best accepted", "leaves")
    return blocks.fold(
        caption,
        blocks.paragraph("{}", tables.typeset(rounds)),
        blocks.table(caption, heads, rows, hidden=True),
    )


def _silent(place: Place, diagnosis: BoundaryDiagnosis) -> Markup:
    """Effects that the coefficients can absorb."""
    lines = [
        (s, place.at("silent", i))
        for i, s in enumerate(diagnosis.silent[:MAX_LINES])
        if not sources.is_the_coefficient(s)
    ]
    if not lines:
        return Markup("")
    rows = []
    for s, at in lines:
        hidden = blocks.note("at its plausible size: not detectable here") if s.hidden else ""
        bias = Markup("{}{}").format(at.number("bias_at_detection_limit", digits=2), hidden)
        title = titled(s.effect)
        rows.append((title[0].upper() + title[1:], titled(s.absorbed_by), bias))
    first, at = lines[0]
    unit = Markup(" with {} = {}").format(
        tables.typeset(first.in_units_of), at.number("u", digits=2)
    )
    title = f"Effects that the coefficients can absorb ({len(rows)})"
    caption = Markup("{}{}").format(title, unit if at.content["u"] is not None else "")
    heads = ("effect", "absorbed by", "bias at the detection limit, in u of the base fit")
    return blocks.fold(title, blocks.table(caption, heads, rows))


def outcome(error: LoopError | None) -> dict[str, object]:
    """How the held-out error moved: `falls`, `rises`, or `same` where the interval of its change,
    visits in pairs, holds none.

    Without a change on record the two errors' own intervals decide, `same` where they overlap. Also
    whether the floor is met.
    """
    if not error:
        return {}
    before, after = error.before, error.after
    known = all(math.isfinite(x) for e in (before, after) for x in (e.lo90, e.hi90))
    low, high = (error.change.lo90, error.change.hi90) if error.change else (math.nan, math.nan)
    if not (math.isfinite(low) and math.isfinite(high)):
        low, high = (after.lo90 - before.hi90, after.hi90 - before.lo90) if known else (-1.0, 1.0)
    return {
        "word": "falls" if high < 0 else "rises" if low > 0 else "same",
        "at_floor": known and after.lo90 <= error.noise_floor,
        "lower": after.held_out_rmse < before.held_out_rmse,
    }
