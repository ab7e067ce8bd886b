"""What is to be said of a boundary where there is room for little: the verdict in a sentence, the
coefficients to quote, error, largest sources, the gravest doubt, influence, and what comes next.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import Boundary
from nearlift.likelihood.budget import components
from nearlift.nomenclature import letter
from nearlift.report.chapters.doubts import INPUT_WORDS, doubts, undeclared, unseen
from nearlift.report.chapters.uncertainty import badly_known
from nearlift.report.evidence import Evidence
from nearlift.report.figures.budget import fall
from nearlift.report.findings import listed, others, structure_along, to_log
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.outlook import NextExperiment, NextSession
from nearlift.results.quotation import BoundaryResult, CoefficientResult
from nearlift.rounding import decimals, fixed, plain, signed
from nearlift.schedule import BY_NAME

#: Trials that all stand nearer than `FARTHEST` hardly tell lift in free air; from `FAR` on they do
#: (docs/planning.md). In rotor radii.
FARTHEST, FAR = 6.0, 12.0
#: What a declared error of the load cell acts on.
CELL = {"force", "gain", "linearity"}
#: A source whose knowledge would lessen u by less than this part is no lead.
LEAST_FALL, SOURCES = 0.05, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Brief:
    """One boundary in plain text.

    Attributes
    ----------
    boundary : Boundary
    verdict : str
        A sentence.
    quoted : BoundaryResult
    omits : str
        The inputs whose errors no interval allows for.
    error, sources, influence : str
        Of the headline; empty where nothing is known.
    doubts : tuple of str
        The gravest first.
    next : str
        What to measure next.
    """

    boundary: Boundary
    verdict: str
    quoted: BoundaryResult
    omits: str
    error: str
    sources: str
    doubts: tuple[str, ...]
    influence: str
    next: str


def briefs(evidence: Evidence) -> list[Brief]:
    """Every boundary's."""
    # what is said of this boundary alone stands before what is said of several
    held = sorted(doubts(evidence), key=lambda d: len(d.boundaries) != 1)
    return [
        Brief(
            boundary=b,
            verdict=verdict(evidence, b),
            quoted=(quoted := evidence.quoted(b)),
            omits=_omits(evidence, b),
            error=_error(quoted, evidence.left_out),
            sources=_sources(quoted),
            doubts=tuple(titled(d.text) for d in held if b in d.boundaries or not d.boundaries),
            influence=_influence(quoted),
            next=_next(evidence, b, quoted),
        )
        for b in evidence.boundaries
    ]


def verdict(evidence: Evidence, boundary: Boundary) -> str:
    """The verdict in a sentence, effects by their titles."""
    quoted, diagnosis = evidence.quoted(boundary), evidence.diagnosed(boundary)
    model = catalogue.model(quoted.base_model).title
    if quoted.verdict == "adequate":
        few = diagnosis.sensitivity if diagnosis else None
        return f"{model} describes the data: nothing is left beyond the noise" + (
            f" that {few.trials} trials could show." if few else "."
        )
    if quoted.verdict == "effect":
        named = listed([titled(e) for e in quoted.effects])
        rivals = [r for e in diagnosis.effects for r in diagnosis.stand_ins(e)] if diagnosis else []
        beside = {n for r in rivals for n in r.split(" + ")} - {*quoted.effects}
        if rivals and all(" + " in r for r in rivals) and beside:
            with_them = listed([titled(n) for n in sorted(beside)], "or")
            apart = f", alone or with {with_them}; this design cannot tell which"
        else:
            apart = f"; this design cannot tell it from {others(diagnosis)}" if rivals else ""
        return f"{model} alone does not describe the data: the rest is explained by {named}{apart}."
    if quoted.verdict == "unexplained":
        where = f" along {words}" if diagnosis and (words := structure_along(diagnosis)) else ""
        fits = diagnosis.not_confirmed if diagnosis else None
        if fits:
            names = [titled(" with ".join(pair)) for pair in fits]
            words = listed(names, "or")
            if len(names) > 2:
                words = f"{names[0]}, or any of {len(names) - 1} others,"
            but = "foretells nothing" if len(names) == 1 else "none of them foretells anything"
            return (
                f"{model} leaves structure{where}; {words} would fit it, but {but} on"
                f" {evidence.left_out} left out."
            )
        return f"{model} leaves structure{where} that no effect testable here explains."
    return f"Not diagnosed: {quoted.reason.removesuffix(f'; {quoted.wanted}')}."


def _omits(evidence: Evidence, boundary: Boundary) -> str:
    """Inputs without a declared uncertainty, the one that matters most first."""
    words = [INPUT_WORDS[error.on] for error in undeclared(evidence, boundary)]
    if len(words) > 1:
        words[0] += " (most important)"
    declared = {part.on for part in components(evidence.campaign)}
    if words and not declared & CELL:
        words.append("load cell")
    return f"errors of {listed(words)}: none is declared" if words else ""


def _error(quoted: BoundaryResult, left_out: str) -> str:
    """Error of predicting what was left out, before and after, in percent of lift."""
    error = quoted.error
    if error is None:
        return ""
    places = max(decimals(100 * error.noise_floor) + 1, 1) if error.noise_floor > 0 else 2
    before, after, floor = (
        fixed(100 * e, places) for e in (error.before, error.after, error.noise_floor)
    )
    then = f", {after} % with the effect" if quoted.verdict == "effect" else ""
    return f"{before} % of lift on {left_out} left out of the fit{then}; noise alone {floor} %"


def _sources(quoted: BoundaryResult) -> str:
    """The headline's u, and what it would be if a source that matters were known exactly."""
    if not quoted.headline:
        return ""
    c = quoted.coefficients[quoted.headline]
    lines = ", ".join(f"{plain(u, 2)} without {titled(source)}" for source, u in leads(c))
    return f"u({letter(quoted.headline)}) = {plain(c.u, 2)}; {lines}" if lines else ""


def leads(c: CoefficientResult) -> list[tuple[str, float]]:
    """The largest sources of a coefficient's uncertainty and u without each, those aside of which
    repeats tell nothing, and one that is all there is.
    """
    sources = [
        (line.source, line.u_without)
        for line in sorted(c.budget, key=lambda line: line.u_without)
        if line.u_without > 0
        and fall(line, c.u) >= LEAST_FALL
        and line.source not in badly_known(c)
    ]
    return sources[:SOURCES]


def _influence(quoted: BoundaryResult) -> str:
    """The trial and the visit that move the headline most."""
    name = quoted.headline
    if not name:
        return ""
    c = quoted.coefficients[name]
    moves = [
        f"by {signed(one.shift, decimals(c.u) + 1)} without {kind}{one.place}"
        for kind, one in (("trial ", c.influence.trial), ("visit ", c.influence.visit))
        if one is not None
    ]
    return f"{letter(name)} {', '.join(moves)}" if moves and 0 < c.u < math.inf else ""


def _next(evidence: Evidence, boundary: Boundary, quoted: BoundaryResult) -> str:
    """What to measure next: what would part rivals, or give a diagnosis; else what would show what
    hides, what nobody declared, or what matters most in the budget; and what to log.
    """
    diagnosis = evidence.diagnosed(boundary)
    visit = quoted.hinge[1] if quoted.hinge and quoted.hinge[0] == "visit" else None
    if diagnosis and diagnosis.next_experiment:
        # what mends that on which the answer rests comes first
        ranked = sorted(
            diagnosis.next_experiment, key=lambda n: (visit is None) != isinstance(n, NextSession)
        )
        proposals = [_proposal(n) for n in ranked[: 2 if visit else 1]]
        return "; ".join(
            proposals + (_logging(diagnosis) if quoted.verdict == "unexplained" else [])
        )
    said = [f"for a diagnosis, {quoted.wanted}"] if quoted.wanted else []
    if said and evidence.observations[boundary].z_hat.max() < FARTHEST:
        said[-1] += (
            f", in new visits, one far from the boundary (z_hat = {FAR:g} or more) for lift in free"
            " air"
        )
    elif said and visit and visit.z_hat is not None:
        said.append(f"more visits around z_hat = {plain(visit.z_hat, 2)}")
    words = []
    if quoted.verdict == "unexplained":
        # what has no name is looked for first; a better input does not find it
        where = structure_along(diagnosis) if diagnosis else ""
        words = [f"whatever else changes along {where}"] if where else []
    else:
        said += _to_see(evidence, boundary)
        if grave := [INPUT_WORDS[e.on] for e in undeclared(evidence, boundary) if e.in_u > 1]:
            each = " each" if len(grave) > 1 else ""
            said.append(
                f"measure the {listed(grave)}, and declare how well{each or ' it'} is known"
            )
        elif quoted.headline and not said:
            said += _better(quoted.coefficients[quoted.headline])
    return "; ".join(said + _logging(diagnosis, words))


def _better(c: CoefficientResult) -> list[str]:
    """What that can be measured would lessen a coefficient's uncertainty most."""
    lines = {line.source: line for line in c.budget}
    for source, _ in leads(c):
        if lines[source].scope:
            repeats = lines[source].kind == "A"
            more = f"more trials: {source} is most of the uncertainty"
            return [more if repeats else f"a better {source}"]
    return []


def _to_see(evidence: Evidence, boundary: Boundary) -> list[str]:
    """What would show the gravest unseen effect, unless something logged tells of it."""
    hidden = unseen(evidence, boundary)
    if hidden is None:
        return []
    effect = catalogue.effect(hidden[1])
    columns = {BY_NAME[n].inside for n in effect.log_next_time if n in BY_NAME}
    if columns & evidence.observations[boundary].covariates.keys() or not effect.separated_by:
        return []
    return [f"to see {titled(effect.name)}: {effect.separated_by}"]


def _logging(diagnosis: BoundaryDiagnosis | None, more: Sequence[str] = ()) -> list[str]:
    """What to record next time, and the effects that it would make testable."""
    words = [*to_log(diagnosis), *more]
    untestable = [catalogue.titled(name) for name in diagnosis.untestable] if diagnosis else []
    tested = listed(untestable) if len(untestable) < 3 else f"{len(untestable)} effects more"
    for_what = f", to test {tested}" if untestable else ""
    return [f"log {listed(words)}{for_what}"] if words else []


def _proposal(experiment: NextExperiment) -> str:
    """One experiment, with what it would tell apart and in how many trials."""
    if not isinstance(experiment, NextSession):
        return titled(experiment.measure)
    parts = " from ".join(experiment.separates)
    # where so many are there already, as a session has them
    about = plain(experiment.trials_to_separate or experiment.trials, 2)
    return titled(f"to tell {parts}: {experiment.measure} (about {about} trials)")
