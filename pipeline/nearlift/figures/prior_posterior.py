"""Prior against posterior: a line for each parameter, its prior in grey, its posterior in black."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from nearlift import nomenclature
from nearlift.errors import UsageError
from nearlift.figures.style import BAND, FIT, Style, plain_text

Rows = Mapping[str, Any]
#: The axis runs this far beyond the prior's interval at most; what lies farther is marked at the
#: edge.
BEYOND = 0.6


def draw(table: Rows, look: Style) -> Figure:
    """One panel per boundary, beneath one another, sharing the axis."""
    panels = list(dict.fromkeys(table["panel"].tolist()))
    counts = [int((table["panel"] == p).sum()) for p in panels]
    height = min(0.2 * look.text_pt / 8 * sum(counts) + 0.45 * len(panels) + 0.4, look.height_in)
    figure = Figure(figsize=(look.double_in, height), layout="constrained")
    axes = figure.subplots(len(panels), 1, squeeze=False, sharex=True, height_ratios=counts)[:, 0]
    low = max(min(-0.05, float(table["low"].min()) - 0.05), -BEYOND)
    high = min(max(1.05, float(table["high"].max()) + 0.05), 1 + BEYOND)
    for letter, panel, ax in zip("abc", panels, axes, strict=False):
        _panel(ax, {k: v[table["panel"] == panel] for k, v in table.items()}, low, high)
        ax.set_title(
            f"{letter}) {panel}" if len(panels) > 1 else panel, loc="left", fontsize=look.text_pt
        )
    axes[0].annotate(
        "width ratio",
        (1, 1),
        xycoords="axes fraction",
        xytext=(4, 5),
        textcoords="offset points",
        fontsize=look.text_pt - 1,
    )
    axes[-1].set_xlabel("in units of the prior's central 90 %")
    return figure


def _panel(ax: Axes, rows: Rows, low: float, high: float) -> None:
    n = len(rows["low"])
    places = range(n)
    ax.barh(places, [1.0] * n, height=0.62, color=BAND, linewidth=0)
    ax.hlines(places, rows["low"], rows["high"], color=FIT, linewidth=2.2)
    ax.plot(
        rows["middle"],
        places,
        "o",
        color=FIT,
        markerfacecolor="white",
        markersize=3.4,
        markeredgewidth=0.8,
    )
    for i in places:
        for end, edge, mark in (
            (rows["middle"][i] < low, low, "<"),
            (rows["middle"][i] > high, high, ">"),
        ):
            if end:
                ax.plot(edge, i, mark, color=FIT, clip_on=False)
        ax.annotate(
            _ratio(rows["ratio"][i]),
            (1, i),
            xycoords=("axes fraction", "data"),
            xytext=(4, 0),
            textcoords="offset points",
            va="center",
        )
    labels = [
        f"{plain_text(m)}: {_name(p)}"
        for m, p in zip(rows["model"], rows["parameter"], strict=True)
    ]
    ax.set_yticks(list(places), labels)
    for label, base in zip(ax.get_yticklabels(), rows["base"], strict=True):
        label.set_fontweight("bold" if base else "normal")
    ax.tick_params(axis="y", length=0)
    ax.set_ylim(n - 0.5, -0.5)
    ax.set_xlim(low, high)


def _ratio(value: float) -> str:
    return f"{value:.2f}" if value >= 0.095 else f"{value:.2g}"


def _name(parameter: str) -> str:
    try:
        return f"${nomenclature.symbol(parameter).latex}$"
    except UsageError:
        return plain_text(parameter)
