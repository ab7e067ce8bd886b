"""The loop in pictures: at each boundary the residual before and after, the candidates, the
held-out error, the coefficient.

One table holds everything that is drawn. Its column `letter` names the panel, so that picture and
caption agree; an adequate boundary has no panels for candidates and for the residual after, one
that stays unexplained none for the latter.
"""

from __future__ import annotations

import string
from typing import Any

import numpy as np

from nearlift.declare import BOUNDARIES, Boundary
from nearlift.report.evidence import Columns, Evidence, select, stack, text_column
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
TEXT = ("panel", "letter", "part", "kind", "when", "covariate", "series", "label", "note", "unit")
REAL = ("x", "value", "u", "lo90", "hi90", "n_trials")


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
    parts: list[Columns] = []
    for boundary, own in ((b, evidence.diagnosed(b)) for b in BOUNDARIES):
        if not own:
            continue
        parts.append(rows(boundary, part="verdict", kind=own.verdict, label=[_headline(own)]))
        for word in against.chosen(own):
            drawn = residuals(evidence, boundary, own, word)
            for when in dict.fromkeys(drawn["when"].tolist() if drawn else []):
                parts.append(_lettered(select(drawn, drawn["when"] == when), next(letters)))
        for table in (
            candidates(boundary, own),
            errors(evidence, boundary, own),
            coefficients(evidence, boundary, own),
        ):
            if len(table["panel"]):
                parts.append(_lettered(table, next(letters)))
    return stack([_full(p) for p in parts]) if parts else {}


def rows(boundary: str, **columns: Any) -> Columns:
    """Rows of the table; a single value stands in all of them, what is not given is empty."""
    lengths = [len(v) for v in columns.values() if not isinstance(v, str | float | int)]
    n = lengths[0] if lengths else 1
    table: Columns = {}
    for name, value in {"panel": boundary, **columns}.items():
        if isinstance(value, str):
            table[name] = text_column(value, n)
        elif name in TEXT:
            table[name] = np.array([*value, None], dtype=object)[:-1]
        else:
            table[name] = np.broadcast_to(np.asarray(value, dtype=float), (n,))
    return table


def _full(table: Columns) -> Columns:
    n = len(table["panel"])
    return {name: table.get(name, text_column("", n)) for name in TEXT} | {
        name: table.get(name, np.full(n, np.nan)) for name in REAL
    }


def _lettered(table: Columns, letter: str) -> Columns:
    return {**table, "letter": text_column(letter, len(table["panel"]))}


def _headline(found: BoundaryDiagnosis) -> str:
    if found.verdict == "effect":
        named = ((e.name, found.stand_ins(e)) for e in found.effects)
        return ", and ".join(
            f"{name} (or {', '.join(others)})" if others else name for name, others in named
        )
    return {
        "adequate": "nothing beyond the noise",
        "unexplained": "structure that no candidate explains",
    }.get(found.verdict, "")


def candidates(boundary: str, found: BoundaryDiagnosis) -> Columns:
    """The best candidates, the rejected ones with what they leave."""
    listed = ranked(found)
    shown = listed[:CANDIDATES]
    if listed and not any("+" not in c.tried.name for c in shown):
        # beside pairs, the best of those that stand alone shows why one is not enough
        shown = [*shown[:-1], next((c for c in listed if "+" not in c.tried.name), shown[-1])]
    notes = [_why_not(c) for c in shown]
    return rows(
        boundary,
        part="candidate",
        kind=[c.kind for c in shown],
        label=[c.tried.name for c in shown],
        note=[n if c.kind == "rejected" else "" for n, c in zip(notes, shown, strict=True)],
        value=np.array([c.behind for c in shown], dtype=float),
        unit="2 ln evidence",
    )


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


def errors(evidence: Evidence, boundary: Boundary, found: BoundaryDiagnosis) -> Columns:
    """Held-out errors in percent of lift as results.json has them, before and (where an effect was
    named) after, with their 90 %, and the noise floor.
    """
    error, told = found.error, evidence.quoted(boundary).error
    if not error or told is None:
        return rows(boundary, label=[])
    whens = ("before", "after") if found.verdict == "effect" else ("before",)
    columns = [rows(boundary, part="error", kind="floor", value=100 * told.noise_floor, unit="%")]
    for when in whens:
        own = error.after if when == "after" else error.before
        columns.append(
            rows(
                boundary,
                part="error",
                kind="rmse",
                when=when,
                value=100 * (told.after if when == "after" else told.before),
                lo90=100 * own.lo90,
                hi90=100 * own.hi90,
                unit="%",
            )
        )
    return stack([_full(c) for c in columns])


def coefficients(evidence: Evidence, boundary: Boundary, found: BoundaryDiagnosis) -> Columns:
    """The first coefficients as quoted, beneath them what they would be on other conditions, and
    the literature's value where there is one.
    """
    columns = []
    when = "after" if found.verdict == "effect" else "before"
    told = [p for p in evidence.quoted(boundary).coefficients.items() if p[1].refused is None]
    for name, c in told[:COEFFICIENTS]:
        shown = [("quoted", "", c.value, c.lo90, c.hi90)]
        shown += [("doubt", d.condition, d.value, d.lo90, d.hi90) for d in c.doubts[:DOUBTS]]
        for kind, note, value, low, high in shown:
            columns.append(
                rows(
                    boundary,
                    part="coefficient",
                    kind=kind,
                    when=when,
                    label=name,
                    note=note,
                    value=value,
                    lo90=low,
                    hi90=high,
                    unit=c.unit,
                )
            )
        for reference in fig2.references(evidence, boundary):
            if reference.model == found.base_model and name in reference.arguments:
                source = reference.label.partition("(")[2].rstrip(")")
                value = float(reference.arguments[name])
                columns.append(
                    rows(
                        boundary,
                        part="coefficient",
                        kind="reference",
                        label=name,
                        note=source,
                        value=value,
                        unit=c.unit,
                    )
                )
    return stack([_full(c) for c in columns]) if columns else rows(boundary, label=[])
