"""Profiles: chi2 against one coefficient, a panel each, the parabola dashed, the
intervals marked.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift.figures.style import REFERENCES, SERIES, Style, coefficient

Rows = Mapping[str, Any]
COLUMNS = 4
TOP = 6.5


def draw(table: Rows, look: Style) -> Figure:
    """Panels in rows of four, one axis of chi2."""
    panels = list(
        dict.fromkeys(zip(table["panel"].tolist(), table["parameter"].tolist(), strict=True))
    )
    columns = min(len(panels), COLUMNS)
    rows = -(-len(panels) // columns)
    width = look.single_in if columns == 1 else look.double_in
    figure = Figure(
        figsize=(
            width,
            min(
                1.9 * look.double_in / 6.75 * rows + (0.25 if columns > 1 else 0.4), look.height_in
            ),
        ),
        layout="constrained",
    )
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True)
    for i, ax in enumerate(axes.flat):
        if i >= len(panels):
            ax.set_axis_off()
            continue
        boundary, parameter = panels[i]
        mine = (table["panel"] == boundary) & (table["parameter"] == parameter)
        _panel(ax, {k: v[mine] for k, v in table.items()}, look)
        unit = str(table["unit"][mine][0])
        ax.set_xlabel(coefficient(parameter) + (f" ({unit})" if unit != "1" else ""), labelpad=1)
        ax.set_title(boundary, fontsize=look.text_pt)
    for line in axes:
        line[0].set_ylabel(r"rise of $\chi^2$")
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside upper center", ncols=len(labels) if columns > 1 else 3
    )
    return figure


def _panel(ax: Axes, rows: Rows, look: Style) -> None:
    curve = rows["kind"] == "profile"
    ax.plot(
        rows["x"][curve],
        rows["quadratic"][curve],
        color=REFERENCES[0][0],
        linestyle=REFERENCES[0][1],
        label="parabola",
        zorder=1,
    )
    ax.plot(rows["x"][curve], rows["rise"][curve], color=SERIES[0][0], label="profile", zorder=2)
    for level, (colour, marker) in zip(
        ("68", "90", "95"), (SERIES[2], SERIES[4], SERIES[1]), strict=True
    ):
        mine = rows["kind"] == level
        ax.plot(
            rows["x"][mine],
            rows["rise"][mine],
            marker,
            color=colour,
            markersize=look.marker_pt + 0.6,
            markeredgecolor="white",
            markeredgewidth=0.4,
            label=f"{level} %",
            zorder=3,
        )
        ax.vlines(rows["x"][mine], 0, rows["rise"][mine], color=colour, linewidth=0.6, zorder=1)
    ax.set_ylim(0, TOP)
    shown = curve & (rows["rise"] < TOP)
    low, high = rows["x"][shown].min(), rows["x"][shown].max()
    margin = 0.06 * (high - low)
    ax.set_xlim(low - margin, high + margin)
    ax.xaxis.set_major_locator(MaxNLocator(4))
