"""Detection range against averaging time above, located against true distance below; a column for
each boundary.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from nearlift import nomenclature
from nearlift.figures.style import BAND, FIT, SERIES, Style

Rows = Mapping[str, Any]


def draw(table: Rows, look: Style) -> Figure:
    """Two panels for each boundary."""
    sides = list(dict.fromkeys(table["panel"].tolist()))
    figure = Figure(
        figsize=(look.double_in if len(sides) > 1 else 1.2 * look.single_in, 0.68 * look.double_in),
        layout="constrained",
    )
    axes = figure.subplots(2, len(sides), squeeze=False)
    letters = iter("abcdef")
    for i, row in enumerate(("range", "located")):
        for j, side in enumerate(sides):
            ax = axes[i, j]
            own, read = (
                {
                    k: column[(table["row"] == r) & (table["panel"] == side)]
                    for k, column in table.items()
                }
                for r in (row, "reading")
            )
            ax.set_title(f"{next(letters)}) {side}", loc="left", fontsize=look.text_pt)
            if row == "range":
                _range(ax, own)
            else:
                _located(ax, own, read)
    axes[0, 0].set_ylabel("detection range " + nomenclature.label("z_hat"))
    axes[1, 0].set_ylabel("located " + nomenclature.label("z_hat"))
    handles, names = axes[0, 0].get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="outside upper center",
        ncols=min(len(names), 4 if len(sides) > 1 else 2),
    )
    return figure


def _range(ax: Any, own: Rows) -> None:
    ax.set_xscale("log")
    for (shade, marker), case in zip(SERIES, dict.fromkeys(own["case"].tolist()), strict=False):
        mine = own["case"] == case
        x, y = own["x"][mine], own["y"][mine]
        dashes = (
            (0, (4, 1.5)) if own["voltage_percent"][mine][0] > own["voltage_percent"].min() else "-"
        )
        ax.plot(
            x,
            y,
            color=shade,
            marker=marker,
            markerfacecolor="white",
            linestyle=dashes,
            label=case,
            zorder=3,
        )
        known = np.isfinite(y)
        ax.fill_between(
            x[known],
            own["lo90"][mine][known],
            own["hi90"][mine][known],
            color=shade,
            alpha=0.2,
            linewidth=0,
        )
    ax.set_ylim(bottom=0)
    nowhere = [
        c
        for c in dict.fromkeys(own["case"].tolist())
        if not np.isfinite(own["y"][own["case"] == c]).any()
    ]
    if not np.isfinite(own["y"]).any():
        ax.set_ylim(0, 1)
        ax.text(0.5, 0.5, "nowhere", transform=ax.transAxes, ha="center", va="center")
    elif nowhere:
        ax.text(
            0.96,
            0.04,
            "\n".join([*nowhere, "nowhere"]),
            transform=ax.transAxes,
            ha="right",
            va="bottom",
            fontsize="small",
            color="0.35",
        )
    ax.set_xlim(own["x"].min() / 1.5, own["x"].max() * 1.5)
    ax.set_xlabel("averaging time (s)")
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def _located(ax: Any, own: Rows, read: Rows) -> None:
    ax.set_xlabel("true " + nomenclature.label("z_hat"))
    if not len(own["x"]):
        ax.text(
            0.5,
            0.5,
            "not inverted: the model folds",
            transform=ax.transAxes,
            ha="center",
            va="center",
        )
        return
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.fill_between(own["x"], own["lo90"], own["hi90"], color=BAND, linewidth=0)
    ax.plot(own["x"], own["y"], color=FIT)
    ax.plot(own["x"], own["x"], color="0.45", linestyle=(0, (1, 1.2)))
    for (shade, _), y, low, high in zip(
        SERIES, read["y"], read["lo90"], read["hi90"], strict=False
    ):
        ax.axhspan(low, high, color=shade, alpha=0.25, linewidth=0)
        ax.axhline(y, color=shade, linewidth=0.8)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
