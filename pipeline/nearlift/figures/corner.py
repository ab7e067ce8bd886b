"""Corner plots, one for each boundary side by side: histograms on the diagonal, regions of highest
density beneath it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, ScalarFormatter

from nearlift import nomenclature
from nearlift.errors import UsageError
from nearlift.figures.style import FIT, Style, plain_text

Rows = Mapping[str, Any]
#: Share of the posterior within a region, and its grey.
REGIONS = ((0.5, "#555555"), (0.9, "#9A9A9A"), (1.0, "#DADADA"))


def draw(table: Rows, look: Style) -> Figure:
    """A triangle of panels for each boundary."""
    boundaries = list(dict.fromkeys(table["panel"].tolist()))
    names = {
        b: list(dict.fromkeys(table["x_name"][table["panel"] == b].tolist())) for b in boundaries
    }
    sizes = [max(len(names[b]), 1) for b in boundaries]
    side = min(look.double_in / sum(sizes), 1.7 * look.double_in / 6.75)
    figure = Figure(figsize=(look.double_in, side * max(sizes) + 0.35), layout="constrained")
    blocks = figure.subfigures(1, len(boundaries), squeeze=False, width_ratios=sizes)[0]
    for letter, boundary, block in zip("abc", boundaries, blocks, strict=False):
        chosen = _select(table, table["panel"] == boundary)
        block.suptitle(
            f"{letter}) {boundary}" if len(boundaries) > 1 else boundary,
            fontsize=look.text_pt,
            x=0.02,
            ha="left",
        )
        _triangle(block, chosen, names[boundary], max(sizes))
    return figure


def _triangle(block: Any, rows: Rows, names: list[str], height: int) -> None:
    axes = block.subplots(height, len(names), squeeze=False)
    for i in range(height):
        for j, x_name in enumerate(names):
            ax = axes[i][j]
            if i >= len(names) or j > i:
                ax.set_axis_off()
                continue
            mine = _select(rows, rows["x_name"] == x_name)
            if i == j:
                _histogram(ax, _select(mine, mine["kind"] == "histogram"))
            else:
                _region(ax, _select(mine, mine["y_name"] == names[i]))
                if j == 0:
                    ax.set_ylabel(_label(names[i]))
                else:
                    ax.tick_params(labelleft=False)
            ax.xaxis.set_major_locator(MaxNLocator(3, prune="both"))
            whole = _select(mine, mine["kind"] == "histogram")
            ax.set_xlim(whole["x_low"].min(), whole["x_high"].max())
            if i == len(names) - 1:
                ax.set_xlabel(_label(x_name))
                ax.xaxis.set_major_formatter(_numbers())
            else:
                ax.tick_params(labelbottom=False)


def _numbers() -> ScalarFormatter:
    shown = ScalarFormatter(useOffset=False)
    shown.set_powerlimits((-4, 5))
    return shown


def _histogram(ax: Axes, rows: Rows) -> None:
    ax.stairs(rows["value"], [*rows["x_low"], rows["x_high"][-1]], color=FIT, linewidth=0.8)
    ax.set_ylim(0, 1.12)
    ax.set_yticks([])


def _region(ax: Axes, rows: Rows) -> None:
    below = 0.0
    for share, colour in REGIONS:
        mine = _select(rows, (rows["value"] > below) & (rows["value"] <= share))
        below = share
        corners = [
            (mine[x], mine[y])
            for x, y in (
                ("x_low", "y_low"),
                ("x_high", "y_low"),
                ("x_high", "y_high"),
                ("x_low", "y_high"),
            )
        ]
        cells = np.moveaxis(np.array(corners), (0, 1, 2), (1, 2, 0))
        ax.add_collection(
            PolyCollection(list(cells), facecolor=colour, edgecolor=colour, linewidth=0.2)
        )
    ax.yaxis.set_major_locator(MaxNLocator(3, prune="both"))
    ax.yaxis.set_major_formatter(_numbers())
    ax.set_ylim(rows["y_low"].min(), rows["y_high"].max())


def _label(name: str) -> str:
    if name.startswith("L_inf_mN["):
        return rf"$L_\infty$ at {100 * float(name[9:-1]):.3g} % (mN)"
    try:
        return nomenclature.label(name)
    except UsageError:
        return plain_text(name)


def _select(table: Rows, rows: Any) -> dict[str, Any]:
    return {name: column[rows] for name, column in table.items()}
