"""The fitted models in flight: crash rate and power against set-point above, power against risk
below.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from nearlift import nomenclature
from nearlift.figures.style import BAND, FIT, REFERENCES, SERIES, Style, plain_text

Rows = Mapping[str, Any]
COST = SERIES[1][0]
PAPER = (0, (4, 1.5))
PAPER_COLOUR = "#5C2400"


def draw(table: Rows, look: Style) -> Figure:
    """Two panels for each boundary."""
    sides = list(dict.fromkeys(table["panel"].tolist()))
    width = look.double_in if len(sides) > 1 else look.single_in * 1.3
    figure = Figure(figsize=(width, 0.72 * look.double_in), layout="constrained")
    axes = figure.subplots(2, len(sides), squeeze=False)
    letters = iter("abcd")
    for i, row in enumerate(("crash", "front")):
        for j, side in enumerate(sides):
            ax = axes[i, j]
            own = {
                name: column[(table["row"] == row) & (table["panel"] == side)]
                for name, column in table.items()
            }
            (_crash if row == "crash" else _front)(ax, own)
            label = plain_text(str(own["label"][own["kind"] == "model"][0]))
            ax.set_title(f"{next(letters)}) {side}, {label}", loc="left", fontsize=look.text_pt)
    legend: Any = [
        Line2D([], [], color=REFERENCES[0][0], linestyle=REFERENCES[0][1]),
        (Patch(color=BAND), Line2D([], [], color=FIT)),
    ]
    legend += [
        (Patch(color=COST, alpha=0.2, linewidth=0), Line2D([], [], color=COST)),
        Line2D([], [], color=PAPER_COLOUR, linestyle=PAPER),
    ]
    held = plain_text(str(table["label"][table["kind"] == "cost"][0]))
    names = [
        "no boundary effect",
        "fitted model",
        f"power, {held} held",
        "power, $(L/L_\\infty)^{-3/2}$",
    ]
    figure.legend(legend, names, loc="outside lower center", ncols=4 if len(sides) > 1 else 2)
    return figure


def _crash(ax: Axes, own: Rows) -> None:
    grey, dashes = REFERENCES[0]
    for kind, shade, style in (("none", grey, dashes), ("model", FIT, "-")):
        mine = own["kind"] == kind
        ax.fill_between(
            own["x"][mine],
            100 * own["lo90"][mine],
            100 * own["hi90"][mine],
            color=BAND,
            linewidth=0,
            zorder=1,
        )
        ax.plot(own["x"][mine], 100 * own["y"][mine], color=shade, linestyle=style, zorder=3)
    ax.set_ylim(-2, 102)
    ax.set_xlabel(nomenclature.label("target_z_hat"))
    ax.set_ylabel("crash rate (%)")
    right: Any = ax.twinx()
    cost, paper = own["kind"] == "cost", own["kind"] == "cost_paper"
    right.fill_between(
        own["x"][cost], own["lo90"][cost], own["hi90"][cost], color=COST, alpha=0.2, linewidth=0
    )
    right.plot(own["x"][cost], own["y"][cost], color=COST)
    right.plot(own["x"][paper], own["y"][paper], color=PAPER_COLOUR, linestyle=PAPER)
    right.set_ylim(right.get_ylim()[0], 1.02)
    right.tick_params(axis="y", colors=COST)
    ax.tick_params(axis="y", right=False)
    right.set_ylabel("relative power", color=COST)


def _front(ax: Axes, own: Rows) -> None:
    mine = own["kind"] == "model"
    ax.set_yscale("log")
    ax.fill_between(
        own["x"][mine],
        100 * own["lo90"][mine],
        100 * own["hi90"][mine],
        color=BAND,
        linewidth=0,
        zorder=1,
    )
    ax.plot(own["x"][mine], 100 * own["y"][mine], color=FIT, zorder=2, marker=".", markersize=2.5)
    best = own["kind"] == "best"
    for (shade, marker), x, y, label in zip(
        SERIES, own["x"][best], own["y"][best], own["label"][best].tolist(), strict=False
    ):
        price, _, where = label.partition(": z_hat ")
        name = f"crash costs {price}: $\\hat{{z}}_0$ = {where}"
        ax.plot(
            [x],
            [100 * y],
            color=shade,
            marker=marker,
            markersize=5,
            markerfacecolor="white",
            linestyle="none",
            zorder=4,
            label=name,
        )
    ax.set_xlabel("relative power to hover")
    ax.set_ylabel("crash rate (%)")
    if best.any():
        middle = (own["x"][mine].min() + own["x"][mine].max()) / 2
        ax.legend(loc="upper right" if own["x"][best].mean() < middle else "lower left")
