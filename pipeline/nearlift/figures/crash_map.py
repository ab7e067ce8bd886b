"""Maps of crash rate over two dimensionless groups, with the contours of 1, 10 and 50 %."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from nearlift import nomenclature
from nearlift.figures.style import SEQUENTIAL, Style

Rows = Mapping[str, Any]
LEVELS = (1.0, 10.0, 50.0)


def draw(table: Rows, look: Style) -> Figure:
    """A panel for each boundary."""
    sides = list(dict.fromkeys(table["boundary"].tolist()))
    figure = Figure(figsize=(look.double_in if len(sides) > 1 else look.single_in * 1.25, 0.42 * look.double_in), layout="constrained")
    axes = figure.subplots(1, len(sides), squeeze=False)[0]
    for letter, side, ax in zip("ab", sides, axes, strict=False):
        mine = table["boundary"] == side
        x, y = np.unique(table["beta"][mine]), np.unique(table["noise"][mine])
        rate = np.full((len(y), len(x)), np.nan)
        rate[np.searchsorted(y, table["noise"][mine]), np.searchsorted(x, table["beta"][mine])] = 100 * table["rate"][mine]
        ax.set_xscale("log")
        ax.set_yscale("log")
        mesh = ax.pcolormesh(x, y, rate, cmap=SEQUENTIAL, vmin=0, vmax=100, shading="nearest", rasterized=True)
        lines = ax.contour(x, y, rate, levels=LEVELS, colors="white", linewidths=0.8)
        ax.clabel(lines, fmt=lambda v: f"{v:g} %", fontsize=look.text_pt - 1.5)
        ax.plot([np.sqrt(x[0] * x[-1])], [np.sqrt(y[0] * y[-1])], "o", color="white", markerfacecolor="none", markersize=6, markeredgewidth=1.0)
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(NullFormatter())
        ax.set_xlabel(f"derivative gain {nomenclature.label('beta_group')}")
        ax.set_ylabel(f"noise {nomenclature.label('noise_group')}")
        ax.set_title(f"{letter}) {side}", loc="left", fontsize=look.text_pt)
    figure.colorbar(mesh, ax=list(axes), label="crash rate (%)", pad=0.02, aspect=25)
    return figure
