"""The corridor from the side with some ways through it, and energy against risk beside it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from nearlift.figures.style import FIT, SEQUENTIAL, SERIES, Style

Rows = Mapping[str, Any]


def draw(table: Rows, look: Style) -> Figure:
    """Corridor on the left, front on the right."""
    figure = Figure(figsize=(look.double_in, 0.36 * look.double_in), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2.1, 1.0))
    front = {name: column[table["kind"] == "front"] for name, column in table.items()}
    risk = {int(w): float(y) for w, y in zip(front["way"], front["y"], strict=True)}
    least = max(min(risk.values()), 1e-12)
    # at least a decade of colours, so that small differences look small
    middle = np.sqrt(least * max(max(risk.values()), least))
    norm = LogNorm(min(least, middle / np.sqrt(10)), max(*risk.values(), middle * np.sqrt(10)))
    colours = matplotlib.colormaps[SEQUENTIAL]
    for i in np.flatnonzero(table["kind"] == "box"):
        x, y, x2, y2 = (float(table[k][i]) for k in ("x", "y", "x2", "y2"))
        left.add_patch(
            Rectangle((x, y), x2 - x, y2 - y, facecolor="0.8", edgecolor="0.4", linewidth=0.6)
        )
    room = int(np.flatnonzero(table["kind"] == "room")[0])
    for height in (0.0, float(table["y2"][room])):
        left.axhline(height, color="0.35", linewidth=2.0)
    for way in dict.fromkeys(table["way"][table["kind"] == "way"].tolist()):
        mine = (table["kind"] == "way") & (table["way"] == way)
        bold = bool(table["chosen"][mine][0])
        if bold:
            left.plot(table["x"][mine], table["y"][mine], color="0.85", linewidth=3.4, zorder=3)
        x, y, seen = (table[k][mine] for k in ("x", "y", "seen"))
        # stretches of one kind, each with the first point of the next
        turns = [0, *(np.flatnonzero(np.diff(seen)) + 1).tolist(), len(x)]
        for a, b in itertools.pairwise(turns):
            style = "-" if seen[a] else (0, (3, 1.5))
            left.plot(
                x[a : b + 1],
                y[a : b + 1],
                color=colours(norm(max(risk[way], least))),
                linewidth=1.3,
                linestyle=style,
                zorder=4 if bold else 2,
            )
    ends = table["kind"] == "end"
    left.plot(table["x"][ends], table["y"][ends], "o", color=FIT, markerfacecolor="white", zorder=5)
    left.set_xlim(0, float(table["x2"][room]))
    left.set_xlabel("along the corridor (m)")
    left.set_ylabel("height of rotor plane (m)")
    left.set_title("a) ways", loc="left", fontsize=look.text_pt)
    figure.colorbar(
        ScalarMappable(norm, colours), ax=left, label="risk of a crash", pad=0.02, aspect=20
    )
    right.set_yscale("log")
    y, low, high = (np.maximum(front[k], 1e-12) for k in ("y", "x2", "y2"))
    right.errorbar(
        front["x"],
        y,
        yerr=(y - low, high - y),
        color=FIT,
        marker=".",
        markersize=3,
        elinewidth=0.6,
        capsize=1.2,
    )
    best = front["chosen"] == 1
    right.plot(
        front["x"][best],
        front["y"][best],
        SERIES[1][1],
        color=SERIES[1][0],
        markerfacecolor="white",
        markersize=5,
        zorder=4,
    )
    right.axhline(
        float(table["y"][table["kind"] == "bound"][0]),
        color="0.45",
        linestyle=(0, (4, 2)),
        linewidth=0.8,
    )
    # an interval that reaches far below all risks leaves the frame
    right.set_ylim(bottom=0.3 * least)
    right.set_xlabel("relative energy")
    right.set_ylabel("risk of a crash")
    right.set_title("b) energy against risk", loc="left", fontsize=look.text_pt)
    return figure
