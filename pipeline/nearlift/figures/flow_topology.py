"""The wake's topology against tilt: small multiples on one tilt axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift.figures.flow_panel import panels, select
from nearlift.figures.style import SERIES, Style

Rows = Mapping[str, Any]
ACROSS = 3


def draw(table: Rows, look: Style) -> Figure:
    """A panel for each number."""
    names = panels(table)
    down = -(-len(names) // ACROSS)
    figure = Figure(figsize=(look.double_in, 1.55 * down + 0.2), layout="constrained")
    axes = figure.subplots(down, ACROSS, squeeze=False, sharex=True)
    for ax in axes.ravel()[len(names) :]:
        ax.set_axis_off()
    for i, (name, ax) in enumerate(zip(names, axes.ravel(), strict=False)):
        mine = select(table, table["panel"] == name)
        labels = list(dict.fromkeys(mine["label"].tolist()))
        for shift, (colour, marker), label in zip((-0.12, 0.12), SERIES, labels, strict=False):
            own = select(mine, mine["label"] == label)
            bars = np.abs(np.stack([own["value"] - own["lo90"], own["hi90"] - own["value"]]))
            x = own["tilt_deg"] + (shift if len(labels) > 1 else 0.0)
            ax.errorbar(
                x,
                own["value"],
                bars,
                fmt=marker,
                color=colour,
                markerfacecolor="white",
                elinewidth=0.8,
                label=label or None,
            )
        if len(labels) > 1:
            ax.legend(loc="best")
            ax.margins(y=0.3)
            ax.yaxis.set_major_locator(MaxNLocator(integer=True))
        ax.axvline(0, color="0.8", linewidth=0.5, zorder=0)
        ax.set_ylabel(mine["axis"][0])
        if i + ACROSS >= len(names):
            ax.set_xlabel(r"tilt $\theta$ (deg)")
            ax.tick_params(labelbottom=True)
    return figure
