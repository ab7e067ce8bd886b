"""Doubts about the numbers of the first screen, and the numbers under other assumptions."""

from __future__ import annotations

import math

from nearlift.declare import Boundary
from nearlift.report import words
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place
from nearlift.stages.fit import FIT, RESULTS


def facts(evidence: Evidence) -> dict[str, object]:
    """Every doubt, every coefficient under another assumption, and chi2."""
    return {
        "doubts": words.doubts(evidence),
        "conditions": [
            {"boundary": b, **row} for b in evidence.boundaries for row in conditions(evidence, b)
        ],
        "goodness": [
            {
                "boundary": b,
                "reduced": reduced(evidence, b, evidence.base(b)[0].name),
                "words": words.goodness(evidence, b)[1],
            }
            for b in evidence.boundaries
        ],
    }


def conditions(evidence: Evidence, boundary: Boundary) -> list[dict[str, object]]:
    """Each coefficient under other assumptions."""
    rows = []
    for name, c in evidence.quoted(boundary).coefficients.items():
        place = Place(evidence, RESULTS, ("boundaries", boundary, "coefficients", name, "doubts"))
        rows += [
            {"condition": d.condition, "quoted": place.quote(i, name=name)}
            for i, d in enumerate(c.doubts)
        ]
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
