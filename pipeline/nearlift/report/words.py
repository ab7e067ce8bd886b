"""Sentences of a report: verdict, sizes of effects, omitted errors, doubts and next steps.

Page, summary, methods, captions and messages take their sentences from here.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import Boundary, FloatArray
from nearlift.likelihood.budget import components
from nearlift.likelihood.noise import REPEATS
from nearlift.nomenclature import letter, noun
from nearlift.reduction.quality import CODES, rejected
from nearlift.report import relative_lift
from nearlift.report.evidence import Evidence, Reported, pick
from nearlift.report.figures import downwash
from nearlift.report.phrases import (
    SCALES,
    along,
    chance,
    dependence,
    explanation,
    is_sure,
    listed,
    probability,
    random_walk,
    sentence,
    several,
    sizes,
    structure_along,
)
from nearlift.report.sources import (
    PlausibleError,
    leads,
    missing_for,
    undeclared,
    undetected,
)
from nearlift.report.tables import coefficients, csv, reported
from nearlift.results.diagnosis import BoundaryDiagnosis, NamedEffect
from nearlift.results.fit import Suspect
from nearlift.results.levels import LevelFit
from nearlift.results.outlook import NextExperiment, NextSession, Sensitivity
from nearlift.results.quotation import BoundaryResult, CoefficientResult
from nearlift.rounding import decimals, fixed, like, plain, plus_minus, signed
from nearlift.schedule import BY_NAME
from nearlift.stages.diagnose import DIAGNOSIS, NOT_DIAGNOSED
from nearlift.stages.fit import FIT
from nearlift.stages.flow import DOWNWASH
from nearlift.stages.ingest import TRIALS

#: A base model whose chi2 has a smaller p-value than this is rejected.
REJECTED_P = 1e-3
#: Stations nearer than `NEAR_HAT` rotor radii leave lift in free air undetermined; from `FAR_HAT`
#: on they do not (docs/planning.md).
NEAR_HAT, FAR_HAT = 6.0, 12.0
#: A further source is printed where u without it is below this part of u.
SMALL = 0.8
#: Errors of inputs below this part of u are not listed.
LEAST_IN_U = 0.01
INPUT_WORDS = {
    "rotor_radius": "rotor radius",
    "rotor_spacing": "rotor spacing",
    "height": "distance datum",
}
#: Reasons of rejected trials that are listed.
MAX_REASONS = 3
#: Rivals in a sentence; the table of other assumptions has all.
MAX_RIVALS = 3
#: Detection limits in a sentence; the chapter's table has all.
MAX_POWERS = 2
#: An experiment of so many times the campaign's trials is not proposed.
MOST_REPEATS = 10
#: Change of lift whose distance is printed.
SEEN = 0.02
#: Inputs of the load cell in `[[uncertainty]] on`.
CELL = {"force", "gain", "linearity"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Brief:
    """Sentences about one boundary, each empty where there is nothing to say.

    Attributes
    ----------
    verdict : str
    quoted : BoundaryResult
    omits : str
        Inputs whose error is in no interval.
    error, sources, influence : str
        Of the headline coefficient.
    reach, flow : str
        Distance of a lift change of 2 %; downwash measured by PIV against the lift model's.
    doubts : tuple of str
        The most serious first.
    next : str
        What to measure next.
    change : str
        Difference from the last report; empty where this is the first, or equal.
    """

    boundary: Boundary
    verdict: str
    quoted: BoundaryResult
    omits: str
    error: str
    sources: str
    doubts: tuple[str, ...]
    influence: str
    reach: str
    flow: str
    next: str
    change: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Reservation:
    """A reason to doubt headlines, and their boundaries: none where it concerns the campaign."""

    boundaries: tuple[str, ...]
    text: str


def to_log(diagnosis: BoundaryDiagnosis | None) -> list[str]:
    """Quantities to record next time, once each."""
    every = diagnosis.untestable.values() if diagnosis else ()
    return list(dict.fromkeys(word for words in every for word in words))


def rivals_of(diagnosis: BoundaryDiagnosis | None, last: str = "or") -> str:
    """Rivals of the identified effects, by title; empty where there are none."""
    rivals = [r for e in diagnosis.effects for r in diagnosis.stand_ins(e)] if diagnosis else []
    return listed([*dict.fromkeys(titled(r.replace(" + ", " with ")) for r in rivals)], last)


def briefs(evidence: Evidence) -> list[Brief]:
    """Sentences about every boundary."""
    # doubts about one boundary come before those shared by several
    every = sorted(doubts(evidence), key=lambda d: len(d.boundaries) != 1)
    return [
        Brief(
            boundary=b,
            verdict=verdict(evidence, b),
            quoted=(quoted := evidence.quoted(b)),
            omits=_omits(evidence, b),
            error=error(quoted, evidence.left_out),
            sources=_sources(quoted),
            doubts=tuple(
                d.text
                for d in every
                # `omits` says the same with the number
                if (b in d.boundaries or not d.boundaries) and d.text != _inputs(evidence, b)
            ),
            influence=influence(quoted),
            reach=reach(evidence, b),
            flow=flow(evidence, b),
            next=_next(evidence, b, quoted),
            change=_change(evidence, b),
        )
        for b in evidence.boundaries
    ]


def removed(evidence: Evidence) -> str:
    """Trials left out with their reasons, and readings.

    Examples: ``none left out``; ``1 left out: the cell saturated (1); 12 impossible readings in 3
    trials were left out``.
    """
    table = evidence.table(TRIALS)
    out = rejected(table["quality"])
    names = Counter(n for q in table["quality"][out] for n in q.split() if n.isupper())
    why = [f"{CODES[n]} ({k})" for n, k in names.most_common(MAX_REASONS)]
    said = f"{int(out.sum()) or 'none'} left out" + (f": {listed(why)}" if why else "")
    if "n_removed" in table:
        readings = [int(n) for n in table["n_removed"].tolist() if n == n and n > 0]
        if readings:
            n, trials = sum(readings), len(readings)
            reading = "readings" if n != 1 else "reading"
            said += (
                f"; {n} impossible {reading} in {trials} {'trials' if trials != 1 else 'trial'}"
                f" {'were' if n != 1 else 'was'} left out"
            )
    return said


# verdict


def verdict(evidence: Evidence, boundary: Boundary) -> str:
    """Verdict of a boundary, with the identified effect's size."""
    quoted, diagnosis = evidence.quoted(boundary), evidence.diagnosed(boundary)
    model = catalogue.model(quoted.base_model).title
    if quoted.verdict == "adequate":
        few = diagnosis.sensitivity if diagnosis else None
        within = f" in {few.trials} trials" if few else ""
        return f"{model} fits; no residual structure detected{within}."
    if quoted.verdict == "effect":
        named = sentence(listed([titled(e) for e in quoted.effects])).removesuffix(".")
        verb = "explain" if len(quoted.effects) > 1 else "explains"
        size = sizes(quoted, evidence.campaign.vehicle.rotor_radius)
        if not is_sure(quoted) and diagnosis and diagnosis.probabilities:
            causes = explanation(quoted, diagnosis)
            under = f" If it is {listed([titled(e) for e in quoted.effects])}: {size}."
            return (
                f"{model} alone does not fit. The residuals are explained by {causes}."
                f"{under if size else ''}"
            )
        # a rival has a size of its own
        colon = f": {size}" if size and len(quoted.effects) == 1 else ""
        also = f" {sentence(size)}" if size and not colon else ""
        return (
            f"{model} alone does not fit. {named} {verb} the residuals"
            f"{probability(quoted)}{colon}.{also}"
            f"{_not_distinguished(quoted, diagnosis)}"
        )
    if quoted.verdict == "unexplained":
        where = structure_along(diagnosis) if diagnosis else ""
        text = f"{model} does not fit: residuals vary with {where}." if where else ""
        text = text or f"{model} does not fit."
        fits = (
            [titled(" with ".join(p)) for p in (diagnosis.not_confirmed or ())] if diagnosis else []
        )
        if not fits:
            return f"{text} No effect testable here explains them."
        names = listed(fits, "or") if len(fits) < 3 else f"{fits[0]} or {len(fits) - 1} others"
        but = f"but without better predictions of {evidence.left_out} left out"
        return f"{text} {sentence(f'{names} would fit, {but}')}"
    return f"Not diagnosed: {quoted.reason.removesuffix(f'; {quoted.wanted}')}."


def _not_distinguished(quoted: BoundaryResult, diagnosis: BoundaryDiagnosis | None) -> str:
    """The sentence on rivals, empty where there are none."""
    rivals = [r for e in diagnosis.effects for r in diagnosis.stand_ins(e)] if diagnosis else []
    further = {n for r in rivals for n in r.split(" + ")} - {*quoted.effects}
    if rivals and further and all(" + " in r for r in rivals):
        pairs = listed([titled(n) for n in sorted(further)], "or")
        return f" It may act alone or with {pairs}; this design cannot distinguish these."
    return f" This design cannot distinguish it from {rivals_of(diagnosis)}." if rivals else ""


def findings(evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis) -> list[str]:
    """Further findings of the loop at a boundary, a sentence or two each."""
    quoted = evidence.quoted(boundary)
    said = [diagnosis.look.text] if diagnosis.look else []
    if held_out := error(quoted, evidence.left_out):
        said.append(f"cross-validated error: {held_out}")
    if diagnosis.error and (folds := diagnosis.error.chosen_in_folds):
        named = {e.name for e in diagnosis.effects} or {diagnosis.verdict}
        same = sum({part.strip() for part in c.split("+")} == named for c in folds)
        said.append(
            "repeated searches without the held-out trials gave the same answer in"
            f" {same} of {len(folds)} folds"
        )
    if carried := diagnosis.coefficients.carried:
        along_them = listed([along(c) for c in carried])
        said.append(f"the intervals include an unexplained dependence on {along_them}")
    if within := diagnosis.within_trial:
        change = within.change_over_record
        u = (change.hi90 - change.lo90) / 3.3
        ends = (change.value, change.lo90, change.hi90)
        value, low, high = (like(100 * x, 100 * u) for x in ends)
        names = listed([titled(c) for c in within.candidates], "or")
        cause = f", as by {names}" if within.significant and names else ""
        said.append(f"within a record, lift changes by {value} % (90 %: {low} to {high}){cause}")
    if could := diagnosis.sensitivity:
        said += [f"with {could.trials} trials only single effects were tested", power(could)]
    said += [limit.text for limit in diagnosis.limits]
    return [sentence(text) for text in said]


def power(could: Sensitivity) -> str:
    """Effects that a few trials could have detected."""
    texts = [titled(row.text) for row in could.limits if row.size is not None]
    if not texts:
        return f"{could.trials} trials could not have detected any effect of a possible size"
    few = texts if len(texts) <= MAX_POWERS + 1 else texts[:MAX_POWERS]
    more = len(texts) - len(few)
    names = [*few, *([f"{more} others"] if more else [])]
    power = f"with {100 * could.chance:.0f} % power each"
    return f"{could.trials} trials could have detected {listed(names)}, {power}"


# the number


def level_curve(fit: LevelFit) -> str:
    """Sentences on the curve of L_inf: its variables, degree and cross-validated error."""
    curve = fit.curve
    words = [along(name.rpartition("_")[0] or name) for name in curve.of]
    errors = ", ".join(f"{100 * e:.2f} % (degree {d})" for d, e in fit.held_out.items())
    return (
        f"log L∞ is a polynomial of degree {curve.degree} in the logarithms of {listed(words)}."
        f" Cross-validated error over visits: {errors}. The table is at the medians."
    )


def _omits(evidence: Evidence, boundary: Boundary) -> str:
    """Inputs without a stated uncertainty, each with the shift by a plausible error."""
    name = noun(evidence.quoted(boundary).headline)
    errors = [e for e in undeclared(evidence, boundary) if e.in_u > LEAST_IN_U]
    words = []
    for i, e in enumerate(errors):
        shift = f": {plain(e.shift, 2)}" if i else f" shifts {name} by {plain(e.shift, 2)}"
        largest = "largest; " if not i and len(errors) > 1 else ""
        words.append(f"{INPUT_WORDS[e.on]} ({largest}{_error_size(e)}{shift})")
    if words and not {part.on for part in components(evidence.campaign)} & CELL:
        words.append("load cell")
    them = "them" if len(words) > 1 else "it"
    return f"Not included: {listed(words)}. No uncertainty is stated for {them}." if words else ""


def error(quoted: BoundaryResult, left_out: str) -> str:
    """Cross-validated error before and after, in percent of lift."""
    error = quoted.error
    if error is None:
        return ""
    places = max(decimals(100 * error.noise_floor) + 1, 1) if error.noise_floor > 0 else 2
    before, after, floor = (
        fixed(100 * e, places) for e in (error.before, error.after, error.noise_floor)
    )
    then = f", {after} % with the effect" if quoted.verdict == "effect" else ""
    return f"{before} % of lift on {left_out} left out of the fit{then}; noise floor {floor} %"


def _sources(quoted: BoundaryResult) -> str:
    """The headline's u, and u without each source that matters."""
    if not quoted.headline:
        return ""
    c = quoted.coefficients[quoted.headline]
    sources = leads(c)
    if not sources:
        return ""
    (first, u), *rest = sources
    mostly = "mostly" if u < c.u / 2 else "from"
    whole = f"u({letter(quoted.headline)}) = {plain(c.u, 2)}"
    text = f"{whole}, {mostly} {titled(first)} ({plain(u, 2)} without it)"
    return (
        text
        + "".join(f", {titled(name)} ({plain(u, 2)})" for name, u in rest if u < SMALL * c.u)
        + "."
    )


def influence(quoted: BoundaryResult) -> str:
    """The trial and the visit that move the headline most."""
    name = quoted.headline
    if not name:
        return ""
    c = quoted.coefficients[name]
    if not 0 < c.u < math.inf:
        return ""
    places = decimals(c.u) + 1
    moves = [
        (f"{kind} {one.id}", signed(one.shift, places))
        for kind, one in (("trial", c.influence.trial), ("visit", c.influence.visit))
        if one is not None and float(f"{one.shift:.{places}f}")
    ]
    if not moves:
        return ""
    (first, shift), *rest = moves
    return (
        f"Most influential: {first} ({letter(name)} {shift} without it)"
        + "".join(f", {other} ({moved})" for other, moved in rest)
        + "."
    )


def reach(evidence: Evidence, boundary: Boundary) -> str:
    """Distance at which the quoted model's lift change is `SEEN`; empty beyond the trials."""
    z_hat = evidence.observations[boundary].z_hat
    z_hat = z_hat[np.isfinite(z_hat) & (z_hat > 0)]
    if not len(z_hat):
        return ""
    grid = np.geomspace(z_hat.min(), z_hat.max(), 2000)
    # a posterior's curve costs seconds at so many distances: coarse first, then where it falls
    coarse = np.append(np.arange(0, len(grid) - 1, 50), len(grid) - 1)
    larger = np.flatnonzero(_lift_change(evidence, boundary, grid[coarse]) >= SEEN)
    if not len(larger) or larger[-1] == len(coarse) - 1:
        return ""
    fine = grid[coarse[larger[-1]] : coarse[larger[-1] + 1]]
    at = float(fine[np.flatnonzero(_lift_change(evidence, boundary, fine) >= SEEN)[-1]])
    mm = 1e3 * at * evidence.campaign.vehicle.rotor_radius
    return (
        f"Lift changes by less than {100 * SEEN:g} % beyond ẑ = {plain(at, 3)} ({plain(mm, 3)} mm)."
    )


def _lift_change(evidence: Evidence, boundary: Boundary, z_hat: FloatArray) -> FloatArray:
    return np.abs(relative_lift.line(evidence, boundary, z_hat).middle)


def flow(evidence: Evidence, boundary: Boundary) -> str:
    """Downwash that PIV measured near a boundary, and what the base lift model implies."""
    if not evidence.has(DOWNWASH, FIT):
        return ""
    rows = pick(downwash.table(evidence), panel=boundary, kind="measured")
    if not len(rows):
        return ""
    # cuts of the inflow first, then the nearest
    row = rows.assign(wake=rows["label"] != "").sort_values(["wake", "z_hat"]).iloc[0]
    z_hat, measured, low, high = (
        float(row[n]) for n in ("z_hat", "reduction_percent", "lo90_percent", "hi90_percent")
    )
    implied = downwash.implied(evidence, boundary, z_hat)
    model = f"; the lift model implies {fixed(implied, 1)} %" if math.isfinite(implied) else ""
    wake = " in the wake" if row["label"] else ""
    return (
        f"PIV at ẑ = {plain(z_hat, 3)}: {fixed(measured, 1)} % less downwash{wake}"
        f" (90 %: {fixed(low, 1)} to {fixed(high, 1)}){model}."
    )


def _change(evidence: Evidence, boundary: Boundary) -> str:
    """Change of trials, headline and verdict since the last report."""
    before = evidence.reported.get(boundary)
    now = reported(csv(coefficients(evidence).frame)).get(boundary)
    if not evidence.reported or now is None:
        return ""
    if before is None:
        return "Change since the last report: this boundary is new."
    return change_text(before, now)


def change_text(before: Reported, now: Reported) -> str:
    """Change of trials, headline and verdict from one report to the next, in one line; empty where
    there is none.
    """
    parts = []
    if more := now.trials - before.trials:
        parts.append(f"{abs(more)} trials {'more' if more > 0 else 'fewer'}")
    texts = [plus_minus(r.value, r.u) for r in (before, now)]
    if now.parameter != before.parameter:
        parts.append(f"coefficient {letter(now.parameter)} instead of {letter(before.parameter)}")
    elif texts[0] != texts[1]:
        parts.append(f"{letter(now.parameter)} from {texts[0]} to {texts[1]}")
    if now.claim != before.claim:
        parts.append(f"verdict from {before.claim} to {now.claim}")
    return f"Change since the last report: {'; '.join(parts)}." if parts else ""


# doubts


def doubts(evidence: Evidence) -> list[Reservation]:
    """Doubts about the numbers, the most serious first, from the products alone."""
    # a doubt shared by several boundaries is printed once
    merged: dict[str, tuple[str, ...]] = {}
    for boundary in evidence.boundaries:
        for text in _reservations(evidence, boundary):
            merged[text] = (*merged.get(text, ()), boundary)
    every = [Reservation(boundaries=of, text=text) for text, of in merged.items()]
    out = int(rejected(evidence.table(TRIALS)["quality"]).sum()) if evidence.has(TRIALS) else 0
    if out:
        trials = len(evidence.table(TRIALS)["quality"])
        text = f"{out} of {trials} trials were left out. Quality of trials lists them."
        every.append(Reservation(boundaries=(), text=text))
    if not components(evidence.campaign):
        text = "The manifest states no uncertainty shared by trials, so no interval includes any."
        every.append(Reservation(boundaries=(), text=text))
    return every


def _reservations(evidence: Evidence, boundary: Boundary) -> list[str]:
    """Doubts about one boundary, the most serious first."""
    model, fit = evidence.base(boundary)
    diagnosis, quoted = evidence.diagnosed(boundary), evidence.quoted(boundary)
    depends = dependence(quoted)
    said = [depends] if depends else []
    hinge = quoted.most_influential
    suspects = [
        s
        for s in evidence.fits.influence[boundary].suspects
        if hinge is None or (s.kind, s.id) != (hinge[0], hinge[1].id)
    ]
    if evidence.not_diagnosed(boundary):
        # a known shift out of the interval is more serious than a possible one
        headline = quoted.coefficients.get(quoted.headline)
        reach = 0.5 * (headline.hi90 - headline.lo90) if headline else math.inf
        large = sorted((s for s in suspects if abs(s.shift) > reach), key=lambda s: -abs(s.shift))
        said += [s.text for s in large]
        said.append("not diagnosed: the coefficient may include an effect of any size")
    if diagnosis and diagnosis.look:
        said.append(f"the campaign is still growing: {diagnosis.look.text}")
    if goodness(evidence, boundary)[0] and not (diagnosis and diagnosis.effects):
        # with a named effect the rejected base model is not the quoted one
        said.append(
            f"cell means deviate significantly from {model.title}: the interval is valid only if"
            " the model is"
        )
    if diagnosis:
        said += diagnosis.contradicted or ()
        said += [random_walk(diagnosis.wander)] if diagnosis.wander is not None else []
        if diagnosis.verdict == "unexplained" and not diagnosis.contradicted:
            where = structure_along(diagnosis)
            vary = f" vary with {where}" if where else " have structure"
            said.append(f"residuals{vary}, unexplained: the coefficient may be affected too")
    said += [s.text for s in suspects if s.text not in said and _is_serious(s, quoted)]
    said += [
        f"{letter(name)} is at a bound of its range"
        for name, c in quoted.coefficients.items()
        if c.at_bound
    ]
    if quoted.verdict == NOT_DIAGNOSED:
        # after the loop the other conditions show it
        said += [d.text for d in fit.degeneracies[:1]]
    rivals = (
        [text for e in diagnosis.effects for text in _alike(diagnosis, e, quoted)]
        if diagnosis
        else []
    )
    hidden = _hidden(evidence, boundary)
    # the interval covers the rivals: where they agree, what it leaves out is more serious
    said += [*rivals, *hidden] if _apart(quoted) else [*hidden, *rivals]
    said += [s.text for s in suspects if s.text not in said]
    if diagnosis and diagnosis.untestable:
        unlogged = several([titled(name) for name in diagnosis.untestable])
        said.append(f"untestable with what was logged: {unlogged}")
    return [sentence(text) for text in said]


def _is_serious(suspect: Suspect, quoted: BoundaryResult) -> bool:
    """Whether the headline without it shifts by more than u, or loses half its precision."""
    headline, without = quoted.coefficients.get(quoted.headline), suspect.without
    if headline is None or without is None:
        return True
    return abs(suspect.shift) > headline.u or without.u > 2 * headline.u


def _apart(quoted: BoundaryResult) -> bool:
    """Whether a rival moves the headline by more than u."""
    headline = quoted.coefficients.get(quoted.headline)
    return headline is not None and any(
        d.explanation and abs(d.value - headline.value) > headline.u for d in headline.doubts
    )


def _alike(diagnosis: BoundaryDiagnosis, effect: NamedEffect, quoted: BoundaryResult) -> list[str]:
    """Rivals of an identified effect, pairs last, with the headline under each."""
    others = sorted(diagnosis.stand_ins(effect), key=lambda o: " + " in o)
    if not others:
        return []
    headline = quoted.coefficients.get(quoted.headline)
    values = {d.explanation: plain(d.value, 2) for d in headline.doubts} if headline else {}

    def with_value(name: str, equals: str = "") -> str:
        title = name.replace(" + ", " with ")
        return f"{title} ({equals}{values[name]})" if name in values else title

    best = with_value(effect.name, f"{letter(quoted.headline)} = ")
    few = [with_value(o) for o in others[: MAX_RIVALS if len(others) > MAX_RIVALS + 1 else None]]
    more = len(others) - len(few)
    rivals = listed([*few, *([f"{more} others"] if more else [])], "or")
    return [f"this design cannot distinguish {best} from {rivals}"]


def _hidden(evidence: Evidence, boundary: Boundary) -> list[str]:
    """Doubts beyond the interval by more than u, the larger first: an undetected effect, and errors
    of inputs without a stated uncertainty.
    """
    name = noun(evidence.quoted(boundary).headline)
    said: list[tuple[float, str]] = []
    if text := _inputs(evidence, boundary):
        said.append((undeclared(evidence, boundary)[0].shift, text))
    if hidden := undetected(evidence, boundary):
        shift, effect = hidden
        what = (
            f"an undetected violation of constant {evidence.campaign.rig.held}"
            if effect == "held_quantity"
            else f"undetected {titled(effect)}"
        )
        text = f"Not in the interval: {what} could shift {name} by up to {plain(shift, 2)}."
        said.append((shift, text))
    return [text for _, text in sorted(said, reverse=True)]


def _inputs(evidence: Evidence, boundary: Boundary) -> str:
    """The sentence on inputs whose error would shift the headline by more than u."""
    errors = [e for e in undeclared(evidence, boundary) if e.in_u > 1]
    if not errors:
        return ""
    name = noun(evidence.quoted(boundary).headline)
    parts = []
    for i, e in enumerate(errors):
        size, where = _error_size(e), f"in {INPUT_WORDS[e.on]}"
        head = f"{size} error {where} shifts {name}"
        if i:
            head = where if size == _error_size(errors[0]) else f"{size} {where}"
        # a larger error would be detected
        parts.append(f"{head} by {'up to ' if e.at_most else ''}{plain(e.shift, 2)}")
    states = {1: "does not state it", 2: "states neither"}.get(len(errors), "states none of them")
    return f"A {', '.join(parts)}. The manifest {states}."


def _error_size(error: PlausibleError) -> str:
    scale, unit = SCALES[error.unit]
    return f"{plain(scale * error.size, 2)} {unit}"


def goodness(evidence: Evidence, boundary: Boundary) -> tuple[bool, str]:
    """Whether chi2 rejects the base model, and what that means in words."""
    source = evidence.fits.noise[boundary].source
    if not source.startswith(REPEATS):
        return False, f"no test, as the noise is the {source}"
    p = evidence.base(boundary)[1].p_value
    if p < REJECTED_P:
        effects = evidence.quoted(boundary).effects
        which = "the base model without effects is rejected" if effects else "rejected"
        then = (
            f"The quoted model includes {listed([titled(e) for e in effects])}"
            if effects
            else "The interval is valid only if the model is"
        )
        why = f"as cell means deviate from the curve by more than scatter ({chance(p)})"
        return True, f"{which}, {why}. {then}"
    text = "cell means deviate no more than repeats scatter"
    if not evidence.has(DIAGNOSIS):
        text += ". Effects on the repeats themselves (sessions, supply, drift) need the diagnosis"
    return False, text


# next steps


def _next(evidence: Evidence, boundary: Boundary, quoted: BoundaryResult) -> str:
    """Next steps, and the quantities to log.

    The steps are to distinguish rivals or to be diagnosed. Otherwise they are to detect hidden
    effects, to state what is not stated, or to lower the largest source.
    """
    diagnosis = evidence.diagnosed(boundary)
    visit = (
        quoted.most_influential[1]
        if quoted.most_influential and quoted.most_influential[0] == "visit"
        else None
    )
    n_trials = evidence.observations[boundary].n
    asked = [n for n in diagnosis.next_experiment if is_feasible(n, n_trials)] if diagnosis else []
    if diagnosis and asked:
        # the visit that the answer depends on comes first
        ranked = sorted(asked, key=lambda n: (visit is None) != isinstance(n, NextSession))
        steps = [_proposal(n) for n in ranked[: 2 if visit else 1]]
        steps += _logging(diagnosis) if quoted.verdict == "unexplained" else []
        return " ".join(map(sentence, steps))
    steps = [f"for a diagnosis, {quoted.wanted}"] if quoted.wanted else []
    if steps and evidence.observations[boundary].z_hat.max() < NEAR_HAT:
        steps[-1] += f", in new visits, one at z_hat = {FAR_HAT:g} or more for lift in free air"
    elif steps and visit and visit.z_hat is not None:
        steps.append(f"add visits around z_hat = {plain(visit.z_hat, 2)}")
    done: set[str] = set()
    for pair in [n.separates for n in diagnosis.next_experiment[:1]] if diagnosis else []:
        # no feasible session distinguishes them, but what one of them acts through may be logged
        effects = [catalogue.effect(e) for e in dict.fromkeys(" + ".join(pair).split(" + "))]
        columns = _unlogged([c for e in effects for c in e.log_next_time], evidence, boundary)
        if columns:
            steps.append(f"log {listed(columns)}, to distinguish {_against(pair)}")
            done |= {*columns}
    more: list[str] = []
    if quoted.verdict == "unexplained":
        # an input's error does not explain structure
        where = structure_along(diagnosis) if diagnosis else ""
        more = [f"whatever else changes with {where}"] if where else []
    else:
        detect, wanted = _to_detect(evidence, boundary)
        steps += [] if wanted & done else detect
        done |= wanted
        if large := [INPUT_WORDS[e.on] for e in undeclared(evidence, boundary) if e.in_u > 1]:
            # "rotor radius and spacing"
            short = [large[0], *(w.removeprefix("rotor ") for w in large[1:])]
            shown = short if large[0].startswith("rotor ") else large
            steps.append(f"state the uncertainty of {listed(shown)}")
        elif quoted.headline and not steps:
            steps += _better(quoted.coefficients[quoted.headline])
    steps += _logging(diagnosis, more, done)
    return " ".join(map(sentence, steps))


def _better(c: CoefficientResult) -> list[str]:
    """The measurement that would lower a coefficient's uncertainty most."""
    lines = {line.source: line for line in c.budget}
    for source, _ in leads(c):
        if lines[source].scope:
            repeats = lines[source].kind == "A"
            return [f"add trials: {source} dominates" if repeats else f"improve the {source}"]
    return []


def _to_detect(evidence: Evidence, boundary: Boundary) -> tuple[list[str], set[str]]:
    """How to detect the effect that hides best, and the columns that this asks for."""
    hidden = undetected(evidence, boundary)
    if hidden is None:
        return [], set()
    effect, data = catalogue.effect(hidden[1]), evidence.observations[boundary]
    columns = [n for n in effect.log_next_time if n in BY_NAME]
    if any(BY_NAME[n].inside in data.covariates for n in columns):
        return [], set()
    if columns:
        test = (
            f"test the constant-{evidence.campaign.rig.held} assumption"
            if effect.name == "held_quantity"
            else f"test {titled(effect.name)}"
        )
        return [f"log {listed(columns)}, to {test}"], {*columns}
    missing = missing_for(effect, data)
    return ([f"to detect {titled(effect.name)}: {missing}"] if missing else []), set()


def _logging(
    diagnosis: BoundaryDiagnosis | None, more: Sequence[str] = (), done: set[str] | None = None
) -> list[str]:
    """Quantities to record next time, without those asked for already, and what that makes
    testable.
    """
    words = [*(w for w in to_log(diagnosis) if w not in (done or ())), *more]
    if not words:
        return []
    names = [titled(name) for name in diagnosis.untestable] if diagnosis else []
    logged = listed([w.replace("_", " ") for w in words])
    if len(names) > 2:
        return [f"log {logged}: {len(names)} more effects become testable"]
    become = "becomes" if len(names) == 1 else "become"
    return [f"log {logged}" + (f": {listed(names)} {become} testable" if names else "")]


def _unlogged(columns: Sequence[str], evidence: Evidence, boundary: Boundary) -> list[str]:
    """Columns of the schedule that are not logged."""
    known = evidence.observations[boundary].covariates
    named = [c for c in dict.fromkeys(columns) if c in BY_NAME]
    return [c for c in named if BY_NAME[c].inside not in known]


def _against(pair: Sequence[str]) -> str:
    return " from ".join(pair).replace(" + ", " with ")


def is_feasible(experiment: NextExperiment, n_trials: int) -> bool:
    """Whether it takes at most `MOST_REPEATS` times the trials of the campaign."""
    if not isinstance(experiment, NextSession):
        return True
    return experiment.trials_to_separate <= MOST_REPEATS * n_trials


def _proposal(experiment: NextExperiment) -> str:
    """One experiment, with what it distinguishes and in how many trials."""
    if not isinstance(experiment, NextSession):
        return experiment.measure
    pair = _against(experiment.separates)
    about = plain(experiment.trials_to_separate or experiment.trials, 2)
    return f"to distinguish {pair}: {experiment.measure} (about {about} trials)"
