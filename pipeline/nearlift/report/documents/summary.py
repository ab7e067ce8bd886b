"""summary.txt: a campaign's answer on one screen of 80 columns."""

from __future__ import annotations

import textwrap

from nearlift.report import words
from nearlift.report.evidence import Evidence
from nearlift.report.phrases import coefficient_text, spoken
from nearlift.stages.ingest import TRIALS
from nearlift.version import __version__

WIDTH = 80
#: A space at which no line ends.
FIRM = "\u00a0"


def summary(evidence: Evidence) -> bytes:
    """A block for each boundary, below the counts and the meaning of ±."""
    trials = len(evidence.table(TRIALS)["quality"])
    simulated = " (simulated records)" if evidence.campaign.simulated else ""
    about = f"{evidence.campaign.name}{simulated}: {trials} trials, {words.removed(evidence)}"
    lines = [
        *_wrapped(f"{about}; nearlift {__version__}"),
        *_wrapped(
            "+/-: one standard uncertainty u (k = 1); visit: the trials of one stop at a distance"
        ),
    ]
    for brief in words.briefs(evidence):
        coefficients = brief.quoted.coefficients
        lines += ["", *_wrapped(f"[[{brief.boundary.capitalize()}]] {brief.verdict}", "    ")]
        lines += [f"    {coefficient_text(c, name)}" for name, c in coefficients.items()]
        if not coefficients:
            lines.append("    no free coefficient")
        error, doubts = brief.error, brief.doubts
        for text in (
            brief.omits,
            brief.reach,
            f"Error: {error}" if error else "",
            brief.sources,
            f"Doubt: {doubts[0]}" if doubts else "",
            brief.influence,
            f"Next: {brief.next}" if brief.next else "",
        ):
            lines += _wrapped(f"    {text}", " " * 6) if text else []
    return ("\n".join(lines) + "\n").replace("±", "+/-").encode()


def _wrapped(text: str, indent: str = "") -> list[str]:
    """Lines of at most `WIDTH` columns, all after the first indented."""
    whole = spoken(text).replace(" = ", f"{FIRM}={FIRM}")
    lines = textwrap.wrap(whole, WIDTH, subsequent_indent=indent, break_on_hyphens=False)
    return [line.replace(FIRM, " ") for line in lines]
