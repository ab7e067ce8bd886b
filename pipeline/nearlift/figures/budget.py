"""Budget bars: a panel per coefficient, a bar per source of error, how far the uncertainty would
fall without it.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from nearlift.figures.style import SERIES, Style, coefficient, plain_text

Rows = Mapping[str, Any]
LOOKS = {"A": (SERIES[0][0], ""), "B": (SERIES[1][0], "////")}
MEANINGS = {"A": "type A: from repeats", "B": "type B: declared"}


def draw(table: Rows, look: Style) -> Figure:
    """Panels side by side share the list of sources."""
    panels = list(
        dict.fromkeys(zip(table["panel"].tolist(), table["parameter"].tolist(), strict=True))
    )
    components = list(dict.fromkeys(table["component"].tolist()))
    height = min((0.19 * len(components) + 0.75) * look.text_pt / 8, look.height_in)
    figure = Figure(figsize=(look.double_in, height), layout="constrained")
    # names of sources reach to the figure's edge, and a printer's cut would take their first letter
    figure.set_layout_engine("constrained", rect=(0.012, 0.0, 0.976, 1.0))
    axes = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    for ax, (boundary, parameter) in zip(axes, panels, strict=True):
        mine = (table["panel"] == boundary) & (table["parameter"] == parameter)
        for y, fall, kind in zip(
            range(len(components)), table["fall_percent"][mine], table["type"][mine], strict=True
        ):
            if np.isnan(fall):
                # no source of this coefficient
                continue
            colour, hatch = LOOKS[kind]
            ax.barh(
                y, fall, height=0.7, facecolor=colour, hatch=hatch, edgecolor="white", linewidth=0.0
            )
            ax.annotate(
                _percent(fall),
                (fall, y),
                (3, 0),
                textcoords="offset points",
                va="center",
                fontsize=look.text_pt - 2,
            )
        ax.set_yticks(range(len(components)), [plain_text(c) for c in components])
        ax.set_ylim(len(components) - 0.4, -0.6)
        ax.set_xlim(0, 124)
        ax.set_xticks([0, 50, 100])
        ax.tick_params(axis="y", length=0)
        ax.set_title(f"{coefficient(parameter)}, {boundary}", fontsize=look.text_pt)
    figure.supxlabel(
        "fall of the standard uncertainty if the source were known exactly (%)",
        fontsize=look.text_pt,
    )
    used = [k for k in LOOKS if np.any(table["type"] == k)]
    handles = [
        Patch(
            facecolor=LOOKS[k][0],
            hatch=LOOKS[k][1],
            edgecolor="white",
            linewidth=0.0,
            label=MEANINGS[k],
        )
        for k in used
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(used))
    return figure


def _percent(fall: float) -> str:
    if fall < 0.1:
        return "< 0.1" if fall > 0 else "0"
    return f"{fall:.1f}" if fall < 9.95 else f"{fall:.0f}"
