"""Figure 6: sample flights above, crash rates with energy below, ground on the left, ceiling on the
right.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from nearlift import nomenclature
from nearlift.figures.style import SEQUENTIAL, SERIES, Style, plain_text

Rows = Mapping[str, Any]
LETTERS = "abcdefgh"
NONE = "#000000"
COST = {"cost_paper": (0, (4, 1.5)), "cost": (0, (1, 1.2))}
COST_COLOUR = SERIES[1][0]
TITLES = {"histories": "sample flights", "paper": "as printed", "converged": "converged step"}


def draw(table: Rows, look: Style) -> Figure:
    """A row of panels for the flights and one for each preset that was flown."""
    rows = list(
        dict.fromkeys(r for r in ("histories", "paper", "converged") if (table["row"] == r).any())
    )
    sides = list(dict.fromkeys(table["panel"].tolist()))
    height = min(look.double_in * 0.33 * len(rows) + 0.25, look.height_in)
    figure = Figure(figsize=(look.double_in, height), layout="constrained")
    axes = figure.subplots(len(rows), len(sides), squeeze=False)
    letters = iter(LETTERS)
    for i, row in enumerate(rows):
        for j, side in enumerate(sides):
            ax = axes[i, j]
            own = {
                name: column[(table["row"] == row) & (table["panel"] == side)]
                for name, column in table.items()
            }
            if row == "histories":
                _histories(ax, own, side)
            else:
                _rates(ax, own, last=j == len(sides) - 1)
            ax.set_title(
                f"{next(letters)}) {side}, {TITLES[row]}", loc="left", fontsize=look.text_pt
            )
    exponents = sorted(set(table["exponent"][table["kind"] == "crash"].tolist()))
    handles = [Line2D([], [], color=colour(e, exponents), linewidth=1.3) for e in exponents]
    names = [
        "no model" if e == 0 else f"model$^{{\\,{e:g}}}$" if e != 1 else "model" for e in exponents
    ]
    handles += [Line2D([], [], color=COST_COLOUR, linestyle=s) for s in COST.values()]
    names += ["$(L/L_\\infty)^{-3/2}$", "$(L/L_\\infty)^{-1}$"]
    figure.legend(
        handles,
        names,
        loc="outside lower center",
        ncols=len(names),
        columnspacing=1.0,
        handlelength=1.8,
    )
    return figure


def colour(exponent: float, exponents: list[float]) -> Any:
    """Black without a model, else even steps from dark to light."""
    powers = [e for e in exponents if e != 0]
    if exponent == 0:
        return NONE
    return matplotlib.colormaps[SEQUENTIAL](
        0.12 + 0.76 * powers.index(exponent) / max(len(powers) - 1, 1)
    )


def _histories(ax: Axes, own: Rows, side: str) -> None:
    for label in dict.fromkeys(own["label"].tolist()):
        mine = own["label"] == label
        x, y = own["x"][mine], own["y"][mine]
        shade = NONE if label == "none" else SERIES[0][0]
        ax.plot(x, y, color=shade, linewidth=0.8)
        if len(y) and y[-1] <= 0:
            ax.plot(
                x[-1:], y[-1:], marker="x", color=shade, markersize=5, markeredgewidth=1.2, zorder=5
            )
    ax.set_xlim(own["x"].min(), own["x"].max())
    ax.axhline(0, color="0.45", linewidth=1.6, zorder=0)
    # room for the legend beyond the flights, and for the boundary with its crosses on this side of
    # the frame
    top = 1.22 * float(own["y"].max())
    ax.set_ylim(-0.09 * top, top)
    ax.set_xlabel("time (s)")
    ax.set_ylabel(nomenclature.label("z_hat"))
    if side == "ceiling":
        # as one sees it: the ceiling above
        ax.invert_yaxis()
    handles = [Line2D([], [], color=NONE), Line2D([], [], color=SERIES[0][0])]
    names = [
        "no model",
        "with " + plain_text(next((m for m in own["label"].tolist() if m != "none"), "model")),
    ]
    ax.legend(handles, names, loc="lower right" if side == "ceiling" else "upper right", ncols=2)


def _rates(ax: Axes, own: Rows, last: bool) -> None:
    crash = own["kind"] == "crash"
    exponents = sorted(set(own["exponent"][crash].tolist()))
    for e in exponents:
        mine = crash & (own["exponent"] == e)
        shade = colour(e, exponents)
        ax.fill_between(
            own["x"][mine],
            100 * own["lo90"][mine],
            100 * own["hi90"][mine],
            color=shade,
            alpha=0.25,
            linewidth=0,
        )
        ax.plot(
            own["x"][mine], 100 * own["y"][mine], color=shade, linewidth=1.3 if e in (0, 1) else 0.8
        )
    ax.set_ylim(-2, 102)
    ax.set_xlabel(nomenclature.label("target_z_hat"))
    ax.set_ylabel("crash rate (%)")
    right: Any = ax.twinx()
    for kind, dashes in COST.items():
        mine = own["kind"] == kind
        right.plot(own["x"][mine], own["y"][mine], color=COST_COLOUR, linestyle=dashes)
    right.set_ylim(0.5, 1.02)
    right.tick_params(axis="y", colors=COST_COLOUR)
    ax.tick_params(axis="y", right=False)
    if last:
        right.set_ylabel("relative power to hover", color=COST_COLOUR)
