"""Residuals of the quoted model against what was recorded.

A residual is log lift - log model - log L_inf of one accepted trial, in percent, with the
identified effects in the model. Means over bins have their standard error, trials taken as
independent. The band is one standard deviation of a trial in the noise model.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray
from nearlift.likelihood import noise
from nearlift.likelihood.problem import height_slope, usable
from nearlift.reduction.quality import rejected
from nearlift.report import curves
from nearlift.report.evidence import (
    Columns,
    Evidence,
    Rows,
    distinct,
    select,
    stack,
    where,
)
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES, Style, distance, dots, plain_log, quantity
from nearlift.results import Observations
from nearlift.rounding import plain
from nearlift.stages.diagnose import LOOP_RESIDUALS
from nearlift.stages.fit import FIT
from nearlift.stages.ingest import TRIALS

COLUMNS = (
    *("panel", "covariate", "kind", "trial", "x"),
    *("residual_percent", "u_residual_percent", "n_trials"),
)
#: Up to this many distinct values a covariate is binned by value, beyond it by quantiles.
DISTINCT = 24
BINS = 16
ACROSS = 3
DISTANCES = ("z_hat", "previous_z_hat")
DISCRETE = 6
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


def summarise(evidence: Evidence, every: bool = False) -> Columns:
    """Everything that is drawn, a row each; on paper against distance, throttle, run order and the
    covariates of significant structure, else against `every` covariate.

    `panel` (boundary), `covariate`, `kind` (trial, bin or
    noise), `trial` (its id), `x`, `residual_percent`, `u_residual_percent`: of a bin the standard
    error of its mean, of noise the standard deviation of a trial there, `n_trials` of a bin.
    """
    rows, shown = [], _on_paper(evidence)
    for boundary in evidence.boundaries:
        data, residual, sigma = residuals(evidence, boundary)
        for name, x in covariates(data).items():
            if not every and name not in shown:
                continue
            panel = {"panel": boundary, "covariate": name}
            parts = _panel(data.trial, x, 100 * residual, 100 * sigma)
            rows += [{**panel, **part} for part in parts]
    return stack(rows, COLUMNS)


def _on_paper(evidence: Evidence) -> set[str]:
    """Covariates with a panel on paper."""
    covariates = {"z_hat", "throttle_percent", "run_order"}
    for boundary in evidence.boundaries:
        diagnosis = evidence.diagnosed(boundary)
        data = recorded(evidence.observations[boundary])
        for s in diagnosis.structure if diagnosis else ():
            if s.significant and s.covariate not in ("start", "throttle", "distance"):
                covariates |= {name for name in data if name.split("_")[0] == s.covariate}
    return covariates


def residuals(
    evidence: Evidence, boundary: Boundary
) -> tuple[Observations, FloatArray, FloatArray]:
    """The trials within the base model's range, their relative residuals, and the standard
    deviation expected of each.
    """
    model, fit = evidence.base(boundary)
    data = evidence.observations[boundary]
    parameters = fit.values
    data = data.take(usable(model, data))
    residual = curves.log_residual(model, fit, data)
    kept, diagnosed = evidence.fits.noise[boundary], evidence.diagnosed(boundary)
    if diagnosed and evidence.quoted(boundary).effects and evidence.has(LOOP_RESIDUALS):
        loop = where(evidence.table(LOOP_RESIDUALS), boundary=boundary)
        after = dict(zip(loop["trial"].tolist(), loop["after"].tolist(), strict=True))
        residual = np.array([after.get(t, np.nan) for t in data.trial.tolist()])
        kept = diagnosed.noise
    sigma = noise.trial_covariance(data, kept, height_slope(model, data, parameters)).sigma
    return data, residual, sigma


def covariates(data: Observations) -> dict[str, FloatArray]:
    """Abscissas of the residuals in drawing units, without those that do not vary."""
    every = recorded(data)
    varying = [name for name, x in every.items() if len(np.unique(x[np.isfinite(x)])) > 1]
    return {name: every[name] for name in ordered(varying)}


def recorded(data: Observations) -> dict[str, FloatArray]:
    """Every covariate in drawing units; free air has no distance."""
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
    """Indices of the values, split at gaps, so that no mean lies in one."""
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
        "Relative residuals of the quoted model, log lift − log model − log L∞, in percent. Dots:"
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
        place = f"{str(name).replace('_', ' ')} = {plain(float(x), 3)}"
        parts.append(
            f"{boundary.capitalize()}: the mean farthest from zero is {plain(float(mean), 2)} %"
            f" ({plain(float(pull[i]), 2)} standard errors) at {place}."
        )
    return "Residuals in percent against each covariate, means over bins. " + " ".join(parts)


def draw(table: Rows, look: Style) -> Figure:
    """A panel for every boundary and covariate, all with one residual axis per boundary."""
    table = in_units(table, look)
    boundaries = distinct(table["panel"])
    covariates = distinct(table["covariate"])
    several = len(boundaries) > 1
    cells = [(boundary, covariate) for covariate in covariates for boundary in boundaries]
    columns = len(boundaries) if several else ACROSS
    rows = -(-len(cells) // columns)
    height = min(1.25 * look.double_in / 6.75 * rows + 0.3, look.height_in)
    figure = Figure(figsize=(look.double_in, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharey="col" if several else True)
    for ax in axes.flat[len(cells) :]:
        ax.set_axis_off()
    shades = []
    for ax, (boundary, covariate) in zip(axes.flat, cells, strict=False):
        chosen = where(table, panel=boundary, covariate=covariate)
        if len(chosen["x"]):
            shades.append((ax, _draw_panel(ax, chosen, covariate, look)))
        else:
            ax.set_axis_off()
    for ax, expected in shades:
        # the trials decide the limits
        ax.set_ylim(ax.get_ylim())
        sigma = expected["u_residual_percent"]
        ax.fill_between(
            expected["x"], -sigma, sigma, color="0.88", linewidth=0, step="mid", zorder=0
        )
    if several:
        for letter, boundary, ax in zip("abc", boundaries, axes[0], strict=False):
            ax.set_title(f"{letter}) {boundary}")
    figure.supylabel("relative residual (%)", fontsize=look.text_pt)
    return figure


def _draw_panel(ax: Axes, rows: Rows, covariate: str, look: Style) -> Rows:
    """Dots and means; the rows of the noise band are handed back, to be drawn when all limits are
    known.
    """
    trials, centres, expected = (where(rows, kind=kind) for kind in ("trial", "bin", "noise"))
    dots(ax, trials["x"], trials["residual_percent"])
    ax.axhline(0, color="0.3", linewidth=0.6, zorder=2)
    ax.errorbar(
        centres["x"],
        centres["residual_percent"],
        centres["u_residual_percent"],
        fmt="o",
        color=SERIES[1][0],
        markersize=2.8,
        elinewidth=0.9,
        markeredgecolor="white",
        markeredgewidth=0.3,
        zorder=3,
    )
    if covariate == "z_hat":
        ax.set_xscale("log")
        plain_log(ax.xaxis)
    elif len(centres["x"]) <= DISCRETE:
        words = {-1.0: "closer", 1.0: "away"} if covariate == "approach" else {}
        names = [words.get(x, f"{x:.3g}".replace("-", "−")) for x in centres["x"].tolist()]
        ax.set_xticks(centres["x"], names)
        ax.margins(x=0.12)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    ax.set_xlabel(label(covariate, look), labelpad=1)
    return expected


def in_units(table: Rows, look: Style) -> Rows:
    """The table with distances as they are shown."""
    far = np.isin(table["covariate"], DISTANCES)
    return {**table, "x": np.where(far, distance(look)[0], 1.0) * table["x"]}


def label(covariate: str, look: Style) -> str:
    """Axis label of a covariate of the table."""
    if covariate in DISTANCES:
        return covariate.removesuffix("z_hat").replace("_", " ") + distance(look)[1]
    if covariate == "throttle_percent":
        return quantity("throttle", "%")
    if covariate == "run_order":
        return "run order (trial)"
    if covariate == "approach":
        return "direction of the last move"
    return quantity(covariate)


FIGURE = FigureSpec(
    name="residuals",
    title="Residuals of the quoted model",
    needs=(TRIALS, FIT),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
