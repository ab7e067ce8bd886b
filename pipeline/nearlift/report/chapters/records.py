"""Chapters on trials: rejections, the trial table with influence, and provenance."""

from __future__ import annotations

import math
import shlex

import numpy as np
from markupsafe import Markup

from nearlift.declare import BOUNDARIES, Boundary
from nearlift.nomenclature import letter
from nearlift.reduction.quality import CODES, code, reason, rejected
from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, count, pointer
from nearlift.report.trial_table import Exclusions, Refit
from nearlift.rounding import bytes_text, plain
from nearlift.stages.fit import FIT
from nearlift.stages.ingest import TRIALS
from nearlift.version import __version__

NAMES = {"none": "free air"}
#: Trials that are listed unfolded, and that are named in a sentence.
FEW = 20
#: Trials that the page lists; all of them are in trials.parquet.
MOST_ROWS = 5000


def quality(evidence: Evidence) -> Markup:
    """Counts per boundary and per quality code, and every rejected trial with its reason."""
    trials = evidence.table(TRIALS)
    out = rejected(trials["quality"])
    noted = np.array([bool(q) for q in trials["quality"]])
    kinds = (
        (np.ones_like(out), ""),
        (~out, " and no code in capitals in `quality`"),
        (out, " and a code in capitals in `quality`"),
        (~out & noted, " and only lower-case codes in `quality`"),
    )
    counts = [
        (
            NAMES.get(boundary, boundary.capitalize()),
            *(
                count(TRIALS, int((mine & rows).sum()), f"rows with boundary {boundary}{which}")
                for rows, which in kinds
            ),
        )
        for boundary in (*BOUNDARIES, "none")
        if (mine := trials["boundary"] == boundary).any()
    ]
    words = [set(q.split()) for q in trials["quality"]]
    codes = [
        (
            Markup("<code>{}</code>").format(c.name),
            count(TRIALS, n, f"rows with {c.name} in `quality`"),
            c.meaning,
            "left out" if c.rejects else "remark",
        )
        for c in CODES
        if (n := sum(c.name in w for w in words))
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
    every = "Every trial left out, with its reason"
    heads = ("trial", "boundary", "ẑ", "throttle", "reason")
    excluded = [
        blocks.fold(
            f"{b.capitalize()}: {len(fit.excluded)} accepted trials outside the range of"
            f" {model.title}",
            blocks.items([f"{t.trial}: {t.reason}" for t in fit.excluded]),
        )
        for b in evidence.boundaries
        for model, fit in [evidence.base(b)]
        if fit.excluded
    ]
    return blocks.join(
        blocks.table(
            "Trials of each boundary",
            ("boundary", "trials", "accepted", "left out", "accepted with a remark"),
            counts,
            hidden=True,
        ),
        blocks.table("Quality codes", ("code", "trials", "meaning", "consequence"), codes),
        blocks.fold(
            every,
            blocks.table(every, heads, left_out, hidden=True, source=TRIALS.file),
            opened=len(left_out) <= FEW,
        )
        if left_out
        else blocks.paragraph("No trial was left out."),
        *excluded,
    )


def trial_table(evidence: Evidence) -> Markup:
    """Numbers of files, samples and trials at each step; influence of exclusions; a row a trial."""
    assert evidence.trial_table is not None
    table = evidence.trial_table()
    c = table.counts
    size = Number(
        text=bytes_text(table.bytes),
        value=float(table.bytes),
        source=TRIALS.file,
        how="bytes of the files in `source`",
    )
    samples = (
        Markup("; of {} samples").format(count(TRIALS, table.samples, "sum of `samples`"))
        if table.samples is not None
        else ""
    )
    rows = [
        (
            t.trial,
            NAMES.get(t.boundary, t.boundary),
            t.source,
            t.sha256[:8],
            t.completeness,
            t.samples,
            t.averaged,
            "–" if math.isnan(t.lift_N) else plain(1e3 * t.lift_N, 5),
            " ".join(t.codes),
            ", ".join(t.figures).replace("fig2", "Figure 2") or "none",
        )
        for t in table.trials[:MOST_ROWS]
    ]
    heads = (
        *("trial", "boundary", "file", "SHA-256", "record", "samples", "averaged", "lift, mN"),
        *("codes", "drawn in"),
    )
    more = len(table.trials) - MOST_ROWS
    return blocks.join(
        blocks.paragraph(
            "{} {} with {}{}, {} were averaged, without tare and settling. Trials: {} scheduled,"
            " {} recorded, {} accepted ({} with a remark), {} within the range of the base model.",
            count(TRIALS, table.files, "different `source`"),
            "files" if table.files != 1 else "file",
            size,
            samples,
            count(TRIALS, table.averaged, "sum of `n`"),
            count(TRIALS, c.scheduled, "rows"),
            count(TRIALS, c.recorded, "rows not `missing`"),
            count(TRIALS, c.accepted, "rows without a code in capitals"),
            count(TRIALS, c.remarked, "rows with only lower-case codes"),
            count(TRIALS, c.fitted, "accepted rows within the model's range"),
        ),
        *(part for b, entry in table.put_back.items() for part in _influence(b, entry)),
        blocks.fold(
            "Every trial",
            blocks.table("Every trial", heads, rows, hidden=True, source=TRIALS.file),
            blocks.paragraph("{} more are in trials.parquet.", more) if more > 0 else "",
        ),
    )


def _influence(boundary: Boundary, entry: Exclusions) -> list[Markup]:
    """Change of the headline coefficient by each exclusion and outlier."""
    where = ("boundaries", boundary, entry.model, "parameters", entry.parameter)

    def changes(refit: Refit) -> tuple[object, ...]:
        """Change in the coefficient's unit and in standard uncertainties."""
        if refit.why_not:
            return f"not fitted: {refit.why_not}", "–"
        return tuple(
            Number(
                text=plain(value, 2) if math.isfinite(value) else "–",
                value=value,
                source=pointer(FIT, *where, key),
                how=how,
            )
            for value, key, how in (
                (refit.change, "value", "over this: value of a fit of the other choice of trials"),
                (refit.change_in_u, "u", "over this: change of the value"),
            )
        )

    named = [
        *([("all that can be", entry.all)] if entry.all else []),
        *((f"{name}: {code(name).meaning}", refit) for name, refit in entry.codes.items()),
        *((f"{name} left out", refit) for name, refit in entry.left_out.items()),
    ]
    side, change = boundary.capitalize(), f"change of the base fit's {letter(entry.parameter)}"
    heads = (change, "in its standard uncertainties")
    single = f"{side}: {len(entry.trials)} excluded trials put back one at a time"
    never = [f"{t} cannot be put back: {why}" for t, why in entry.cannot_be_put_back.items()]
    further = f"; and {len(never) - FEW} more" if len(never) > FEW else ""
    return [
        blocks.table(
            f"{side}: influence of the {entry.excluded} exclusions, and of outliers",
            ("put back or left out", "trials", *heads),
            [(what, refit.trials, *changes(refit)) for what, refit in named],
        ),
        blocks.fold(
            single,
            blocks.table(
                single,
                ("trial", *heads),
                [(name, *changes(refit)) for name, refit in entry.trials.items()],
                hidden=True,
            ),
        )
        if entry.trials
        else Markup(""),
        blocks.paragraph("{}: {}{}.", side, "; ".join(never[:FEW]), further, note=True)
        if never
        else Markup(""),
    ]


def provenance(evidence: Evidence) -> Markup:
    """Digests, versions, and the command that makes this again; nothing that changes from one run
    to the next.
    """
    seed = f" --seed {evidence.seed}" if evidence.seed else ""
    command = f"nearlift run {shlex.quote(evidence.campaign.name)}{seed}"
    copy = '<pre id="command" tabindex="0">{}</pre>{}'
    listed = (
        ("Raw inputs", evidence.inputs),
        ("Products that this page reads", evidence.digests),
    )
    return blocks.join(
        blocks.paragraph(
            "Made by nearlift {}, seed {}. To make the same files again, run in the folder above"
            " the campaign:",
            __version__,
            evidence.seed,
        ),
        Markup(copy).format(command, blocks.copies("command")),
        *(
            blocks.fold(
                f"{title} ({len(digests)})",
                blocks.table(
                    f"{title} with their digests",
                    ("file", "SHA-256"),
                    [(n, Markup("<code>{}</code>").format(s)) for n, s in sorted(digests.items())],
                    hidden=True,
                ),
            )
            for title, digests in listed
        ),
        blocks.fold(
            "Versions",
            blocks.paragraph(
                "{}", ", ".join(f"{n} {v}" for n, v in sorted(evidence.versions.items()))
            ),
        ),
    )
