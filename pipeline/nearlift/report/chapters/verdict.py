"""What the page says first: of each boundary the verdict, the number to publish, the error, the
gravest doubt, and what to measure next.
"""

from __future__ import annotations

from nearlift.products import RESULTS
from nearlift.report.chapters import doubts
from nearlift.report.documents.brief import Brief, briefs
from nearlift.report.evidence import Evidence
from nearlift.report.findings import coverage
from nearlift.report.number import Place, headline

TONES = {"adequate": "good", "effect": "fair", "unexplained": "bad"}


def facts(evidence: Evidence) -> dict[str, object]:
    """A card for each boundary."""
    return {"cards": [card(evidence, brief) for brief in briefs(evidence)]}


def card(evidence: Evidence, brief: Brief) -> dict[str, object]:
    """What the first screen says of one boundary."""
    boundary, quoted = brief.boundary, brief.quoted
    coefficients = [headline(evidence, boundary, name) for name in quoted.coefficients]
    strays, _ = doubts.goodness(evidence, boundary)
    return {
        "brief": brief,
        "quoted": quoted,
        "error": Place(evidence, RESULTS, ("boundaries", boundary, "error")),
        "model": evidence.base(boundary)[0].title,
        "headline": coefficients[0] if coefficients else None,
        "coverage": coverage(quoted.headline),
        "others": coefficients[1:],
        "holds": next((c.holds for c in quoted.coefficients.values()), ""),
        "left_out": evidence.left_out,
        "tone": TONES.get(quoted.verdict, "bad" if strays else "fair"),
    }
