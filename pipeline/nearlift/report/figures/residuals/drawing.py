"""Residuals as small multiples: one covariate each; one boundary fills a grid, several stand side
by side in columns.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift.report.evidence import Rows, distinct, where
from nearlift.report.figures.style import SERIES, Style, distance, dots, plain_log, quantity

COLUMNS = 3
DISTANCES = ("z_hat", "previous_z_hat")
DISCRETE = 6


def draw(table: Rows, look: Style) -> Figure:
    """A panel for every boundary and covariate, all with one residual axis per boundary."""
    table = in_units(table, look)
    boundaries = distinct(table["panel"])
    covariates = distinct(table["covariate"])
    several = len(boundaries) > 1
    cells = [(boundary, covariate) for covariate in covariates for boundary in boundaries]
    columns = len(boundaries) if several else COLUMNS
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
            shades.append((ax, _panel(ax, chosen, covariate, look)))
        else:
            ax.set_axis_off()
    for ax, noise in shades:
        # the trials decide the limits; a noise model gone astray is cut off rather than hiding them
        ax.set_ylim(ax.get_ylim())
        sigma = noise["u_residual_percent"]
        ax.fill_between(noise["x"], -sigma, sigma, color="0.88", linewidth=0, step="mid", zorder=0)
    if several:
        for letter, boundary, ax in zip("abc", boundaries, axes[0], strict=False):
            ax.set_title(f"{letter}) {boundary}")
    figure.supylabel("relative residual (%)", fontsize=look.text_pt)
    return figure


def _panel(ax: Axes, rows: Rows, covariate: str, look: Style) -> Rows:
    """Dots and means; the rows of the noise band are handed back, to be drawn when all limits are
    known.
    """
    trials, means, noise = (where(rows, kind=kind) for kind in ("trial", "bin", "noise"))
    dots(ax, trials["x"], trials["residual_percent"])
    ax.axhline(0, color="0.3", linewidth=0.6, zorder=2)
    ax.errorbar(
        means["x"],
        means["residual_percent"],
        means["u_residual_percent"],
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
    elif len(means["x"]) <= DISCRETE:
        words = {-1.0: "closer", 1.0: "away"} if covariate == "approach" else {}
        names = [words.get(x, f"{x:.3g}".replace("-", "−")) for x in means["x"].tolist()]
        ax.set_xticks(means["x"], names)
        ax.margins(x=0.12)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    ax.set_xlabel(label(covariate, look), labelpad=1)
    return noise


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
