"""The loop in pictures: at each boundary the residual before and after, the candidates, the
held-out error, the coefficient.

One table holds everything that is drawn. Its column `letter` names the panel, so that picture and
caption agree; an adequate boundary has no panels for candidates and for the residual after, one
that stays unexplained none for the latter.
"""

from __future__ import annotations

import string
from typing import Any

from nearlift.declare import BOUNDARIES, Boundary
from nearlift.report.evidence import Columns, Evidence, distinct, select, stack
from nearlift.report.figures.diagnosis import abscissa as against
from nearlift.report.figures.diagnosis.residual_table import residuals
from nearlift.report.figures.fig2 import table as fig2
from nearlift.report.findings import RankedCandidate, along, ranked
from nearlift.results.diagnosis import BoundaryDiagnosis

#: So many candidates are drawn.
CANDIDATES = 8
#: And so many coefficients of a base model.
COEFFICIENTS = 2
#: And so many of the conditions on which it would be another.
DOUBTS = 3
COLUMNS = (
    *("panel", "letter", "part", "kind", "when", "covariate", "series", "label", "note", "unit"),
    *("x", "value", "u", "lo90", "hi90", "n_trials"),
)


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each.

    Returns
    -------
    dict of arrays
        `panel` (boundary), `letter`, `part` (verdict, residual, candidate, error, coefficient),
        `kind`, `when` (before or after), `covariate` and `series` (of a residual), `label` (trial,
        candidate or coefficient), `note`, `unit`, `x`, `value`, `u` (one standard error), `lo90`,
        `hi90`, `n_trials`. A candidate's value is twice the log evidence by which it trails the
        best.
    """
    letters = iter(string.ascii_lowercase + string.ascii_uppercase)
    parts: list[dict[str, Any]] = []
    for boundary, diagnosis in ((b, evidence.diagnosed(b)) for b in BOUNDARIES):
        if not diagnosis:
            continue
        verdict = {"part": "verdict", "kind": diagnosis.verdict, "label": _headline(diagnosis)}
        parts.append({"panel": boundary, **verdict})
        for word in against.chosen(diagnosis):
            drawn = residuals(evidence, boundary, diagnosis, word)
            for when in distinct(drawn["when"]) if drawn else ():
                parts.append({**select(drawn, drawn["when"] == when), "letter": next(letters)})
        for part, rows in (
            ("candidate", candidates(diagnosis)),
            ("error", errors(evidence, boundary, diagnosis)),
            ("coefficient", coefficients(evidence, boundary, diagnosis)),
        ):
            if rows:
                shared = {"panel": boundary, "part": part, "letter": next(letters)}
                parts += [{**shared, **row} for row in rows]
    return stack(parts, COLUMNS)


def _headline(diagnosis: BoundaryDiagnosis) -> str:
    if diagnosis.verdict == "effect":
        named = ((e.name, diagnosis.stand_ins(e)) for e in diagnosis.effects)
        return ", and ".join(
            f"{name} (or {', '.join(others)})" if others else name for name, others in named
        )
    return {
        "adequate": "nothing beyond the noise",
        "unexplained": "structure that no candidate explains",
    }.get(diagnosis.verdict, "")


def candidates(diagnosis: BoundaryDiagnosis) -> list[dict[str, Any]]:
    """The best candidates, the rejected ones with what they leave."""
    listed = ranked(diagnosis)
    shown = listed[:CANDIDATES]
    if listed and not any("+" not in c.tried.name for c in shown):
        # beside pairs, the best of those that stand alone shows why one is not enough
        shown = [*shown[:-1], next((c for c in listed if "+" not in c.tried.name), shown[-1])]
    return [
        {
            "kind": c.kind,
            "label": c.tried.name,
            "note": _why_not(c) if c.kind == "rejected" else "",
            "value": c.behind,
            "unit": "2 ln evidence",
        }
        for c in shown
    ]


def _why_not(candidate: RankedCandidate) -> str:
    if candidate.refuted:
        return "not confirmed"
    if candidate.tried.judged_by:
        return "too little"
    return (
        f"leaves {along(candidate.tried.left_in).removeprefix('the ')}"
        if candidate.tried.left_in
        else "explains too little"
    )


def errors(
    evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis
) -> list[dict[str, Any]]:
    """Held-out errors in percent of lift as results.json has them, before and (where an effect was
    named) after, with their 90 %, and the noise floor.
    """
    error, quoted = diagnosis.error, evidence.quoted(boundary).error
    if not error or quoted is None:
        return []
    held_out = [("before", quoted.before, error.before)]
    if diagnosis.verdict == "effect":
        held_out.append(("after", quoted.after, error.after))
    return [
        {"kind": "floor", "value": 100 * quoted.noise_floor, "unit": "%"},
        *(
            {
                "kind": "rmse",
                "when": when,
                "value": 100 * value,
                "lo90": 100 * interval.lo90,
                "hi90": 100 * interval.hi90,
                "unit": "%",
            }
            for when, value, interval in held_out
        ),
    ]


def coefficients(
    evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis
) -> list[dict[str, Any]]:
    """The first coefficients as quoted, beneath them what they would be on other conditions, and
    the literature's value where there is one.
    """
    rows: list[dict[str, Any]] = []
    when = "after" if diagnosis.verdict == "effect" else "before"
    quoted = evidence.quoted(boundary).coefficients.items()
    stated = [(name, c) for name, c in quoted if c.refused is None]
    for name, c in stated[:COEFFICIENTS]:
        shared = {"label": name, "unit": c.unit}
        ends = {"value": c.value, "lo90": c.lo90, "hi90": c.hi90}
        rows.append({"kind": "quoted", "when": when, **shared, **ends})
        for d in c.doubts[:DOUBTS]:
            ends = {"value": d.value, "lo90": d.lo90, "hi90": d.hi90}
            rows.append({"kind": "doubt", "when": when, "note": d.condition, **shared, **ends})
        for reference in fig2.references(evidence, boundary):
            if reference.model == diagnosis.base_model and name in reference.arguments:
                source = reference.label.partition("(")[2].rstrip(")")
                value = float(reference.arguments[name])
                rows.append({"kind": "reference", "note": source, "value": value, **shared})
    return rows
