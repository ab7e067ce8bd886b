"""What the page says first: of each boundary the verdict, the number to publish, the error, the
gravest doubt, and what to measure next.
"""

from __future__ import annotations

from collections.abc import Iterable

from nearlift.manifest.flight_log import Flight
from nearlift.nomenclature import letter
from nearlift.products import RESULTS
from nearlift.report.chapters import doubts
from nearlift.report.documents.brief import Brief, briefs
from nearlift.report.evidence import Evidence
from nearlift.report.findings import coverage, listed
from nearlift.report.number import Place, headline
from nearlift.results.hover import HoverComparison

TONES = {"adequate": "good", "effect": "fair", "unexplained": "bad"}


def facts(evidence: Evidence) -> dict[str, object]:
    """A card for each boundary."""
    return {"cards": [card(evidence, brief) for brief in briefs(evidence)]}


def card(evidence: Evidence, brief: Brief) -> dict[str, object]:
    """What the first screen says of one boundary."""
    boundary, quoted = brief.boundary, brief.quoted
    coefficients = [headline(evidence, boundary, name) for name in quoted.quotable]
    strays, _ = doubts.goodness(evidence, boundary)
    return {
        "brief": brief,
        "quoted": quoted,
        "error": Place(evidence, RESULTS, ("boundaries", boundary, "error")),
        "model": evidence.base(boundary)[0].title,
        "headline": coefficients[0] if coefficients else None,
        "coverage": coverage(quoted.headline),
        "others": coefficients[1:],
        "holds": next((c.holds for c in quoted.quotable.values()), ""),
        "refused": {letter(name): why for name, why in quoted.refused.items()},
        "hover": hovering(quoted.hover or (), evidence.campaign.flight),
        "left_out": evidence.left_out,
        "tone": TONES.get(quoted.verdict, "bad" if strays else "fair"),
    }


def hovering(compared: Iterable[HoverComparison], flight: Flight | None) -> list[str]:
    """What hover shows of each condition; those that show nothing together, and no sound log
    beside its likes unless it is found different.
    """
    each = list(compared)
    quiet = [c.condition for c in each if not c.effects and flight and c.condition != flight.sound]
    sentences = [c.text for c in each if c.effects]
    if quiet:
        sentences.append(
            f"in hover {listed(quiet)} {'show' if len(quiet) > 1 else 'shows'} nothing"
        )
    return sentences
