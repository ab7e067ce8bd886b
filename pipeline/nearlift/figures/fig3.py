"""Figure 3: three columns, a field above and its cross-section beneath."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from nearlift.figures import flow_panel
from nearlift.figures.flow_panel import select
from nearlift.figures.style import SERIES, Style

Rows = Mapping[str, Any]
X, Y = r"$x / r$", r"$y / r$"


def draw(table: Rows, look: Style) -> Figure:
    """One colour scale for all fields, one velocity axis for all cross-sections."""
    names = flow_panel.panels(table)
    (x0, x1), (y0, y1) = flow_panel.limits(table)
    n = len(names)
    width = look.double_in if n > 1 else look.single_in
    tall = (width - 0.9) / n * (y1 - y0) / (x1 - x0)
    figure = Figure(figsize=(width, tall + 0.45 * tall + 0.9), layout="constrained")
    axes = figure.subplots(2, n, squeeze=False, sharex=True, sharey="row", height_ratios=(1.0, 0.5))
    norm = Normalize(0, flow_panel.highest(table))
    shade: Any = None
    for letter, name, upper, lower in zip("abcdef", names, axes[0], axes[1], strict=False):
        mine = select(table, table["panel"] == name)
        shade = flow_panel.field(upper, mine, flow_panel.speeds(), norm)
        for x, y in flow_panel.pairs(select(mine, mine["kind"] == "span")):
            upper.plot(x, y, color="black", linewidth=0.9, linestyle=(0, (3, 1.5)), zorder=5)
        upper.set_xlim(x0, x1)
        upper.set_ylim(y0, y1)
        upper.set_title(f"{letter}) {mine['label'][0]}", loc="left", fontsize=look.text_pt)
        _section(lower, mine)
        lower.set_xlabel(X)
    axes[0, 0].set_ylabel(Y)
    axes[1, 0].set_ylabel("downwash (m/s)")
    figure.colorbar(shade, ax=axes[0].tolist(), label="airspeed (m/s)", pad=0.01, aspect=18)
    return figure


def _section(ax: Axes, mine: Rows) -> None:
    for x, _ in flow_panel.pairs(select(mine, mine["kind"] == "span")):
        ax.axvspan(x[0], x[1], color="0.92", linewidth=0, zorder=0)
    ax.axhline(0, color="0.6", linewidth=0.5, zorder=1)
    control = select(mine, mine["kind"] == "control")
    ax.plot(
        control["x_hat"],
        control["value_m_s"],
        color="0.35",
        linestyle=(0, (1, 1.2)),
        linewidth=0.9,
        zorder=2,
    )
    own = select(mine, mine["kind"] == "profile")
    colour = SERIES[0][0]
    reach = 1.645 * own["u_value_m_s"]
    ax.fill_between(
        own["x_hat"],
        own["value_m_s"] - reach,
        own["value_m_s"] + reach,
        color=colour,
        alpha=0.3,
        linewidth=0,
    )
    measured = np.where(own["flag"] > 0, np.nan, own["value_m_s"])
    ax.plot(own["x_hat"], own["value_m_s"], color=colour, linewidth=0.6, zorder=3)
    ax.plot(own["x_hat"], measured, color=colour, linewidth=1.3, zorder=3)
    ax.xaxis.set_major_locator(MultipleLocator(2))
