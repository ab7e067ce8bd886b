"""Chapters on trials and on the making of the page."""

from __future__ import annotations

import shlex

import numpy as np
from markupsafe import Markup

from nearlift.declare import BOUNDARIES
from nearlift.reduction.quality import CODES, reason, rejected
from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.number import count
from nearlift.rounding import plain
from nearlift.stages.ingest import TRIALS
from nearlift.version import __version__

NAMES = {"none": "free air"}
#: Trials that are listed unfolded.
MAX_UNFOLDED = 20


def quality(evidence: Evidence) -> Markup:
    """Counts per boundary and per quality code, and every rejected trial with its reason."""
    trials = evidence.table(TRIALS)
    out = rejected(trials["quality"])
    counts = [
        (
            NAMES.get(boundary, boundary.capitalize()),
            count(TRIALS, int(mine.sum()), f"rows with boundary {boundary}"),
            count(TRIALS, int((mine & out).sum()), "and a code in capitals in `quality`"),
        )
        for boundary in (*BOUNDARIES, "none")
        if (mine := trials["boundary"] == boundary).any()
    ]
    codes_of = [set(q.split()) for q in trials["quality"]]
    codes = [
        (name, count(TRIALS, n, f"rows with {name}"), meaning, "yes" if name.isupper() else "no")
        for name, meaning in CODES.items()
        if (n := sum(name in names for names in codes_of))
    ]
    faults = trials["fault"] if "fault" in trials else np.full(len(out), "")
    left_out = [
        (
            str(trials["trial"][i]),
            NAMES.get(str(trials["boundary"][i]), str(trials["boundary"][i])),
            plain(float(trials["z_hat"][i]), 4),
            f"{100 * float(trials['throttle'][i]):.4g} %",
            reason(str(trials["quality"][i]), str(faults[i])),
        )
        for i in np.flatnonzero(out)
    ]
    left_out += [
        (t.trial, b, "", "", f"accepted, outside the range of {model.title}: {t.reason}")
        for b in evidence.boundaries
        for model, fit in [evidence.base(b)]
        for t in fit.excluded
    ]
    every = f"Trials that took no part in a fit ({len(left_out)})"
    heads = ("trial", "boundary", "ẑ", "throttle", "reason")
    return blocks.join(
        blocks.table("Trials of each boundary", ("boundary", "trials", "left out"), counts),
        blocks.table("Quality codes", ("code", "trials", "meaning", "left out"), codes),
        blocks.fold(
            every,
            blocks.table(every, heads, left_out, hidden=True, source=TRIALS.file),
            opened=len(left_out) <= MAX_UNFOLDED,
        ),
    )


def provenance(evidence: Evidence) -> Markup:
    """Digests, versions, and the command that makes this again; nothing that changes from one run
    to the next.
    """
    seed = f" --seed {evidence.seed}" if evidence.seed else ""
    command = f"nearlift run {shlex.quote(evidence.folder)}{seed}"
    digests = [
        *sorted(evidence.inputs.items()),
        *sorted(evidence.digests.items()),
    ]
    versions = sorted({"nearlift": __version__, **evidence.versions}.items())
    tables = (
        ("Raw inputs and products", ("file", "SHA-256"), digests),
        ("Versions", ("package", "version"), versions),
    )
    return blocks.join(
        blocks.paragraph("To make the same files again, in the folder above the campaign:"),
        Markup('<pre tabindex="0">{}</pre>').format(command),
        *(
            blocks.fold(title, blocks.table(title, heads, rows, hidden=True))
            for title, heads, rows in tables
        ),
    )
