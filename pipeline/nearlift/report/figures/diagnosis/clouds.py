"""The loop's upper panels: a residual against the covariate that betrays it."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from nearlift.report.evidence import Rows, distinct
from nearlift.report.figures.residuals import drawing as residuals
from nearlift.report.figures.style import FITTED, SERIES, Style, dots, plain_log, plain_text

CLOUD = SERIES[0][0]
#: Before and after, in colour and in symbol.
LOOKS = {"before": SERIES[1], "after": SERIES[2]}
FLOOR = "0.88"
DISCRETE = 6
LABELS = {
    "previous_throttle_percent": "previous throttle (%)",
    "order_in_visit": "order within a visit",
}


def residual(ax: Axes, rows: Rows, look: Style, first: bool) -> None:
    """Cloud, means over bins with their standard error, the noise floor as a shade; trials beyond
    the axis as ticks at its edge.
    """
    kind, reach = rows["kind"], float(rows["value"][rows["kind"] == "reach"][0])
    covariate, when = str(rows["covariate"][0]), str(rows["when"][0])
    floor = float(rows["value"][kind == "floor"][0])
    if np.isfinite(floor):
        ax.axhspan(-floor, floor, color=FLOOR, linewidth=0, zorder=0)
    cloud, far = (kind == "trial"), (kind == "beyond")
    names = distinct(rows["series"][kind == "bin"])
    colour = CLOUD if len(names) == 1 else "0.55"
    dots(ax, rows["x"][cloud], rows["value"][cloud], colour)
    ax.plot(
        rows["x"][far],
        0.965 * reach * np.sign(rows["value"][far]),
        "|",
        color=colour,
        markersize=3.5,
        markeredgewidth=0.5,
        zorder=1,
    )
    ax.axhline(0, color="0.3", linewidth=0.6, zorder=2)
    for x in rows["x"][kind == "session"]:
        ax.axvline(x, color="0.6", linewidth=0.5, linestyle=(0, (2, 2)), zorder=0.5)
    for i, name in enumerate(names):
        mine = (kind == "bin") & (rows["series"] == name)
        colour, marker = LOOKS[when] if len(names) == 1 else SERIES[i % len(SERIES)]
        ax.errorbar(
            rows["x"][mine],
            rows["value"][mine],
            rows["u"][mine],
            fmt=marker,
            color=colour,
            markersize=3.4 if len(names) == 1 else 2.8,
            elinewidth=0.8,
            markeredgecolor="white",
            markeredgewidth=0.3,
            linestyle="-" if len(names) > 1 else "none",
            linewidth=0.6,
            zorder=4,
            label=plain_text(name),
        )
    line = kind == "curve"
    ax.plot(rows["x"][line], rows["value"][line], color=FITTED, linewidth=1.0, zorder=3)
    ax.set_ylim(-reach, reach)
    _abscissa(ax, covariate, np.unique(rows["x"][kind == "bin"]), look)
    if len(names) > 1:
        _legend(ax, names, str(rows["note"][0]), look)
    if first:
        ax.set_ylabel("relative residual (%)")


def _legend(ax: Axes, names: list[str], levels_of: str, look: Style) -> None:
    """Series in one line, headed by what they are levels of."""
    handles = [
        Line2D([], [], color=c, marker=m, markersize=2.8)
        for (c, m), _ in zip(SERIES, names, strict=False)
    ]
    words = [plain_text(n) for n in names]
    if levels_of != "approach":
        handles, words = (
            [Line2D([], [], linestyle="none"), *handles],
            [residuals.label(levels_of, look).partition(" $")[0].partition(" (")[0] + ":", *words],
        )
    ax.legend(
        handles,
        words,
        ncols=len(words),
        columnspacing=0.7,
        handlelength=1.1,
        handletextpad=0.3,
        borderaxespad=0.2,
        loc="best",
    )


def _abscissa(ax: Axes, covariate: str, means: Any, look: Style) -> None:
    if covariate in residuals.DISTANCES:
        ax.set_xscale("log")
        plain_log(ax.xaxis)
    elif len(means) <= DISCRETE:
        ax.set_xticks(means, [f"{x:.3g}".replace("-", "−") for x in means])
        ax.margins(x=0.12)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(5))
        ax.margins(x=0.03)
    ax.set_xlabel(LABELS.get(covariate) or residuals.label(covariate, look), labelpad=1)
