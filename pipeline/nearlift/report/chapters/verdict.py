"""What the page says first: each boundary's headline coefficient, and whether its model stands up
to the data.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

from nearlift.declare import Boundary
from nearlift.likelihood.budget import components
from nearlift.likelihood.noise import REPEATS
from nearlift.nomenclature import letter
from nearlift.products import DIAGNOSIS, FIT, NOT_DIAGNOSED, RESULTS, TRIALS
from nearlift.reduction.quality import rejected
from nearlift.report.chapters.uncertainty import SCALES
from nearlift.report.evidence import Evidence
from nearlift.report.findings import could_have_seen, stand_ins
from nearlift.report.number import LEAST_CHANCE, Number, cite, headline, pointer, quote
from nearlift.results.quotation import BoundaryResult
from nearlift.rounding import plain

#: A base model whose chi2 is less likely than this by chance is called rejected.
REJECTED = 1e-3
INPUT_WORDS = {
    "rotor_radius": "rotor radius",
    "rotor_spacing": "rotor spacing",
    "height": "distance datum",
}
WORDS = {
    "adequate": "adequate: nothing is left beyond the noise floor",
    "effect": "an effect explains what the base model leaves",
    "unexplained": "unexplained: there is structure, and no candidate may take the credit",
}


def facts(evidence: Evidence) -> dict[str, Any]:
    """A card for each boundary."""
    return {"cards": [card(evidence, b) for b in evidence.boundaries], "doubts": doubts(evidence)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Reservation:
    """One reason to doubt headlines: their boundaries (none where it concerns the campaign), and
    the text.
    """

    boundaries: tuple[str, ...]
    text: str


def doubts(evidence: Evidence) -> list[Reservation]:
    """What a reader should hold against the numbers above, the gravest first; nothing that is not
    in a product.
    """
    merged: dict[str, Reservation] = {}
    for own in (doubt for b in evidence.boundaries for doubt in _doubts(evidence, b)):
        # what is said of several boundaries is said once
        before = merged.get(own.text)
        merged[own.text] = (
            replace(own, boundaries=before.boundaries + own.boundaries) if before else own
        )
    listed = list(merged.values())
    out = int(rejected(evidence.table(TRIALS)["quality"]).sum()) if evidence.has(TRIALS) else 0
    if out:
        every = len(evidence.table(TRIALS)["quality"])
        listed.append(
            Reservation(
                boundaries=(),
                text=(
                    f"{out} of {every} trials were left out; the quality ledger says why, and what"
                    " they are worth"
                ),
            )
        )
    if not components(evidence.campaign):
        listed.append(
            Reservation(
                boundaries=(),
                text=(
                    "the manifest declares no error that repeats share, so none is in these"
                    " intervals"
                ),
            )
        )
    return listed


def _doubts(evidence: Evidence, boundary: Boundary) -> list[Reservation]:
    model, entry = evidence.base(boundary)
    found = evidence.diagnosed(boundary)
    said = [str(s["text"]) for s in evidence.document(FIT)["influence"][boundary]["suspects"]]
    if reason := evidence.not_diagnosed(boundary):
        said.append(f"not diagnosed, so an effect of any size may be in the coefficient: {reason}")
    if look := found.get("look"):
        said.append(f"the campaign is still growing: {look['text']}")
    if goodness(evidence, boundary)[0]:
        said.append(
            f"cells stray from {model.title} by more than chance allows, so its interval is that of"
            " a curve which is not the data's"
        )
    if leaning := evidence.quoted(boundary).leaning:
        said.insert(0, leaning)
    said += found.get("contradicted", [])
    if found.get("verdict") == "unexplained" and not found.get("contradicted"):
        along = [str(line["covariate"]) for line in found["structure"][:1]]
        said.append(
            f"what the base model leaves{f' along {along[0]}' if along else ''} has no name, and"
            " may be in the coefficient too"
        )
    for effect in found.get("effects", []):
        others = stand_ins(found, effect)
        alone, together = ([o for o in others if (" + " in o) == joint] for joint in (False, True))
        if alone:
            said.append(
                f"{effect['name']} and {' and '.join(alone)} look alike in this design; which of"
                " them it is rests on prior plausibility"
            )
        if together:
            said.append(
                f"{effect['name']} alone would do, but {' or '.join(together)} is likelier, if not"
                " plainly"
            )
    said += [
        f"{name} ends at a bound of its range"
        for name, c in evidence.quoted(boundary).coefficients.items()
        if c.at_bound
    ]
    if evidence.quoted(boundary).verdict == NOT_DIAGNOSED:
        # by the noise of the fit; after the loop the conditions say it by the loop's
        said += [str(d["text"]) for d in entry["degeneracies"][:1]]
    said += _undeclared(entry, evidence.quoted(boundary))
    listed = [Reservation(boundaries=(boundary,), text=text) for text in said]
    unseen = [str(u["effect"]) for u in found.get("untestable", [])]
    if unseen:
        listed.append(
            Reservation(
                boundaries=(boundary,),
                text=f"nothing was logged that could tell of {', '.join(unseen)}",
            )
        )
    return listed


def _undeclared(entry: dict[str, Any], quoted: BoundaryResult) -> list[str]:
    """Inputs without a declared uncertainty whose plausible error would move the headline by more
    than its u.
    """
    name = quoted.headline
    u = quoted.coefficients[name].u if name else math.inf
    if not (u > 0 and math.isfinite(u)):
        return []
    worth = [(abs(line["shift"][name]) / u, line) for line in entry.get("undeclared", [])]
    moves = [
        f"{plain(SCALES[a['unit']][0] * a['size'], 2)} {SCALES[a['unit']][1]} of"
        f" {INPUT_WORDS[a['on']]} by {plain(by, 2)} u"
        for by, a in sorted(worth, key=lambda pair: -pair[0])
        if by > 1
    ]
    if not moves:
        return []
    return [
        (
            f"what was not declared could move {letter(name)}: {', '.join(moves)}; declare what is"
            " known of it under [[uncertainty]]"
        )
    ]


def conditions(evidence: Evidence, boundary: Boundary) -> list[dict[str, Any]]:
    """What each coefficient would be, and what it takes to believe that."""
    rows = []
    for name, c in evidence.quoted(boundary).coefficients.items():
        path = ("boundaries", boundary, "coefficients", name, "doubts")
        rows += [
            {"condition": d.condition, "quoted": quote(evidence, RESULTS, *path, str(i), name=name)}
            for i, d in enumerate(c.doubts)
        ]
    return rows


def card(evidence: Evidence, boundary: Boundary) -> dict[str, Any]:
    """Headline, goodness of fit and verdict of one boundary."""
    model, _ = evidence.base(boundary)
    quoted = evidence.quoted(boundary)
    listed = [headline(evidence, boundary, name) for name in quoted.coefficients]
    strays, words = goodness(evidence, boundary)
    tone = {"adequate": "good", "effect": "fair", "unexplained": "bad"}.get(
        quoted.verdict, "bad" if strays else "fair"
    )
    return {
        "boundary": boundary,
        "model": model.title,
        "headline": listed[0] if listed else None,
        "others": listed[1:],
        "holds": next((c.holds for c in quoted.coefficients.values()), ""),
        "reduced": reduced(evidence, boundary, model.name),
        "words": words,
        "verdict": said(evidence, boundary),
        "effects": [
            _effect(evidence.diagnosed(boundary), e)
            for e in evidence.diagnosed(boundary).get("effects", [])
        ],
        "conditions": conditions(evidence, boundary),
        "tone": tone,
    }


def said(evidence: Evidence, boundary: Boundary) -> str:
    """The verdict in words; where trials are few, adequate is what they could have shown and did
    not.
    """
    quoted = evidence.quoted(boundary)
    words = WORDS.get(quoted.verdict, f"not diagnosed: {quoted.reason}")
    could = could_have_seen(evidence.diagnosed(boundary))
    return "; ".join(
        filter(None, (words, quoted.leaning, could if quoted.verdict == "adequate" else ""))
    )


def _effect(found: dict[str, Any], effect: dict[str, Any]) -> str:
    others = stand_ins(found, effect)
    return str(effect["name"]) + (
        f" (or {', '.join(others)}, which this design cannot tell from it)" if others else ""
    )


def reduced(evidence: Evidence, boundary: Boundary, model: str) -> Number:
    """chi2 over its degrees of freedom."""
    path = ("boundaries", boundary, model)
    chi2, dof = (cite(evidence, FIT, *path, k).value for k in ("chi2", "dof"))
    value = chi2 / dof if dof else math.nan
    return Number(
        text=f"{value:.2f}" if math.isfinite(value) else "–",
        value=value,
        source=pointer(FIT, *path, "chi2"),
        how="over dof of the same model",
    )


def goodness(evidence: Evidence, boundary: Boundary) -> tuple[bool, str]:
    """Whether chi2 rejects the base model, and what that means in words."""
    # scipy.stats takes half a second to import
    from scipy.special import chdtrc

    _, entry = evidence.base(boundary)
    source = str(evidence.document(FIT)["noise"][boundary]["source"])
    if not source.startswith(REPEATS):
        return False, f"chi² says nothing here: the noise is the {source}"
    p = float(chdtrc(entry["dof"], entry["chi2"]))
    if p < REJECTED:
        chance = f"p = {plain(p, 1)}" if p > LEAST_CHANCE else "p < 10⁻¹²"
        return (
            True,
            (
                f"rejected: cells stray from the curve by more than repeats scatter ({chance}); the"
                " interval holds only if the model did"
            ),
        )
    blind = (
        ""
        if evidence.has(DIAGNOSIS)
        else (
            "; what moves the repeats themselves (sessions, supply, drift) shows only in the"
            " residuals"
        )
    )
    return False, f"cells stray from the curve no more than repeats scatter{blind}"
