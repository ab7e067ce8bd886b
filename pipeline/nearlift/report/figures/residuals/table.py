"""Residuals of the base model against everything that was recorded: where a model that lacks
something shows it.

A residual is log lift - log model - log L_inf of one accepted trial, in percent. Means over bins
carry their standard error, the trials taken as independent; the band is one standard deviation of a
trial as the fit's noise model has it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.likelihood import noise
from nearlift.likelihood.problem import height_slope, lift_ratio, usable
from nearlift.reduction.quality import rejected
from nearlift.report import curves
from nearlift.report.evidence import Columns, Evidence, lift_inf_N, select, stack, where
from nearlift.results import Observations
from nearlift.rounding import plain
from nearlift.stages.ingest import TRIALS

COLUMNS = (
    *("panel", "covariate", "kind", "trial", "x"),
    *("residual_percent", "u_residual_percent", "n_trials"),
)
#: Up to this many distinct values a covariate is binned by value, beyond it by quantiles.
DISTINCT = 24
BINS = 16
#: A gap of this part of the whole range parts two clusters of at least so many trials.
GAP = 0.05
FEWEST = 8
#: These come first, in this order; other covariates follow as the schedule has them.
ORDER = (
    "z_hat",
    "throttle_percent",
    "run_order",
    "start_s",
    "session",
    "supply_V",
    "temperature_K",
    "tilt_rad",
    "approach",
)


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each: `panel` (boundary), `covariate`, `kind` (trial, bin or
    noise), `trial` (its id), `x`, `residual_percent`, `u_residual_percent`: of a bin the standard
    error of its mean, of noise the standard deviation of a trial there, `n_trials` of a bin.
    """
    rows = []
    for boundary in evidence.boundaries:
        data, residual, sigma = residuals(evidence, boundary)
        for name, x in covariates(data).items():
            panel = {"panel": boundary, "covariate": name}
            parts = _panel(data.trial, x, 100 * residual, 100 * sigma)
            rows += [{**panel, **part} for part in parts]
    return stack(rows, COLUMNS)


def residuals(
    evidence: Evidence, boundary: Boundary
) -> tuple[Observations, FloatArray, FloatArray]:
    """The trials that the base model speaks about, their relative residuals, and the standard
    deviation expected of each.
    """
    model, fit = evidence.base(boundary)
    data = evidence.observations[boundary]
    parameters = fit.values
    data = data.take(usable(model, data))
    # where the trials told a shared height error, that is where they stand
    z_hat = data.z_hat + curves.height_found_m(fit) / data.radius_m
    log_ratio = np.log(lift_ratio(model, dataclasses.replace(data, z_hat=z_hat), parameters))
    log_level = np.log(lift_inf_N(fit, data))
    kept = evidence.fits.noise[boundary]
    sigma = noise.trial_covariance(data, kept, height_slope(model, data, parameters)).sigma
    return data, np.log(data.lift_N) - log_ratio - log_level, sigma


def covariates(data: Observations) -> dict[str, FloatArray]:
    """Abscissas of the residuals in drawing units, without those that do not vary."""
    every = recorded(data)
    varying = [name for name, x in every.items() if len(np.unique(x[np.isfinite(x)])) > 1]
    return {name: every[name] for name in ordered(varying)}


def recorded(data: Observations) -> dict[str, FloatArray]:
    """Every covariate in drawing units; free air stands at no distance."""
    return {
        **data.covariates,
        "z_hat": np.where(np.isfinite(data.z_hat), data.z_hat, np.nan),
        "throttle_percent": 100 * data.throttle,
        "run_order": np.arange(1, data.n + 1, dtype=float),
        "session": data.session + 1.0,
    }


def ordered(names: Iterable[str]) -> list[str]:
    """Covariates in the order of the figure."""
    return sorted(names, key=lambda name: ORDER.index(name) if name in ORDER else len(ORDER))


def _panel(
    trial: NDArray[np.object_], x: FloatArray, residual: FloatArray, sigma: FloatArray
) -> list[dict[str, object]]:
    keep = np.isfinite(x) & np.isfinite(residual)
    trial, x, residual, sigma = trial[keep], x[keep], residual[keep], sigma[keep]
    label = bins(x)
    count, centre, mean, error = means(x, residual, label)
    expected = np.sqrt(np.bincount(label, sigma**2) / count)
    return [
        {"kind": "trial", "trial": trial, "x": x, "residual_percent": residual},
        {
            "kind": "bin",
            "x": centre,
            "residual_percent": mean,
            "u_residual_percent": error,
            "n_trials": count,
        },
        {"kind": "noise", "x": centre, "residual_percent": 0.0, "u_residual_percent": expected},
    ]


def means(
    x: FloatArray, y: FloatArray, label: NDArray[Any]
) -> tuple[NDArray[np.int64], FloatArray, FloatArray, FloatArray]:
    """Count of each bin, the means of `x` and `y`, and the standard error of the latter; nan for
    one.
    """
    count = np.bincount(label)
    mean = np.bincount(label, y) / count
    spread = np.sqrt(np.bincount(label, (y - mean[label]) ** 2) / np.maximum(count - 1, 1))
    error = np.where(count > 1, spread / np.sqrt(count), np.nan)
    return count, np.bincount(label, x) / count, mean, error


def bins(x: FloatArray) -> NDArray[np.int64]:
    """Bin of each value, 0, 1, ... without gaps: by value where there are few, else by
    quantiles.
    """
    distinct, index = np.unique(x, return_inverse=True)
    if len(distinct) <= DISTINCT:
        return index.astype(np.int64)
    label = np.zeros(len(x), dtype=np.int64)
    first = 0
    for members in _clusters(x):
        values = x[members]
        count = max(round(BINS * len(values) / len(x)), 1)
        edges = np.unique(np.quantile(values, np.linspace(0, 1, count + 1)))
        place = np.searchsorted(edges, values, side="right") - 1
        _, inside = np.unique(np.clip(place, 0, max(len(edges) - 2, 0)), return_inverse=True)
        label[members] = first + inside
        first = int(label[members].max()) + 1
    return label


def _clusters(x: FloatArray) -> list[NDArray[np.int64]]:
    """Indices of the values, parted where nothing was measured for a while: a mean must not stand
    in such a gap.
    """
    order = np.argsort(x, kind="stable")
    gaps = np.flatnonzero(np.diff(x[order]) > GAP * (x.max() - x.min())) + 1
    kept: list[int] = []
    for at in gaps.tolist():
        if at - (kept[-1] if kept else 0) >= FEWEST and len(x) - at >= FEWEST:
            kept.append(at)
    return np.split(order, kept)


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption, with counts."""
    text = (
        "Relative residuals of the base model, log lift − log model − log L∞, in percent. Dots:"
        " accepted trials. Circles: means over bins with their standard error. Shade: ± 1 standard"
        " deviation of a trial in the noise model."
    )
    parts = [text]
    for boundary in evidence.boundaries:
        model, _ = evidence.base(boundary)
        shown = len(where(table, panel=boundary, kind="trial", covariate="run_order")["x"])
        trials = where(evidence.table(TRIALS), boundary=boundary)
        lost = np.count_nonzero(rejected(trials["quality"]))
        beyond = evidence.observations[boundary].n - shown
        notes = [f"{shown} trials", *([f"{lost} rejected (not shown)"] if lost else [])]
        if beyond:
            notes.append(f"{beyond} outside the model's range (not shown)")
        parts.append(f"{boundary.capitalize()}, {model.title}: {', '.join(notes)}.")
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """Description for screen readers: the largest deviation of bin means."""
    parts = []
    for boundary in evidence.boundaries:
        binned = where(table, panel=boundary, kind="bin")
        binned = select(binned, (binned["u_residual_percent"] > 0) & (binned["n_trials"] >= FEWEST))
        if not len(binned["x"]):
            continue
        pull = np.abs(binned["residual_percent"]) / binned["u_residual_percent"]
        i = int(np.argmax(pull))
        name, x, mean = (binned[k][i] for k in ("covariate", "x", "residual_percent"))
        parts.append(
            f"{boundary.capitalize()}: the mean farthest from zero is {plain(float(mean), 2)} %"
            f" ({plain(float(pull[i]), 2)} standard errors) at {name} = {plain(float(x), 3)}."
        )
    return "Residuals in percent against each covariate, means over bins. " + " ".join(parts)
