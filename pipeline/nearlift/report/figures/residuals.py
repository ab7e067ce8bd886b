"""Residuals of the quoted model, and of the base model where another one is quoted.

A residual is log lift - log model - log L_inf of one accepted trial, in percent. Means over bins
have their standard error, trials taken as independent. The band is one standard deviation of a
trial in the noise model.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from nearlift.declare import Boundary
from nearlift.likelihood import noise
from nearlift.likelihood.problem import height_slope, usable
from nearlift.nomenclature import SCHEDULE_WORDS
from nearlift.reduction.quality import rejected
from nearlift.report import curves
from nearlift.report.evidence import Evidence, Part, frame, pick
from nearlift.report.figures import style
from nearlift.report.figures.binning import abscissa, bins, columns, means
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES
from nearlift.stages.diagnose import LOOP_RESIDUALS
from nearlift.stages.fit import FIT
from nearlift.stages.ingest import TRIALS

COLUMNS = (
    *("panel", "covariate", "kind", "trial", "x"),
    *("residual_percent", "u_residual_percent", "n_trials"),
)
#: Panels across where there is one boundary.
ACROSS = 3
#: These come first, in this order; other covariates follow as the schedule has them.
ORDER = (
    *("z_hat", "throttle_percent", "run_order", "start_s", "session"),
    *("supply_V", "temperature_K", "tilt_rad", "approach"),
)
#: Colour and symbol of bin means: of the base model, and of the quoted model.
LOOKS = {"base": SERIES[1], "bin": SERIES[2]}


def residuals(evidence: Evidence, boundary: Boundary) -> pd.DataFrame:
    """Trials within the base model's range with their relative residuals, a row each.

    Columns are `trial` and every covariate; `quoted`, the residual of the quoted model; `sigma`,
    the expected standard deviation. `base` is the base model's residual, if another one is quoted.
    """
    model, fit = evidence.base(boundary)
    data = evidence.observations[boundary]
    data = data.take(usable(model, data))
    kept, diagnosed = evidence.fits.noise[boundary], evidence.diagnosed(boundary)
    rows: Part = {"quoted": curves.log_residual(model, fit, data)}
    if diagnosed and evidence.quoted(boundary).effects and evidence.has(LOOP_RESIDUALS):
        loop = evidence.frame(LOOP_RESIDUALS, boundary=boundary).set_index("trial")
        base, quoted = loop[["before", "after"]].reindex(data.trial).to_numpy(dtype=float).T
        rows, kept = {"quoted": quoted, "base": base}, diagnosed.noise
    sigma = noise.trial_covariance(data, kept, height_slope(model, data, fit.values)).sigma
    return pd.DataFrame({**columns(data), "trial": data.trial, "sigma": sigma, **rows})


def table(evidence: Evidence) -> pd.DataFrame:
    """Everything that is drawn, a row each.

    Residuals are against distance, throttle, run order and the covariate of each boundary's largest
    structure.

    `kind` is trial (with its id), bin, base (a bin of the base model's residuals) or noise. The
    `u_residual_percent` of noise is the standard deviation of a trial there.
    """
    parts: list[Part] = []
    shown = _on_paper(evidence)
    for boundary in evidence.boundaries:
        trials = residuals(evidence, boundary)
        covariates = trials.drop(columns=["trial", "sigma", "quoted", "base"], errors="ignore")
        levels = covariates.where(np.isfinite(covariates)).nunique()
        varying = [str(n) for n in levels.index[levels > 1] if n in shown]
        for name in sorted(varying, key=lambda n: ORDER.index(n) if n in ORDER else len(ORDER)):
            panel = {"panel": boundary, "covariate": name}
            parts += [{**panel, **part} for part in _panel(trials, name)]
    return frame(parts, COLUMNS)


def _on_paper(evidence: Evidence) -> set[str]:
    """Covariates with a panel on paper."""
    names = {"z_hat", "throttle_percent", "run_order"}
    for boundary in evidence.boundaries:
        diagnosed = evidence.diagnosed(boundary)
        structure = diagnosed.structure if diagnosed else ()
        largest = [s.covariate for s in structure if s.significant][:1]
        covariates = evidence.observations[boundary].covariates
        names |= {name for name in covariates if SCHEDULE_WORDS.get(name, name) in largest}
    return names


def _panel(trials: pd.DataFrame, name: str) -> list[Part]:
    trials = trials[np.isfinite(trials[name]) & np.isfinite(trials["quoted"])]
    x, label = trials[name].to_numpy(), bins(trials[name].to_numpy())
    residual = {"x": x, "residual_percent": 100 * trials["quoted"]}
    parts: list[Part] = [{"kind": "trial", "trial": trials["trial"], **residual}]
    for kind, column in (("bin", "quoted"), ("base", "base")):
        if column in trials:
            count, centre, mean, error = means(x, 100 * trials[column].to_numpy(), label)
            values = {"residual_percent": mean, "u_residual_percent": error, "n_trials": count}
            parts.append({"kind": kind, "x": centre, **values})
    expected = np.sqrt(np.bincount(label, (100 * trials["sigma"]) ** 2) / np.bincount(label))
    level = {"residual_percent": 0.0, "u_residual_percent": expected}
    return [*parts, {"kind": "noise", "x": parts[1]["x"], **level}]


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption, with counts."""
    parts = [
        (
            "Relative residuals of the quoted model, log lift − log model − log L∞, in"
            " percent. Dots: accepted trials. Triangles: means over bins with their standard"
            " error. Shade: ± 1 standard deviation of a trial in the noise model."
        )
    ]
    if (table["kind"] == "base").any():
        parts.append(
            "Hollow squares: means for the base model without effects, where one was identified."
        )
    for boundary in evidence.boundaries:
        model, _ = evidence.base(boundary)
        shown = len(pick(table, panel=boundary, kind="trial", covariate="run_order"))
        quality = evidence.frame(TRIALS, boundary=boundary)["quality"]
        lost = np.count_nonzero(rejected(quality.to_numpy()))
        beyond = evidence.observations[boundary].n - shown
        notes = [f"{shown} trials", *([f"{lost} rejected (not shown)"] if lost else [])]
        notes += [f"{beyond} outside the model's range (not shown)"] if beyond else []
        parts.append(f"{boundary.capitalize()}, {model.title}: {', '.join(notes)}.")
    return " ".join(parts)


def draw(table: pd.DataFrame) -> Figure:
    """A panel for every boundary and covariate, all with one residual axis per boundary."""
    boundaries, covariates = (list(table[name].unique()) for name in ("panel", "covariate"))
    several = len(boundaries) > 1
    cells = [(boundary, covariate) for covariate in covariates for boundary in boundaries]
    across = len(boundaries) if several else ACROSS
    down = -(-len(cells) // across)
    height = 1.3 * style.DOUBLE_IN / 6.75 * down + 0.5
    figure, axes = style.canvas(down, across, height, sharey="col" if several else True)
    for ax in axes.flat[len(cells) :]:
        ax.set_axis_off()
    drawn = table[table["kind"] != "noise"]
    reach = drawn["residual_percent"].abs() + drawn["u_residual_percent"].fillna(0)
    limits = 1.08 * reach.groupby(drawn["panel"]).max()
    for ax, (boundary, covariate) in zip(axes.flat, cells, strict=False):
        rows = pick(table, panel=boundary, covariate=covariate)
        if not len(rows):
            ax.set_axis_off()
            continue
        _draw_panel(ax, rows, covariate)
        ax.set_ylim(-limits[boundary], limits[boundary])
    if several:
        style.title(axes[0], boundaries)
    figure.supylabel("relative residual (%)")
    kinds = [("base", "base model, means", "white"), ("bin", "quoted model, means", None)]
    handles: list[Line2D | Patch] = [
        Line2D(
            [], [], color=LOOKS[kind][0], marker=LOOKS[kind][1], linestyle="none", label=name,
            markerfacecolor=inside,
        )
        for kind, name, inside in kinds
        if (table["kind"] == kind).any()
    ]  # fmt: skip
    handles.append(Patch(color=style.FLOOR, label="noise of one trial"))
    figure.legend(handles=handles, loc="outside upper right", ncols=3)
    return figure


def _draw_panel(ax: Axes, rows: pd.DataFrame, covariate: str) -> None:
    trials, expected = pick(rows, kind="trial"), pick(rows, kind="noise")
    sigma = expected["u_residual_percent"]
    style.band(ax, expected.x, -sigma, sigma, style.FLOOR, step="mid", zorder=0)
    style.zero(ax)
    style.dots(ax, trials.x, trials.residual_percent)
    for kind, size, inside, edge in (("base", 2.8, "white", None), ("bin", 3.4, None, "white")):
        mine = pick(rows, kind=kind)
        style.bars(
            ax, mine.x, mine.residual_percent, mine.u_residual_percent, LOOKS[kind],
            markersize=size, markerfacecolor=inside, markeredgecolor=edge,
        )  # fmt: skip
    abscissa(ax, covariate, pick(rows, kind="bin")["x"].tolist())


FIGURE = FigureSpec(
    "residuals", "Residuals of the quoted model", (TRIALS, FIT), table, caption, draw,
    "residual_percent", ("panel", "covariate"),
)  # fmt: skip
