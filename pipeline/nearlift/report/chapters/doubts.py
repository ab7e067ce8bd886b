"""Doubts about the numbers of the first screen, and the numbers under other assumptions."""

from __future__ import annotations

import math
from collections.abc import Sequence

from markupsafe import Markup

from nearlift.declare import Boundary
from nearlift.report import blocks, words
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place, quotation
from nearlift.report.tables import typeset
from nearlift.stages.fit import FIT


def facts(evidence: Evidence) -> Markup:
    """Every doubt, every coefficient under another assumption, and chi2."""
    return blocks.join(
        blocks.items(
            [
                Markup("{}{}").format(_of(d.boundaries), typeset(d.text))
                for d in words.doubts(evidence)
            ],
            "doubts",
        ),
        blocks.table(
            "Coefficients under other assumptions",
            ("boundary", "assumption", "coefficient", "90 %"),
            [row for b in evidence.boundaries for row in conditions(evidence, b)],
        ),
        *(
            blocks.paragraph(
                "{}: <i>χ</i>²/dof = {}: {}.",
                b.capitalize(),
                reduced(evidence, b, evidence.base(b)[0].name),
                words.goodness(evidence, b)[1],
            )
            for b in evidence.boundaries
        ),
    )


def _of(boundaries: Sequence[str]) -> Markup:
    names = ", ".join(boundaries).capitalize()
    return Markup("<strong>{}:</strong> ").format(names) if names else Markup("")


def conditions(evidence: Evidence, boundary: Boundary) -> list[tuple[object, ...]]:
    """Rows of each coefficient under other assumptions."""
    rows: list[tuple[object, ...]] = []
    for name, c in evidence.quoted(boundary).coefficients.items():
        place = quotation(evidence, boundary, name).at("doubts")
        for i, d in enumerate(c.doubts):
            q = place.quote(i, name=name)
            value = Markup("{} = {}").format(q.symbol, q.value)
            rows.append((boundary.capitalize(), d.condition, value, q.interval))
    return rows


def reduced(evidence: Evidence, boundary: Boundary, model: str) -> Number:
    """chi2 over its degrees of freedom."""
    place = Place(evidence, FIT, ("boundaries", boundary, model))
    chi2, dof = (place.number(k).value for k in ("chi2", "dof"))
    value = chi2 / dof if dof else math.nan
    return Number(
        text=f"{value:.2f}" if math.isfinite(value) else "–",
        value=value,
        source=place.source("chi2"),
        how="over dof of the same model",
    )
