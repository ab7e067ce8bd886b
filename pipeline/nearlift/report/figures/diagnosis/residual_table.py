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
from nearlift.results import Observations
from nearlift.results.diagnosis import BoundaryDiagnosis

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
    parts: list[Columns] = []
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
            parts += [_rows("trial", when, name, x, y, label=trial), _means(when, name, x, y, bins)]
            if diagnosis.verdict == "unexplained" and not axis.series:
                parts.append(_rows("curve", when, name, *against.curve(axis.column, x, y)))
        floor = 100 * diagnosis.noise_floor
        parts.append(_rows("floor", when, "", np.array([np.nan]), np.array([floor])))
        if axis.column == "run_order":
            starts = np.asarray(np.flatnonzero(np.diff(data.session)) + 1.5, dtype=float)
            parts.append(_rows("session", when, "", starts, np.zeros(len(starts))))
    if not parts:
        return {}
    table = stack(parts)
    reach = _reach(table)
    table["kind"] = np.where(
        (table["kind"] == "trial") & (np.abs(table["value"]) > reach), "beyond", table["kind"]
    )
    ends = [_rows("reach", when, "", np.array([np.nan]), np.array([reach])) for when in whens]
    table = stack([table, *ends])
    n = len(table["x"])
    fixed = {"panel": boundary, "part": "residual", "covariate": axis.column, "unit": "%"}
    # what the series are levels of, for the legend
    return {
        **table,
        **{k: text_column(v, n) for k, v in fixed.items()},
        "note": text_column(axis.series, n),
    }


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


def _rows(kind: str, when: str, series: str, x: FloatArray, y: FloatArray, **more: Any) -> Columns:
    n = len(x)
    empty = np.full(n, np.nan)
    return {
        "kind": text_column(kind, n),
        "when": text_column(when, n),
        "series": text_column(series, n),
        "label": more.get("label", text_column("", n)),
        "x": np.asarray(x, dtype=float),
        "value": np.asarray(y, dtype=float),
        "u": more.get("u", empty),
        "n_trials": more.get("n", empty),
    }


def _means(when: str, series: str, x: FloatArray, y: FloatArray, label: Any) -> Columns:
    count = np.bincount(label)
    mean = np.bincount(label, y) / count
    spread = np.sqrt(np.bincount(label, (y - mean[label]) ** 2) / np.maximum(count - 1, 1))
    error = np.where(count > 1, spread / np.sqrt(count), np.nan)
    return _rows(
        "bin", when, series, np.bincount(label, x) / count, mean, u=error, n=count.astype(float)
    )


def _reach(table: Columns) -> float:
    """Half the height of the axis: most of the trials before, and every mean with its standard
    error.
    """
    cloud = table["value"][(table["kind"] == "trial") & (table["when"] == "before")]
    means = table["kind"] == "bin"
    ends = np.abs(table["value"][means]) + np.nan_to_num(table["u"][means])
    most = min(REACH * 1.4826 * float(np.median(np.abs(cloud))), 1.08 * float(np.abs(cloud).max()))
    return float(max(most, 1.15 * ends.max(initial=0.0), 1e-6))
