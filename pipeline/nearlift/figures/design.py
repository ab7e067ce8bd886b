"""A design's outlook: what it could see of each effect, and what it would take each one for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from nearlift.figures.style import SERIES, Style

Rows = Mapping[str, Any]
LOOKS = {
    "named": (SERIES[2][0], SERIES[2][1]),
    "seen, seldom named": (SERIES[4][0], SERIES[4][1]),
    "seen, not told apart": (SERIES[0][0], SERIES[0][1]),
    "too small to see": (SERIES[1][0], SERIES[1][1]),
    "silent": ("0.5", "x"),
}
#: Chances below this are left blank.
LEAST = 0.05


def draw(rows: Rows, look: Style) -> Figure:
    """A line of two panels for each boundary."""
    sides = list(dict.fromkeys(rows["boundary"].tolist()))
    count = [
        len(set(rows["effect"][(rows["boundary"] == s) & (rows["panel"] == "limits")].tolist()))
        for s in sides
    ]
    figure = Figure(
        figsize=(look.double_in, sum(1.55 + 0.155 * c for c in count)), layout="constrained"
    )
    grid = figure.subplots(
        len(sides),
        2,
        squeeze=False,
        width_ratios=(1, 1.25),
        height_ratios=[1.55 + 0.155 * c for c in count],
    )
    for line, side in zip(grid, sides, strict=True):
        mine = rows["boundary"] == side
        part = {k: v[mine] for k, v in rows.items()}
        _limits(line[0], part, side)
        _confused(line[1], part)
    return figure


def _limits(ax: Axes, rows: Rows, side: str) -> None:
    mine = rows["panel"] == "limits"
    names, verdict, x, note = (rows[k][mine] for k in ("effect", "series", "x", "note"))
    place = np.arange(len(names))[::-1]
    finite = x[np.isfinite(x)]
    low, high = (finite.min(), finite.max()) if len(finite) else (0.1, 10.0)
    edge = 3.0 * max(high, 1.0)
    ax.axvspan(1.0, 30 * edge, color="0.93", linewidth=0, zorder=0)
    for y, kind, at, text in zip(place, verdict, x, note, strict=True):
        colour, marker = LOOKS[kind]
        if np.isfinite(at):
            ax.plot([at], [y], marker=marker, color=colour, markersize=4, zorder=3)
            ax.annotate(
                text,
                (at, y),
                xytext=(5, -2.4),
                textcoords="offset points",
                fontsize="x-small",
                color="0.25",
            )
        else:
            ax.plot([edge], [y], marker="x", color=colour, markersize=4, zorder=3)
            ax.annotate(
                "never",
                (edge, y),
                xytext=(5, -2.4),
                textcoords="offset points",
                fontsize="x-small",
                color="0.25",
            )
    ax.set_xscale("log")
    ax.set_xlim(0.5 * min(low, 0.5), 12 * edge)
    ax.xaxis.set_major_locator(LogLocator())
    ax.xaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    ax.xaxis.set_minor_formatter(NullFormatter())
    ax.set_yticks(place, [str(n).replace("_", " ") for n in names])
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(-0.8, len(names) - 0.2)
    ax.set_xlabel("detection limit over plausible size", labelpad=1)
    ax.set_title(f"{side}: what could be seen", loc="left")
    handles = [
        Line2D([], [], linestyle="none", marker=m, color=c, markersize=4)
        for k, (c, m) in LOOKS.items()
        if k in verdict
    ]
    words = [k for k in LOOKS if k in verdict]
    ax.legend(
        handles,
        words,
        loc="upper center",
        bbox_to_anchor=(0.4, -0.1 - 1.6 / (6 + len(names))),
        ncols=2,
        columnspacing=0.8,
        handlelength=1.0,
    )


def _confused(ax: Axes, rows: Rows) -> None:
    mine = rows["panel"] == "confused"
    if not mine.any():
        ax.set_axis_off()
        return
    truth = list(dict.fromkeys(rows["effect"][mine].tolist()))
    taken = list(dict.fromkeys([*truth, *rows["series"][mine].tolist()]))
    taken = [t for t in taken if np.any((rows["series"] == t) & mine)]
    table = np.full((len(truth), len(taken)), np.nan)
    for a, b, chance in zip(
        rows["effect"][mine], rows["series"][mine], rows["x"][mine], strict=True
    ):
        if chance >= LEAST:
            table[truth.index(a), taken.index(b)] = 100 * chance
    ax.imshow(table, cmap="Blues", vmin=0, vmax=130, aspect="auto")
    for i, j in zip(*np.nonzero(np.isfinite(table)), strict=True):
        own = truth[i] == taken[j]
        ax.text(
            j, i, f"{table[i, j]:.0f}", ha="center", va="center", fontsize="x-small",
            color="white" if table[i, j] > 70 else "black", fontweight="bold" if own else "normal",
        )  # fmt: skip
    ax.set_xticks(np.arange(len(taken)), [str(t).replace("_", " ") for t in taken], rotation=90)
    ax.set_yticks(np.arange(len(truth)), [str(t).replace("_", " ") for t in truth])
    ax.tick_params(length=0)
    ax.set_xticks(np.arange(len(taken)) - 0.5, minor=True)
    ax.set_yticks(np.arange(len(truth)) - 0.5, minor=True)
    ax.grid(which="minor", color="0.9", linewidth=0.4)
    ax.tick_params(which="minor", length=0)
    ax.set_title("if this acts, this is named or a rival (%)", loc="left")
