"""First screen: for each boundary the verdict, the number to quote, its error, the most serious
doubt, and what to measure next.
"""

from __future__ import annotations

from nearlift.report import phrases, words
from nearlift.report.evidence import Evidence
from nearlift.report.number import headline
from nearlift.stages.ingest import TRIALS

TONES = {"adequate": "good", "effect": "fair", "unexplained": "bad"}


def facts(evidence: Evidence) -> dict[str, object]:
    """A card for each boundary, and the count of what was left out."""
    trials = len(evidence.table(TRIALS)["quality"])
    visit = " A visit: the trials of one stop at a distance."
    return {
        "cards": [card(evidence, brief) for brief in words.briefs(evidence)],
        "removed": f"{trials} trials, {words.removed(evidence)}.{visit}",
    }


def card(evidence: Evidence, brief: words.Brief) -> dict[str, object]:
    """The first screen's part on one boundary."""
    quoted = brief.quoted
    return {
        "brief": brief,
        "coefficients": [headline(evidence, brief.boundary, n) for n in quoted.coefficients],
        "coverage": phrases.coverage(quoted.headline),
        "holds": phrases.sentence(brief.headline.holds) if brief.headline else "",
        "tone": TONES.get(quoted.verdict, "bad" if brief.rejected else "fair"),
    }
