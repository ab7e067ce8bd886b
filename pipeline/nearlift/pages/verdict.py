"""What the page says first: each boundary's headline coefficient, and whether its model stands up to the data."""

from __future__ import annotations

import math
from typing import Any

from nearlift.declare import Boundary
from nearlift.pages.number import LEAST_CHANCE, Number, Quoted, cite, interval, pointer, quote
from nearlift.products import DIAGNOSIS, FIT
from nearlift.summaries.evidence import Evidence
from nearlift.summaries.rounding import plain

#: A base model whose chi2 is less likely than this by chance is called rejected.
REJECTED = 1e-3
#: What the noise's source begins with where repeats told it.
REPEATS = "scatter of repeats"
WORDS = {
    "adequate": "adequate: nothing is left beyond the noise floor",
    "effect": "an effect explains what the base model leaves",
    "unexplained": "unexplained: there is structure, and no candidate may take the credit",
}


def facts(evidence: Evidence) -> dict[str, Any]:
    """A card for each boundary."""
    return {"cards": [card(evidence, b) for b in evidence.boundaries]}


def card(evidence: Evidence, boundary: Boundary) -> dict[str, Any]:
    """Headline, goodness of fit and verdict of one boundary."""
    model, entry = evidence.base(boundary)
    names = list(entry["parameters"])
    path = ("boundaries", boundary, model.name)
    rejected, words = goodness(evidence, boundary)
    tone = "bad" if rejected else "fair"
    source = str(evidence.document(FIT)["noise"][boundary]["source"])
    verdict = ""
    found = evidence.document(DIAGNOSIS)["boundaries"].get(boundary) if evidence.has(DIAGNOSIS) else None
    if found:
        verdict = WORDS.get(found["verdict"], found["verdict"])
        tone = {"adequate": "good", "effect": "fair"}.get(found["verdict"], "bad")
    return {
        "boundary": boundary,
        "model": model.title,
        "headline": quote(evidence, FIT, *path, "parameters", names[0]) if names else None,
        "others": [quote(evidence, FIT, *path, "parameters", n) for n in names[1:]],
        "reduced": reduced(evidence, boundary, model.name),
        "words": words,
        "verdict": verdict,
        "effects": [_effect(e) for e in found["effects"]] if found else [],
        "noise": "what repeats scatter" if source.startswith(REPEATS) else f"the {source}",
        "superseded": bool(found and found["verdict"] == "effect"),
        "after": _after(evidence, boundary, found),
        "constrained": _constrained(evidence, boundary, names, found),
        "tone": tone,
    }


def _effect(effect: dict[str, Any]) -> str:
    rivals = effect.get("rivals") or []
    return str(effect["name"]) + (f" (or {', '.join(rivals)}, which this design cannot tell from it)" if rivals else "")


def _after(evidence: Evidence, boundary: Boundary, found: dict[str, Any] | None) -> list[Quoted]:
    """The coefficients once the named effects are in the model."""
    if not found or found["verdict"] != "effect":
        return []
    return [quote(evidence, DIAGNOSIS, "boundaries", boundary, "coefficients", "after", n) for n in found.get("coefficients", {}).get("after", {})]


def _constrained(evidence: Evidence, boundary: Boundary, names: list[str], found: dict[str, Any] | None) -> tuple[Number, Number] | None:
    """The headline's interval when every effect too small to be seen is allowed for."""
    return interval(evidence, boundary, names[0], "constrained") if found and names else None


def reduced(evidence: Evidence, boundary: Boundary, model: str) -> Number:
    """chi2 over its degrees of freedom."""
    path = ("boundaries", boundary, model)
    chi2, dof = (cite(evidence, FIT, *path, k).value for k in ("chi2", "dof"))
    value = chi2 / dof if dof else math.nan
    return Number(
        text=f"{value:.2f}" if math.isfinite(value) else "–", value=value, source=pointer(FIT, *path, "chi2"), how="over dof of the same model"
    )


def goodness(evidence: Evidence, boundary: Boundary) -> tuple[bool, str]:
    """Whether chi2 rejects the base model, and what that means in words."""
    from scipy.stats import chi2

    _, entry = evidence.base(boundary)
    source = str(evidence.document(FIT)["noise"][boundary]["source"])
    if not source.startswith(REPEATS):
        return False, f"chi² says nothing here: the noise is the {source}"
    p = float(chi2.sf(entry["chi2"], entry["dof"]))
    if p < REJECTED:
        chance = f"p = {plain(p, 1)}" if p > LEAST_CHANCE else "p < 10⁻¹²"
        return True, f"rejected: cells stray from the curve by more than repeats scatter ({chance}); the interval holds only if the model did"
    blind = "" if evidence.has(DIAGNOSIS) else "; what moves the repeats themselves (sessions, supply, drift) shows only in the residuals"
    return False, f"cells stray from the curve no more than repeats scatter{blind}"
