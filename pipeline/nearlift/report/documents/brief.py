"""What is to be said of a boundary where there is room for little: the verdict in a sentence, the
coefficients to quote, error, largest sources, the gravest doubt, influence, and what comes next.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import Boundary
from nearlift.nomenclature import letter
from nearlift.report.chapters.doubts import Reservation, doubts
from nearlift.report.chapters.uncertainty import untold
from nearlift.report.evidence import Evidence
from nearlift.report.figures.budget import fall
from nearlift.report.findings import along, listed, stand_ins, to_log
from nearlift.results.quotation import BoundaryResult, CoefficientResult
from nearlift.rounding import decimals, fixed, plain, signed

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
    coefficients : mapping of str to CoefficientResult
        As quoted, the headline first.
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
            quoted=(own := evidence.quoted(b)),
            error=_error(own),
            sources=_sources(own),
            doubts=tuple(titled(d.text) for d in held if b in d.boundaries or not d.boundaries),
            influence=_influence(own),
            next=_next(evidence, b, own, [d for d in held if b in d.boundaries]),
        )
        for b in evidence.boundaries
    ]


def verdict(evidence: Evidence, boundary: Boundary) -> str:
    """The verdict in a sentence, effects by their titles."""
    quoted, found = evidence.quoted(boundary), evidence.diagnosed(boundary)
    model = catalogue.model(quoted.base_model).title
    if quoted.verdict == "adequate":
        few = found.get("sensitivity")
        return f"{model} describes the data: nothing is left beyond the noise" + (
            f" that {few['trials']} trials could show." if few else "."
        )
    if quoted.verdict == "effect":
        named = listed([titled(e) for e in quoted.effects])
        others = dict.fromkeys(
            titled(r.replace(" + ", " with "))
            for e in found.get("effects", [])
            for r in stand_ins(found, e)
        )
        apart = f"; this design cannot tell it from {listed([*others], 'or')}" if others else ""
        return f"What {model} leaves is explained by {named}{apart}."
    if quoted.verdict == "unexplained":
        found_in = [s["covariate"] for s in found.get("structure", []) if s.get("significant")]
        where = f" along {along(found_in[0])}" if found_in else ""
        return f"{model} leaves structure{where} that no known effect explains."
    return f"Not diagnosed: {quoted.reason}."


def _error(quoted: BoundaryResult) -> str:
    """Error of predicting visits left out, before and after, in percent of lift."""
    error = quoted.error
    if error is None:
        return ""
    places = max(decimals(100 * error.noise_floor) + 1, 1) if error.noise_floor > 0 else 2
    before, after, floor = (
        fixed(100 * e, places) for e in (error.before, error.after, error.noise_floor)
    )
    then = f", {after} % with it" if quoted.verdict == "effect" else ""
    return f"{before} % of lift on visits left out{then}; noise floor {floor} %"


def _sources(quoted: BoundaryResult) -> str:
    """The headline's u, and what it would be if a source that leads were known."""
    if not quoted.headline:
        return ""
    c = quoted.coefficients[quoted.headline]
    lines = ", ".join(f"{titled(source)} {plain(u, 2)}" for source, u in leads(c))
    return f"u({letter(quoted.headline)}) = {plain(c.u, 2)}; if known: {lines}" if lines else ""


def leads(c: CoefficientResult) -> list[tuple[str, float]]:
    """The largest sources of a coefficient's uncertainty and u without each, those aside of which
    repeats tell nothing.
    """
    found = [
        (line.source, line.u_without)
        for line in sorted(c.budget, key=lambda line: line.u_without)
        if fall(line, c.u) >= LEAST_FALL and line.source not in untold(c)
    ]
    return found[:SOURCES]


def _influence(quoted: BoundaryResult) -> str:
    """The trial and the visit that move the headline most."""
    if not quoted.headline:
        return ""
    c = quoted.coefficients[quoted.headline]
    moves = [
        f"{kind} {one.id} ({signed(one.shift, decimals(c.u) + 1)})"
        for kind, one in (("trial", c.influence.trial), ("visit", c.influence.visit))
        if one is not None
    ]
    return f"{' or '.join(moves)} if left out" if moves and 0 < c.u < math.inf else ""


def _next(
    evidence: Evidence, boundary: Boundary, quoted: BoundaryResult, held: list[Reservation]
) -> str:
    """What to measure next: what would part rivals; else what nobody declared, or what leads the
    budget, and what to log.
    """
    found = evidence.diagnosed(boundary)
    if proposed := found.get("next_experiment"):
        return titled(str(proposed[0]["measure"]))
    # what has no name is looked for first; a better input does not find it
    said = [d.remedy for d in held if d.remedy and quoted.verdict != "unexplained"][:1]
    if quoted.headline and not said and quoted.verdict != "unexplained":
        own = {line.source: line for line in quoted.coefficients[quoted.headline].budget}
        for source, _ in leads(quoted.coefficients[quoted.headline]):
            # the form of an effect, and what has no name, are not measured
            if own[source].scope:
                repeats = own[source].kind == "A"
                said.append(f"more trials ({source} leads)" if repeats else f"a better {source}")
                break
    words = to_log(found)
    if quoted.verdict == "unexplained" and found.get("structure"):
        words.append(f"whatever else changes along {along(found['structure'][0]['covariate'])}")
    if words:
        said.append(f"log {listed(words)}")
    return "; ".join(said)
