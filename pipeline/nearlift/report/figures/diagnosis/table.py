"""The loop in pictures: at each boundary the residual before and after, the candidates, the
held-out error, the coefficient.

One table holds everything that is drawn. Its column `letter` names the panel, so that picture and
caption agree; an adequate boundary has no panels for candidates and for the residual after, one
that stays unexplained none for the latter.
"""

from __future__ import annotations

import math
import string
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import BOUNDARIES, Boundary, FloatArray
from nearlift.likelihood.covariates import derive
from nearlift.likelihood.problem import lift_ratio, usable
from nearlift.report.evidence import Columns, Evidence, distinct, lift_inf_N, stack, where
from nearlift.report.figures.diagnosis import abscissa as against
from nearlift.report.figures.fig2 import table as fig2
from nearlift.report.figures.residuals.table import means
from nearlift.report.findings import RankedCandidate, ranked
from nearlift.report.phrases import along
from nearlift.results import Observations
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.stages.diagnose import LOOP_RESIDUALS

#: So many candidates are drawn.
CANDIDATES = 8
#: And so many coefficients of a base model.
COEFFICIENTS = 2
#: And so many of the conditions on which it would be another.
DOUBTS = 3
#: The axis reaches so many standard deviations of a trial before; trials beyond stand at its edge.
REACH = 3.2
COLUMNS = (
    *("panel", "letter", "part", "kind", "when", "covariate", "series", "label", "note", "unit"),
    *("x", "value", "u", "lo90", "hi90", "n_trials"),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopNumber:
    """A number of a candidate, an error or a coefficient, with the columns of the table."""

    kind: str
    when: str = ""
    label: str = ""
    note: str = ""
    unit: str
    value: float
    lo90: float = math.nan
    hi90: float = math.nan


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each: `panel` (boundary), `letter`, `part` (verdict,
    residual, candidate, error, coefficient), `kind`, `when` (before or after), `covariate` and
    `series` (of a residual), `label` (trial, candidate or coefficient), `note`, `unit`, `x`,
    `value`, `u` (one standard error), `lo90`, `hi90`, `n_trials`. A candidate's value is twice the
    log evidence by which it trails the best.
    """
    letters = iter(string.ascii_lowercase + string.ascii_uppercase)
    parts: list[dict[str, object]] = []
    for boundary, diagnosis in ((b, evidence.diagnosed(b)) for b in BOUNDARIES):
        if not diagnosis:
            continue
        verdict = {"part": "verdict", "kind": diagnosis.verdict, "label": _headline(diagnosis)}
        parts.append({"panel": boundary, **verdict})
        for word in against.chosen(diagnosis):
            drawn = residuals(evidence, boundary, diagnosis, word)
            for when in distinct(drawn["when"]) if drawn else ():
                parts.append({**where(drawn, when=when), "letter": next(letters)})
        numbers = {
            "candidate": candidates(diagnosis),
            "error": errors(evidence, boundary, diagnosis),
            "coefficient": coefficients(evidence, boundary, diagnosis),
        }
        for part, rows in numbers.items():
            if rows:
                shared = {"panel": boundary, "part": part, "letter": next(letters)}
                parts += [{**shared, **asdict(row)} for row in rows]
    return stack(parts, COLUMNS)


def _headline(diagnosis: BoundaryDiagnosis) -> str:
    if diagnosis.verdict == "adequate":
        return "nothing beyond the noise"
    if diagnosis.verdict == "unexplained":
        return "structure that no candidate explains"
    named = ((e.name, diagnosis.stand_ins(e)) for e in diagnosis.effects)
    return ", and ".join(
        f"{name} (or {', '.join(others)})" if others else name for name, others in named
    )


def residuals(
    evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis, word: str
) -> Columns:
    """Rows of one covariate, in percent: `trial` (`beyond` where outside the axis), `bin`, `curve`,
    `floor`, `reach`, `session`.

    `when` is before and, where an effect was named, after. A curve without a name follows what
    stays unexplained.
    """
    data, both = _joined(evidence, boundary)
    if not data.n:
        return {}
    axis = against.axis(word, data)
    whens = ("before", "after") if diagnosis.verdict == "effect" else ("before",)
    covariate = against.column(axis.column, data)
    known = np.isfinite(covariate) & np.isfinite(both["before"]) & np.isfinite(both["after"])
    labels: dict[str, NDArray[np.int64]] = {}
    parts: list[dict[str, object]] = []
    for when in whens:
        for name, level in against.series(axis.series, data):
            mine = level & known
            x, y, trial = covariate[mine], both[when][mine], data.trial[mine]
            if not len(x):
                continue
            # the same bins before and after
            bins = labels.setdefault(name, against.label(axis.column, x, y, data.session[mine]))
            count, centre, mean, error = means(x, y, bins)
            drawn = {"when": when, "series": name}
            parts += [
                {**drawn, "kind": "trial", "label": trial, "x": x, "value": y},
                {**drawn, "kind": "bin", "x": centre, "value": mean, "u": error, "n_trials": count},
            ]
            if diagnosis.verdict == "unexplained" and not axis.series:
                along, curve = against.curve(axis.column, x, y)
                parts.append({**drawn, "kind": "curve", "x": along, "value": curve})
        parts.append({"kind": "floor", "when": when, "value": 100 * diagnosis.noise_floor})
        if axis.column == "run_order":
            starts = np.flatnonzero(np.diff(data.session)) + 1.5
            parts.append({"kind": "session", "when": when, "x": starts, "value": 0.0})
    shared = {
        "panel": boundary,
        "part": "residual",
        "covariate": axis.column,
        "unit": "%",
        # what the series are levels of, for the legend
        "note": axis.series,
    }
    table = stack([{**part, **shared} for part in parts], COLUMNS)
    reach = _reach(table)
    far = (table["kind"] == "trial") & (np.abs(table["value"]) > reach)
    table["kind"][far] = "beyond"
    ends = [{"kind": "reach", "when": when, "value": reach, **shared} for when in whens]
    return stack([table, *ends], COLUMNS)


def _joined(evidence: Evidence, boundary: Boundary) -> tuple[Observations, dict[str, FloatArray]]:
    """The boundary's trials with derived covariates, and their residuals before and after in
    percent.
    """
    model, fit = evidence.base(boundary)
    data = evidence.observations[boundary]
    data = data.take(usable(model, data))
    data = derive(data, lift_inf_N(fit, data), lift_ratio(model, data, fit.values))
    table = where(evidence.table(LOOP_RESIDUALS), boundary=boundary)
    row = {str(trial): i for i, trial in enumerate(table["trial"])}
    data = data.take(np.array([str(t) in row for t in data.trial], dtype=bool))
    at = np.array([row[str(t)] for t in data.trial], dtype=int)
    return data, {when: 100 * table[when][at].astype(float) for when in ("before", "after")}


def _reach(table: Columns) -> float:
    """Half the height of the axis: most of the trials before, and every mean with its standard
    error.
    """
    cloud = np.abs(where(table, kind="trial", when="before")["value"])
    means = where(table, kind="bin")
    ends = np.abs(means["value"]) + np.nan_to_num(means["u"])
    most = min(REACH * 1.4826 * float(np.median(cloud)), 1.08 * float(cloud.max()))
    return float(max(most, 1.15 * ends.max(initial=0.0), 1e-6))


def candidates(diagnosis: BoundaryDiagnosis) -> list[LoopNumber]:
    """The best candidates, the rejected ones with what they leave."""
    listed = ranked(diagnosis)
    shown = listed[:CANDIDATES]
    if listed and not any("+" not in c.tried.name for c in shown):
        # beside pairs, the best of those that stand alone shows why one is not enough
        shown = [*shown[:-1], next((c for c in listed if "+" not in c.tried.name), shown[-1])]
    return [
        LoopNumber(
            kind=c.kind,
            label=c.tried.name,
            note=_why_not(c) if c.kind == "rejected" else "",
            unit="2 ln evidence",
            value=c.behind,
        )
        for c in shown
    ]


def _why_not(candidate: RankedCandidate) -> str:
    if candidate.refuted:
        return "not confirmed"
    if candidate.tried.judged_by:
        return "too little"
    if candidate.tried.left_in:
        return f"leaves {along(candidate.tried.left_in)}"
    return "explains too little"


def errors(
    evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis
) -> list[LoopNumber]:
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
        LoopNumber(kind="floor", unit="%", value=100 * quoted.noise_floor),
        *(
            LoopNumber(
                kind="rmse",
                when=when,
                unit="%",
                value=100 * value,
                lo90=100 * interval.lo90,
                hi90=100 * interval.hi90,
            )
            for when, value, interval in held_out
        ),
    ]


def coefficients(
    evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis
) -> list[LoopNumber]:
    """The first coefficients as quoted, beneath them what they would be on other conditions, and
    the literature's value where there is one.
    """
    rows = []
    when = "after" if diagnosis.verdict == "effect" else "before"
    for name, c in [*evidence.quoted(boundary).coefficients.items()][:COEFFICIENTS]:
        number = LoopNumber(
            kind="quoted",
            when=when,
            label=name,
            unit=c.unit,
            value=c.value,
            lo90=c.lo90,
            hi90=c.hi90,
        )
        rows.append(number)
        for d in c.doubts[:DOUBTS]:
            doubt = replace(number, kind="doubt", note=d.condition)
            rows.append(replace(doubt, value=d.value, lo90=d.lo90, hi90=d.hi90))
        for reference in fig2.references(evidence, boundary):
            if reference.model == diagnosis.base_model and name in reference.arguments:
                source = reference.label.partition("(")[2].rstrip(")")
                value = float(reference.arguments[name])
                rows.append(
                    LoopNumber(kind="reference", label=name, note=source, unit=c.unit, value=value)
                )
    return rows
