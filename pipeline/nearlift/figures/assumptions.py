"""What the ratio takes for granted: a row of panels per question, a column per boundary."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift import nomenclature
from nearlift.figures.style import BAND, FIT, REFERENCES, SERIES, Style

Rows = Mapping[str, Any]
COLOUR = SERIES[0][0]


def draw(table: Rows, look: Style) -> Figure:
    """The grid; with one boundary its questions stand side by side."""
    panels = list(dict.fromkeys(table["panel"].tolist()))
    parts = [p for p in DRAW if (table["part"] == p).any()]
    lone = len(panels) == 1
    rows, columns = (1, len(parts)) if lone else (len(parts), len(panels))
    width = look.single_in if lone and len(parts) == 1 else look.double_in
    height = 0.36 * look.double_in if rows == 1 else 0.27 * look.double_in * rows
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for i, part in enumerate(parts):
        for j, boundary in enumerate(panels):
            ax = axes[0, i] if lone else axes[i, j]
            mine = {
                name: column[(table["panel"] == boundary) & (table["part"] == part)]
                for name, column in table.items()
            }
            if not len(mine["kind"]):
                ax.set_axis_off()
                continue
            DRAW[part](ax, mine)
            ax.yaxis.set_major_locator(MaxNLocator(4))
            ax.set_ylabel(nomenclature.label(str(mine["label"][0])), labelpad=1)
            if i == 0 or lone:
                ax.set_title(boundary, loc="left", fontsize=look.text_pt)
    return figure


def _select(rows: Rows, kind: str) -> dict[str, Any]:
    return {name: column[rows["kind"] == kind] for name, column in rows.items()}


def _bars(ax: Axes, rows: Rows, low: str, high: str, linewidth: float) -> None:
    ax.vlines(rows["x"], rows[low], rows[high], color=COLOUR, linewidth=linewidth, zorder=3)


def _throttles(ax: Axes, rows: Rows) -> None:
    common, each = _select(rows, "common"), _select(rows, "throttle")
    ax.axhspan(common["lo90"][0], common["hi90"][0], color=BAND, linewidth=0, zorder=0)
    ax.axhline(common["value"][0], color=FIT, zorder=1)
    _bars(ax, each, "lo90", "hi90", 0.7)
    _bars(ax, each, "lo90_apart", "hi90_apart", 2.0)
    many = len(each["x"]) > 8
    ax.plot(
        each["x"],
        each["value"],
        "o",
        color=COLOUR,
        markerfacecolor="white",
        markeredgewidth=0.8,
        zorder=4,
    )
    if not many:
        ax.set_xticks(each["x"], [f"{x:.3g}" for x in each["x"]])
    ax.margins(x=0.12)
    ax.set_xlabel("throttle (%)", labelpad=1)


def _exponents(ax: Axes, rows: Rows) -> None:
    curve, marks, supported = (_select(rows, kind) for kind in ("curve", "plausible", "supported"))
    if len(supported["x"]) == 2:
        ax.axvspan(*supported["x"], color=SERIES[5][0], alpha=0.3, linewidth=0, zorder=0)
    ax.fill_between(curve["x"], curve["lo90"], curve["hi90"], color=BAND, linewidth=0, zorder=1)
    ax.plot(curve["x"], curve["value"], color=FIT, zorder=2)
    ax.plot(
        marks["x"],
        marks["value"],
        "o",
        color=COLOUR,
        markerfacecolor="white",
        markeredgewidth=0.8,
        zorder=4,
    )
    ax.set_xlim(float(np.min(curve["x"])), float(np.max(curve["x"])))
    ax.set_xlabel("exponent $n$ of the ratio", labelpad=1)


def _rotor(ax: Axes, rows: Rows) -> None:
    points, law, paper = (_select(rows, kind) for kind in ("C_L", "law", "paper"))
    ax.plot(law["x"], law["value"], color=FIT, zorder=2)
    ax.axhline(paper["value"][0], color=REFERENCES[0][0], linestyle=REFERENCES[0][1], zorder=1)
    _bars(ax, points, "lo90", "hi90", 1.2)
    ax.plot(
        points["x"],
        points["value"],
        "o",
        color=COLOUR,
        markerfacecolor="white",
        markeredgewidth=0.8,
        zorder=4,
    )
    ax.margins(x=0.12, y=0.12)
    ax.set_xlabel(f"rotor speed {nomenclature.label('speed_Hz')}", labelpad=1)


DRAW = {"throttle": _throttles, "exponent": _exponents, "rotor": _rotor}
