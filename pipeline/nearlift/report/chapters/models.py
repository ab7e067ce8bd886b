"""Models of each boundary, side by side."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pandas as pd
from markupsafe import Markup

from nearlift.declare import Boundary
from nearlift.report import blocks, tables
from nearlift.report.chapters.numbers import reduced
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place, headline
from nearlift.stages.diagnose import NOT_DIAGNOSED
from nearlift.stages.fit import FIT


def facts(evidence: Evidence) -> Markup:
    """A table of models for each boundary, the best prediction first."""
    whole = tables.comparison(evidence)
    frame: Any = whole.frame.copy()
    each = list(zip(frame["boundary"], frame["model"], strict=True))
    # HTML is text to pandas, unless it is told that it is an object
    values = [_coefficients(evidence, b, m) for b, m in each]
    frame["coefficients"] = pd.Series(values, index=frame.index, dtype=object)
    frame["reduced"] = [reduced(evidence, b, m) for b, m in each]
    kept = {k: v for k, v in whole.shown.items() if k not in ("boundary", "model", "free")}
    shown = {"model": "model", "coefficients": "coefficients, if the model is right"}
    shown |= {"reduced": "χ²/dof"} | kept
    parts = []
    for b, c in evidence.fits.comparison.items():
        mine = replace(whole, frame=frame, shown=shown, main=frame["boundary"] == b)
        base = evidence.base(b)[0].title
        count = f"{c.models[c.reference].visits} visits; base: {base}"
        parts.append(tables.html(mine, f"{b.capitalize()}: {count}"))
        failed = evidence.fits.failed.get(b, {})
        if failed:
            text = "; ".join(f"{n} ({why})" for n, why in sorted(failed.items()))
            parts.append(blocks.paragraph("Not fitted: {}.", text, note=True))
    intro = (
        "Δ score: log predictive density of each visit, predicted from all others, less the base"
        " model's. A difference counts if it exceeds twice its u. Unlike R², the score lets a model"
        " deviate at the nearest distances by a stated distance error. Every row is a fit without"
        " effects; the coefficients to quote are in the summary."
    )
    return blocks.join(blocks.paragraph(intro), *parts)


def _coefficients(evidence: Evidence, boundary: Boundary, model: str) -> Markup | str:
    """Coefficients of the row's fit; the quoted ones where they are those of the base model."""
    quoted = evidence.quoted(boundary)
    if model == quoted.base_model and quoted.verdict in ("adequate", NOT_DIAGNOSED):
        each = [headline(evidence, boundary, n) for n in quoted.coefficients]
    else:
        place = Place(evidence, FIT, ("boundaries", boundary, model, "parameters"))
        each = [p.quote() for p in place.every()]
    return Markup("<br>").join(q.equation for q in each) or "none"
