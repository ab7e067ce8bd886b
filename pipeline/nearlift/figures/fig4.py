"""Figure 4: a row for each boundary, nearer and nearer; one diverging colour scale for each row."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from nearlift.figures import flow_panel
from nearlift.figures.fig3 import X, Y
from nearlift.figures.flow_panel import select
from nearlift.figures.style import Style

Rows = Mapping[str, Any]


def draw(table: Rows, look: Style) -> Figure:
    """Panels in the order of the table, broken into rows where the boundary changes."""
    names = flow_panel.panels(table)
    labels = {n: table["label"][table["panel"] == n][0] for n in names}
    lines = [
        [n for n in names if labels[n].startswith(b)]
        for b in dict.fromkeys(label.split(",")[0] for label in labels.values())
    ]
    across = max(len(line) for line in lines)
    (x0, x1), (y0, y1) = flow_panel.limits(table)
    tall = (look.double_in - 0.95) / across * (y1 - y0) / (x1 - x0)
    figure = Figure(
        figsize=(look.double_in, min(len(lines) * (tall + 0.25) + 0.35, look.height_in)),
        layout="constrained",
    )
    letters = iter("abcdefghijklmnopqrstuvwxyz")
    axes = figure.subplots(len(lines), across, squeeze=False, sharex=True, sharey=True)
    for line, places in zip(lines, axes, strict=True):
        shade: Any = None
        top = float(
            np.nanquantile(
                np.abs(
                    table["value_m_s"][(table["kind"] == "node") & np.isin(table["panel"], line)]
                ),
                0.995,
            )
        )
        norm = Normalize(-top, top)
        for ax in places[len(line) :]:
            ax.set_axis_off()
        for name, ax in zip(line, places, strict=False):
            mine = select(table, table["panel"] == name)
            shade = flow_panel.field(
                ax, mine, matplotlib.colormaps["RdBu_r"], norm, line_pt=0.35, density=0.5
            )
            ax.set_xlim(x0, x1)
            ax.set_ylim(y0, y1)
            ax.set_title(
                f"{next(letters)}) {labels[name]}", loc="left", fontsize=look.text_pt - 0.5
            )
        places[0].set_ylabel(Y)
        figure.colorbar(
            shade,
            ax=places.tolist(),
            label="airspeed less\nthe control's (m/s)",
            pad=0.01,
            aspect=14,
            extend="both",
        )
    for ax in axes[-1]:
        ax.set_xlabel(X)
    return figure
