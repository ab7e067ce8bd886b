"""The residual before and after, against one covariate: a cloud of trials, means over bins, the
noise floor.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.likelihood.covariates import derive
from nearlift.likelihood.problem import lift_ratio, usable
from nearlift.products import LOOP_RESIDUALS
from nearlift.report.evidence import Columns, Evidence, lift_inf_N, stack, text_column
from nearlift.report.figures.diagnosis import abscissa as against
from nearlift.report.figures.residuals.table import means
from nearlift.results import Observations
from nearlift.results.diagnosis import BoundaryDiagnosis

COLUMNS = ("kind", "when", "series", "label", "x", "value", "u", "n_trials")
#: The axis reaches so many standard deviations of a trial before; trials beyond stand at its edge.
REACH = 3.2


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
    labels: dict[str, NDArray[np.int64]] = {}
    parts: list[dict[str, Any]] = []
    for when in whens:
        for name, mine in against.series(axis.series, data):
            x, y = against.column(axis.column, data)[mine], both[when][mine]
            keep = (
                np.isfinite(x)
                & np.isfinite(both["before"][mine])
                & np.isfinite(both["after"][mine])
            )
            x, y, trial = x[keep], y[keep], data.trial[mine][keep]
            if not len(x):
                continue
            # the same bins before and after
            bins = labels.setdefault(
                name, against.label(axis.column, x, y, data.session[mine][keep])
            )
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
    table = stack(parts, COLUMNS)
    reach = _reach(table)
    table["kind"] = np.where(
        (table["kind"] == "trial") & (np.abs(table["value"]) > reach), "beyond", table["kind"]
    )
    ends = [{"kind": "reach", "when": when, "value": reach} for when in whens]
    table = stack([table, *ends], COLUMNS)
    fixed = {
        "panel": boundary,
        "part": "residual",
        "covariate": axis.column,
        "unit": "%",
        # what the series are levels of, for the legend
        "note": axis.series,
    }
    return {**table, **{k: text_column(v, len(table["x"])) for k, v in fixed.items()}}


def _joined(evidence: Evidence, boundary: Boundary) -> tuple[Observations, dict[str, FloatArray]]:
    """The boundary's trials with derived covariates, and their residuals before and after in
    percent.
    """
    model, fit = evidence.base(boundary)
    data = evidence.observations[boundary]
    data = data.take(usable(model, data))
    data = derive(data, lift_inf_N(fit, data), lift_ratio(model, data, fit.values))
    table = evidence.table(LOOP_RESIDUALS)
    mine = np.flatnonzero(table["boundary"] == boundary)
    row = {str(table["trial"][i]): i for i in mine.tolist()}
    data = data.take(np.array([str(t) in row for t in data.trial.tolist()], dtype=bool))
    at = np.array([row[str(t)] for t in data.trial.tolist()], dtype=int)
    return data, {
        when: 100 * np.asarray(table[when], dtype=float)[at] for when in ("before", "after")
    }


def _reach(table: Columns) -> float:
    """Half the height of the axis: most of the trials before, and every mean with its standard
    error.
    """
    cloud = table["value"][(table["kind"] == "trial") & (table["when"] == "before")]
    means = table["kind"] == "bin"
    ends = np.abs(table["value"][means]) + np.nan_to_num(table["u"][means])
    most = min(REACH * 1.4826 * float(np.median(np.abs(cloud))), 1.08 * float(np.abs(cloud).max()))
    return float(max(most, 1.15 * ends.max(initial=0.0), 1e-6))
