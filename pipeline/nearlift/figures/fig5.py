"""Figure 5: the tilt series, three panels to a row, with vortex cores and the outline of the
stagnation zone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from nearlift.figures import flow_panel
from nearlift.figures.fig3 import X, Y
from nearlift.figures.flow_panel import select
from nearlift.figures.style import SERIES, Style

Rows = Mapping[str, Any]
ACROSS = 3
ZONE = SERIES[1][0]


def draw(table: Rows, look: Style) -> Figure:
    """One colour scale for all panels."""
    names = flow_panel.panels(table)
    across = min(ACROSS, len(names))
    down = -(-len(names) // across)
    (x0, x1), (y0, y1) = flow_panel.limits(table)
    tall = (look.double_in - 0.95) / across * (y1 - y0) / (x1 - x0)
    figure = Figure(
        figsize=(look.double_in, min(down * (tall + 0.25) + 0.35, look.height_in)),
        layout="constrained",
    )
    axes = figure.subplots(down, across, squeeze=False, sharex=True, sharey=True)
    norm = Normalize(0, flow_panel.highest(table))
    shade: Any = None
    for ax in axes.ravel()[len(names) :]:
        ax.set_axis_off()
    for letter, name, ax in zip("abcdefghijkl", names, axes.ravel(), strict=False):
        mine = select(table, table["panel"] == name)
        shade = flow_panel.field(ax, mine, flow_panel.speeds(), norm, density=0.85)
        x, y, zone = flow_panel.grid(select(mine, mine["kind"] == "node"), "flag")
        if zone.max() > 0:
            ax.contour(x, y, zone.filled(0), levels=[0.5], colors=[ZONE], linewidths=1.1, zorder=5)
        core = select(mine, mine["kind"] == "vortex")
        for turns, fill in ((1, ZONE), (-1, "white")):
            of = core["flag"] == turns
            ax.plot(
                core["x_hat"][of],
                core["y_hat"][of],
                "o",
                color="black",
                markerfacecolor=fill,
                markersize=4.2,
                markeredgewidth=0.8,
                zorder=6,
            )
        ax.set_xlim(x0, x1)
        ax.set_ylim(y0, y1)
        ax.set_title(f"{letter}) {mine['label'][0]}", loc="left", fontsize=look.text_pt)
    for ax in axes[:, 0]:
        ax.set_ylabel(Y)
    for ax in axes[-1]:
        ax.set_xlabel(X)
    figure.colorbar(shade, ax=axes.ravel().tolist(), label="airspeed (m/s)", pad=0.01, aspect=30)
    return figure
