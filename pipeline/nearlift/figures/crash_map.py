"""Maps of crash rate over pairs of dimensionless groups, with the contours of 10, 50 and 90 %; a
row for each boundary.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from nearlift import nomenclature
from nearlift.figures.style import SEQUENTIAL, Style

Rows = Mapping[str, Any]
#: Contours and their lines; numbers beside them would hide what is flown.
LEVELS = {10.0: "dotted", 50.0: "solid", 90.0: "dashed"}
WORDS = {
    "alpha": ("proportional gain", "alpha_group"),
    "beta": ("derivative gain", "beta_group"),
    "noise": ("noise", "noise_group"),
    "correlation": ("memory", "correlation_group"),
    "spacing_hat": ("spacing", "spacing_hat"),
}


def draw(table: Rows, look: Style) -> Figure:
    """A row for each boundary, a column for each pair of groups."""
    sides = list(dict.fromkeys(table["boundary"].tolist()))
    names = list(dict.fromkeys(table["map"].tolist()))
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
            mesh = _map(ax, {k: v[mine] for k, v in table.items()})
            ax.set_title(f"{next(letters)}) {side}", loc="left", fontsize=look.text_pt)
    figure.colorbar(mesh, ax=list(axes.ravel()), label="crash rate (%)", pad=0.01, aspect=30)
    return figure


def _map(ax: Axes, own: Rows) -> Any:
    x, y = np.unique(own["x"]), np.unique(own["y"])
    rate = np.full((len(y), len(x)), np.nan)
    rate[np.searchsorted(y, own["y"]), np.searchsorted(x, own["x"])] = 100 * own["rate"]
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
    at, height = float(own["x_flown"][0]), float(own["y_flown"][0])
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
    for axis, (low, high) in ((ax.xaxis, (x[0], x[-1])), (ax.yaxis, (y[0], y[-1]))):
        axis.set_major_locator(LogLocator(subs=(1.0,) if high > 20 * low else (1.0, 2.0, 3.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
    for put, group in ((ax.set_xlabel, own["x_group"][0]), (ax.set_ylabel, own["y_group"][0])):
        word, symbol = WORDS[group]
        put(f"{word} {nomenclature.label(symbol)}")
    return mesh
