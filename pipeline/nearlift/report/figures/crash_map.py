"""Crash rate over pairs of dimensionless groups (gains, noise, the noise's memory, the rotors'
spacing), with the contours of 10, 50 and 90 %; a row per boundary.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nearlift import nomenclature
from nearlift.flight.simulation.maps import PAIRS
from nearlift.products import CRASH_MAP, SAFETY
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, select
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SEQUENTIAL, Style, plain_log

SHOWN = (
    *("boundary", "model", "map", "x_group", "y_group", "x", "y"),
    *("target_z_hat", "flights", "rate", "lo90", "hi90"),
)
#: Contours and their lines; numbers beside them would hide what is flown.
LEVELS = {10.0: "dotted", 50.0: "solid", 90.0: "dashed"}
WORDS = {
    "alpha": ("proportional gain", "alpha_group"),
    "beta": ("derivative gain", "beta_group"),
    "noise": ("noise", "noise_group"),
    "correlation": ("memory", "correlation_group"),
    "spacing_hat": ("spacing", "spacing_hat"),
}


def summarise(evidence: Evidence) -> Columns:
    """The maps as they stand in their product, with the values flown elsewhere.

    Returns
    -------
    dict of arrays
        The product's columns, and `x_flown`, `y_flown`: the groups of the campaign's own flights; 0
        where they lie off the map's axis.
    """
    table, fitted = evidence.table(CRASH_MAP), evidence.document(SAFETY)["fitted"]
    shown: Columns = {name: table[name] for name in SHOWN}
    for axis in ("x", "y"):
        flown = np.zeros(len(table[axis]))
        for side, fit in fitted.items():
            for group in set(table[f"{axis}_group"].tolist()):
                mine = (table["boundary"] == side) & (table[f"{axis}_group"] == group)
                value = fit["spacing_hat"] if group == "spacing_hat" else fit["groups"][group]
                flown[mine] = abs(value or 0.0)
        shown[f"{axis}_flown"] = flown
    return shown


def caption(evidence: Evidence, table: Columns) -> str:
    """What is drawn, and at which other groups."""
    parts = [
        (
            "Crash rate of the fitted model over pairs of groups of Eq. 6 and of those that it"
            " leaves out, all others as flown elsewhere (circle; an arrow where that is off the"
            " map: gusts without memory). White lines: 10 % (dotted), 50 % (solid) and 90 %"
            " (dashed), which so many flights resolve."
        ),
    ]
    along = [p for p in PAIRS if p.along]
    if along:
        parts.append(
            "Where noise stands against gain, α and γ change in proportion to β, so that the loop"
            " keeps its shape."
        )
    for side, fit in evidence.document(SAFETY)["fitted"].items():
        mine = table["boundary"] == side
        if mine.any():
            g = fit["groups"]
            parts.append(
                f"{side.capitalize()}: set-point ẑ = {table['target_z_hat'][mine][0]:g},"
                f" {table['flights'][mine][0]} flights a cell; α = {abs(g['alpha']):.3g}, β ="
                f" {abs(g['beta']):.3g}, γ = {abs(g['gamma']):.2g}, δ = {g['delta']:.3g} (over"
                f" hover far away), σ/mg = {g['noise']:.3g}, gusts held {g['hold']:.3g} √(r/g);"
                f" halving the step changes a rate by up to {fit['maps']['worst']:.2g}"
                f" ({fit['maps']['settings']} cells, corners and those between 10 and 90 %)."
            )
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = []
    for side in distinct(table["boundary"]):
        for name in distinct(table["map"][table["boundary"] == side]):
            rate = 100 * table["rate"][(table["boundary"] == side) & (table["map"] == name)]
            parts.append(f"{side}, {name}: from {rate.min():.0f} to {rate.max():.0f} %")
    return "Maps of crash rate. " + "; ".join(parts) + "."


def draw(table: Rows, look: Style) -> Figure:
    """A row for each boundary, a column for each pair of groups."""
    sides = distinct(table["boundary"])
    names = distinct(table["map"])
    figure = Figure(
        figsize=(look.double_in, (0.08 + 0.27 * len(sides)) * look.double_in), layout="constrained"
    )
    axes = figure.subplots(len(sides), len(names), squeeze=False)
    letters = iter("abcdefgh")
    mesh: Any = None
    for row, side in zip(axes, sides, strict=True):
        for ax, name in zip(row, names, strict=True):
            mine = (table["boundary"] == side) & (table["map"] == name)
            if not mine.any():
                ax.set_axis_off()
                continue
            mesh = _map(ax, select(table, mine))
            ax.set_title(f"{next(letters)}) {side}")
    figure.colorbar(mesh, ax=list(axes.ravel()), label="crash rate (%)", pad=0.01, aspect=30)
    return figure


def _map(ax: Axes, cells: Rows) -> Any:
    x, y = np.unique(cells["x"]), np.unique(cells["y"])
    rate = np.full((len(y), len(x)), np.nan)
    rate[np.searchsorted(y, cells["y"]), np.searchsorted(x, cells["x"])] = 100 * cells["rate"]
    ax.set_xscale("log")
    ax.set_yscale("log")
    mesh = ax.pcolormesh(
        x, y, rate, cmap=SEQUENTIAL, vmin=0, vmax=100, shading="nearest", rasterized=True
    )
    if rate.min() < max(LEVELS) and rate.max() > min(LEVELS):
        ax.contour(
            x,
            y,
            rate,
            levels=list(LEVELS),
            linestyles=list(LEVELS.values()),
            colors="white",
            linewidths=0.9,
        )
    at, height = float(cells["x_flown"][0]), float(cells["y_flown"][0])
    if at > 0:
        ax.plot(
            [at],
            [height],
            "o",
            color="white",
            markerfacecolor="none",
            markersize=6,
            markeredgewidth=1.0,
        )
    else:
        ax.plot(
            [0.06], [height], "<", color="white", markersize=5, transform=ax.get_yaxis_transform()
        )
    for axis in (ax.xaxis, ax.yaxis):
        plain_log(axis)
    for put, group in ((ax.set_xlabel, cells["x_group"][0]), (ax.set_ylabel, cells["y_group"][0])):
        word, symbol = WORDS[group]
        put(f"{word} {nomenclature.label(symbol)}")
    return mesh


FIGURE = FigureSpec(
    name="crash_map",
    title="Crash rate over dimensionless groups",
    needs=(CRASH_MAP, SAFETY),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
    asked=lambda campaign: campaign.simulate is None or campaign.simulate.maps,
)
