"""Crash rate over pairs of dimensionless groups (gains, noise, the noise's memory, the rotors'
spacing), with the contours of 10, 50 and 90 %; a row per boundary.
"""

from __future__ import annotations

import itertools
from dataclasses import asdict
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nearlift import nomenclature
from nearlift.products import CRASH_MAP, SAFETY
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SEQUENTIAL, Style, circles, plain_log

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
    """The maps as they stand in their product, with `x_flown` and `y_flown`: the groups of the
    campaign's own flights; 0 where they lie off the map's axis.
    """
    table, fitted = evidence.table(CRASH_MAP), evidence.safety.fitted
    groups = {
        s: {**asdict(fit.groups), "spacing_hat": fit.spacing_hat} for s, fit in fitted.items()
    }
    shown: Columns = {name: table[name] for name in SHOWN}
    for axis in ("x", "y"):
        drawn = zip(table["boundary"], table[f"{axis}_group"], strict=True)
        flown = [abs(groups.get(side, {}).get(group) or 0.0) for side, group in drawn]
        shown[f"{axis}_flown"] = np.array(flown)
    return shown


def caption(evidence: Evidence, table: Columns) -> str:
    """What is drawn, and at which other groups."""
    drawn = (
        "Crash rate of the fitted model over pairs of groups of Eq. 6 and of those that it leaves"
        " out, all others as flown elsewhere (circle; an arrow where that is off the map: gusts"
        " without memory). White lines: 10 % (dotted), 50 % (solid) and 90 % (dashed), which so"
        " many flights resolve. Where noise stands against gain, α and γ change in proportion to β,"
        " so that the loop keeps its shape."
    )
    parts = [drawn]
    for side, fit in evidence.safety.fitted.items():
        mine, g = where(table, boundary=side), fit.groups
        if fit.maps:
            parts.append(
                f"{side.capitalize()}: set-point ẑ = {mine['target_z_hat'][0]:g},"
                f" {mine['flights'][0]} flights a cell; α = {abs(g.alpha):.3g}, β ="
                f" {abs(g.beta):.3g}, γ = {abs(g.gamma):.2g}, δ = {g.delta:.3g} (over"
                f" hover far away), σ/mg = {g.noise:.3g}, gusts held {g.hold:.3g} √(r/g);"
                f" halving the step changes a rate by up to {fit.maps.worst:.2g}"
                f" ({fit.maps.settings} cells, corners and those between 10 and 90 %)."
            )
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = []
    for side in distinct(table["boundary"]):
        mine = where(table, boundary=side)
        for name in distinct(mine["map"]):
            rate = 100 * where(mine, map=name)["rate"]
            parts.append(f"{side}, {name}: from {rate.min():.0f} to {rate.max():.0f} %")
    return "Maps of crash rate. " + "; ".join(parts) + "."


def draw(table: Rows, look: Style) -> Figure:
    """A row for each boundary, a column for each pair of groups."""
    sides = distinct(table["boundary"])
    names = distinct(table["map"])
    height = (0.08 + 0.27 * len(sides)) * look.double_in
    figure = Figure(figsize=(look.double_in, height), layout="constrained")
    axes = figure.subplots(len(sides), len(names), squeeze=False)
    letters = iter("abcdefgh")
    mesh: Any = None
    for ax, (side, name) in zip(axes.flat, itertools.product(sides, names), strict=True):
        mine = where(table, boundary=side, map=name)
        if not len(mine["rate"]):
            ax.set_axis_off()
            continue
        mesh = _map(ax, mine)
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
        shares, dashes = zip(*LEVELS.items(), strict=True)
        ax.contour(x, y, rate, levels=shares, linestyles=dashes, colors="white", linewidths=0.9)
    at, height = float(cells["x_flown"][0]), float(cells["y_flown"][0])
    if at > 0:
        circles(ax, at, height, "white", markerfacecolor="none", markersize=6, markeredgewidth=1)
    else:
        along_y = ax.get_yaxis_transform()
        ax.plot(0.06, height, "<", color="white", markersize=5, transform=along_y)
    for axis, group in ((ax.xaxis, cells["x_group"][0]), (ax.yaxis, cells["y_group"][0])):
        plain_log(axis)
        word, symbol = WORDS[group]
        axis.set_label_text(f"{word} {nomenclature.label(symbol)}")
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
