"""One effect: its signature before and after the model has absorbed what it can, its power, and
what it is taken for.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from nearlift.figures.style import BAND, FIT, SERIES, Style, log_distance, quantity

Rows = Mapping[str, Any]
LOOKS = {
    "seen": (FIT, "-", "structure seen"),
    "within": (SERIES[0][0], "--", "named or a rival"),
    "alone": (SERIES[1][0], ":", "named alone"),
}
#: A covariate with more distinct values than this is drawn as a cloud, with fewer as points of
#: their mean and range.
MANY = 40


def draw(rows: Rows, look: Style) -> Figure:
    """A line of three panels for each boundary and each of the effect's sizes."""
    keys = list(
        dict.fromkeys(zip(rows["boundary"].tolist(), rows["parameter"].tolist(), strict=True))
    )
    figure = Figure(figsize=(look.double_in, 0.35 + 2.15 * len(keys)), layout="constrained")
    grid = figure.subplots(len(keys), 3, squeeze=False, width_ratios=(1.25, 1.1, 1))
    for line, (boundary, parameter) in zip(grid, keys, strict=True):
        mine = (rows["boundary"] == boundary) & (rows["parameter"] == parameter)
        part = {k: v[mine] for k, v in rows.items()}
        unit = str(part["unit"][0])
        size = f"{float(part['size'][0]):.3g}" + ("" if unit == "1" else f" {unit}")
        word = parameter.removesuffix("_m").removesuffix("_N").replace("_", " ")
        _signature(line[0], part, f"{boundary}: {word} of {size}")
        _power(line[1], part, word + ("" if unit == "1" else f" ({unit})"))
        _confused(line[2], part)
    return figure


def _signature(ax: Axes, rows: Rows, title: str) -> None:
    mine = rows["panel"] == "signature"
    noise = float(rows["y"][mine & (rows["series"] == "noise")][0])
    ax.axhspan(-noise, noise, color=BAND, alpha=0.5, linewidth=0, zorder=0)
    ax.axhline(0, color="0.3", linewidth=0.6, zorder=1)
    looks = {
        "raw": ("0.35", "o", "none", "as it acts"),
        "left": (SERIES[1][0], "s", SERIES[1][0], "what the model leaves"),
    }
    for name, (edge, marker, face, _) in looks.items():
        here = mine & (rows["series"] == name)
        size = 4.0 if name == "raw" else 1.8
        ax.plot(
            rows["x"][here],
            rows["y"][here],
            marker=marker,
            linestyle="none",
            markersize=size,
            markerfacecolor=face,
            markeredgecolor=edge,
            markeredgewidth=0.5,
            zorder=3,
            rasterized=True,
        )
    covariate = str(rows["covariate"][0])
    if covariate == "z_hat":
        ax.set_xscale("log")
        log_distance(ax)
    else:
        ax.xaxis.set_major_locator(MaxNLocator(5, integer=covariate == "session"))
    ax.margins(x=0.05)
    ax.set_xlabel(r"throttle (%)" if covariate == "throttle" else quantity(covariate), labelpad=1)
    ax.set_ylabel("change of lift (%)")
    ax.set_title(title, loc="left")
    handles = [
        Line2D(
            [], [], linestyle="none", marker=m, markersize=3, markerfacecolor=f, markeredgecolor=e
        )
        for e, m, f, _ in looks.values()
    ]
    handles.append(Line2D([], [], color=BAND, linewidth=5, alpha=0.6))
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.42 * (high - low))
    ax.legend(
        handles,
        [*(t for *_, t in looks.values()), "noise of one trial"],
        loc="upper left",
        handlelength=1.2,
    )


def _power(ax: Axes, rows: Rows, label: str) -> None:
    mine = rows["panel"] == "power"
    if not mine.any():
        ax.set_axis_off()
        ax.text(
            0.5,
            0.5,
            "silent: the model absorbs it\nat any size",
            ha="center",
            va="center",
            transform=ax.transAxes,
        )
        return
    false_alarm = float(rows["y"][mine & (rows["series"] == "false alarm")][0])
    ax.axhline(100 * false_alarm, color="0.6", linewidth=0.6, linestyle=(0, (2, 2)))
    for name, (colour, dash, text) in LOOKS.items():
        here = mine & (rows["series"] == name)
        ax.plot(rows["x"][here], 100 * rows["y"][here], color=colour, linestyle=dash, label=text)
    limit = mine & (rows["series"] == "limit")
    for x, y in zip(rows["x"][limit], rows["y"][limit], strict=True):
        ax.plot([x, x, 0], [0, 100 * y, 100 * y], color="0.6", linewidth=0.6)
        ax.plot([x], [100 * y], "o", color=FIT, markersize=3)
    ax.set_ylim(0, 104)
    ax.set_xlim(left=0)
    ax.xaxis.set_major_locator(MaxNLocator(5))
    ax.set_xlabel(label, labelpad=1)
    ax.set_ylabel("chance (%)")
    ax.legend(loc="best")


def _confused(ax: Axes, rows: Rows) -> None:
    if not np.any(rows["panel"] == "power"):
        ax.set_axis_off()
        return
    mine = np.flatnonzero(
        (rows["panel"] == "confused") & ((rows["x"] >= 0.02) | (rows["y"] >= 0.1))
    )
    if not len(mine):
        ax.set_axis_off()
        ax.text(
            0.5,
            0.5,
            "confused with nothing\nin the library",
            ha="center",
            va="center",
            transform=ax.transAxes,
        )
        return
    place = np.arange(len(mine))[::-1]
    ax.barh(
        place + 0.2, 100 * rows["y"][mine], height=0.36, color="0.75", label="energy it takes over"
    )
    ax.barh(
        place - 0.2,
        100 * rows["x"][mine],
        height=0.36,
        color=SERIES[0][0],
        label="chance to be a rival",
    )
    ax.set_yticks(place, [str(n).replace("_", " ") for n in rows["series"][mine]])
    ax.tick_params(axis="y", length=0)
    ax.set_xlim(0, 100)
    ax.set_ylim(-0.6, len(mine) - 0.4 + 0.28 * len(mine))
    ax.set_xlabel("%", labelpad=1)
    ax.legend(loc="upper right")
