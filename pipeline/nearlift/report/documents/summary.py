"""summary.txt: a campaign's answer on one screen of 80 columns."""

from __future__ import annotations

import textwrap

from nearlift.report import words
from nearlift.report.evidence import Evidence
from nearlift.report.phrases import coefficient_text
from nearlift.stages.ingest import TRIALS
from nearlift.version import __version__

WIDTH = 80
INDENT = " " * 6
#: A space at which no line ends.
FIRM = "\u00a0"


def summary(evidence: Evidence) -> bytes:
    """A block for each boundary, below the counts and the meaning of ±."""
    trials = len(evidence.table(TRIALS)["quality"])
    count = f"{trials} trials, {words.removed(evidence)}"
    simulated = " (simulated records)" if evidence.campaign.simulated else ""
    lines = [
        *_wrapped(f"{evidence.campaign.name}{simulated}: {count}; nearlift {__version__}"),
        *_wrapped(
            "+/-: one standard uncertainty u (k = 1); visit: the trials of one stop at a distance"
        ),
    ]
    for brief in words.briefs(evidence):
        lines += ["", *_block(brief)]
    return ("\n".join(lines) + "\n").encode()


def _block(brief: words.Brief) -> list[str]:
    coefficients = brief.quoted.coefficients
    lines = _wrapped(f"[[{brief.boundary.capitalize()}]] {brief.verdict}", "    ")
    if not coefficients:
        lines.append("    no free coefficient")
    lines += [f"    {coefficient_text(c, name)}" for name, c in coefficients.items()]
    for label, text in (
        ("", brief.omits),
        ("", brief.reach),
        ("", brief.flow),
        ("Error: ", brief.error),
        ("", brief.sources),
        ("Doubt: ", brief.doubts[0] if brief.doubts else ""),
        ("", brief.influence),
        ("Next: ", brief.next),
        ("", brief.change),
    ):
        if text:
            lines += _wrapped(f"    {label}{text}", INDENT)
    return [line.rstrip().replace("±", "+/-").replace("z_hat", "ẑ") for line in lines]


def _wrapped(text: str, indent: str = "") -> list[str]:
    """Lines of at most `WIDTH` columns, all after the first indented."""
    whole = text.replace(" %", f"{FIRM}%").replace(" = ", f"{FIRM}={FIRM}")
    lines = textwrap.wrap(whole, WIDTH, subsequent_indent=indent, break_on_hyphens=False)
    return [line.replace(FIRM, " ") for line in lines]
