"""First screen: for each boundary the verdict, the number to quote, its error, the most serious
doubt, and what to measure next.
"""

from __future__ import annotations

from nearlift.report import phrases, words
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place, headline
from nearlift.stages.fit import RESULTS
from nearlift.stages.ingest import TRIALS

TONES = {"adequate": "good", "effect": "fair", "unexplained": "bad"}


def facts(evidence: Evidence) -> dict[str, object]:
    """A card for each boundary, and the count of what was left out."""
    return {
        "cards": [card(evidence, brief) for brief in words.briefs(evidence)],
        "removed": f"{len(evidence.table(TRIALS)['quality'])} trials, {words.removed(evidence)}.",
    }


def card(evidence: Evidence, brief: words.Brief) -> dict[str, object]:
    """The first screen's part on one boundary."""
    boundary, quoted = brief.boundary, brief.quoted
    coefficients = [headline(evidence, boundary, name) for name in quoted.coefficients]
    rejected, _ = words.goodness(evidence, boundary)
    return {
        "brief": brief,
        "quoted": quoted,
        "error": Place(evidence, RESULTS, ("boundaries", boundary, "error")),
        "model": evidence.base(boundary)[0].title,
        "headline": coefficients[0] if coefficients else None,
        "coverage": phrases.coverage(quoted.headline),
        "others": coefficients[1:],
        "holds": next((phrases.sentence(c.holds) for c in quoted.coefficients.values()), ""),
        "left_out": evidence.left_out,
        "tone": TONES.get(quoted.verdict, "bad" if rejected else "fair"),
    }
