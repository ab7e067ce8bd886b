"""A coefficient over many campaigns: a panel per coefficient, a line per campaign, the population
and the next campaign beneath them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from nearlift import nomenclature
from nearlift.nomenclature import letter
from nearlift.report.evidence import Columns, Rows, distinct, select, stack
from nearlift.report.figures.style import BAND, SERIES, Style, labelled, plain_text
from nearlift.rounding import like

#: A 90 % interval of a normal is so many standard deviations wide.
WIDTH_90 = 3.289707253902945
COLUMNS = (
    *("panel", "coefficient", "unit", "kind", "label", "vehicle", "verdict"),
    *("value", "lo90", "hi90"),
)
LINE_IN = 0.17
#: What the loop said of the campaign decides the symbol: only an open one has structure that nobody
#: could name.
MARKERS = {"effect": "s"}


def summarise(content: Mapping[str, Any]) -> Columns:
    """Rows of comparison.json: `kind` is campaign, population or next."""
    rows: list[dict[str, object]] = []
    for group in content["groups"]:
        shared = {
            "panel": group["boundary"],
            "coefficient": group["coefficient"],
            "unit": group["campaigns"][0]["quoted"]["unit"],
        }
        rows += [
            {
                **shared,
                "kind": "campaign",
                "label": finished["campaign"],
                "vehicle": finished["vehicle"],
                "verdict": finished["verdict"],
                **_interval(finished["quoted"]),
            }
            for finished in group["campaigns"]
        ]
        if together := group.get("population"):
            mean, following = _interval(together["mean"]), _interval(together["next"])
            rows.append({**shared, "kind": "population", "label": "population mean", **mean})
            rows.append({**shared, "kind": "next", "label": "next campaign", **following})
    return stack(rows, COLUMNS)


def _interval(estimate: Mapping[str, Any]) -> dict[str, float]:
    return {name: estimate[name] for name in ("value", "lo90", "hi90")}


def panel_rows(table: Rows, boundary: str, coefficient: str) -> Columns:
    """The rows of one panel."""
    return select(table, (table["panel"] == boundary) & (table["coefficient"] == coefficient))


def interval(rows: Columns, i: int) -> str:
    """``2.00 (1.84 to 2.16)``: value and 90 % interval of one row."""
    value, low, high = (float(rows[end][i]) for end in ("value", "lo90", "hi90"))
    u = (high - low) / WIDTH_90
    return f"{like(value, u)} ({like(low, u)} to {like(high, u)})"


def caption(table: Columns) -> str:
    """What is drawn, with counts."""
    campaigns = table["kind"] == "campaign"
    n = len(set(table["label"][campaigns].tolist()))
    parts = [f"Headline coefficients of {n} campaign{'s' if n != 1 else ''}, with 90 % intervals."]
    if (table["verdict"][campaigns] == "unexplained").any():
        parts.append("Open symbols: structure that no named effect explains.")
    if (table["kind"] == "population").any():
        parts.append(
            "Diamond and band: the population's mean; dashed: what a further campaign would find."
        )
    return " ".join(parts)


def alt(table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = []
    for boundary, coefficient in distinct(table["panel"], table["coefficient"]):
        rows = panel_rows(table, boundary, coefficient)
        lines = "; ".join(f"{name} {interval(rows, i)}" for i, name in enumerate(rows["label"]))
        parts.append(f"{boundary.capitalize()}, {letter(coefficient)}: {lines}.")
    return " ".join(parts)


def draw(table: Rows, look: Style) -> Figure:
    """Campaigns from top to bottom in the order given."""
    keys = distinct(table["panel"], table["coefficient"])
    panels = [panel_rows(table, boundary, coefficient) for boundary, coefficient in keys]
    lines = [len(rows["value"]) for rows in panels]
    height = min(LINE_IN * (sum(lines) + 3.2 * len(panels)) + 0.3, look.height_in)
    figure = Figure(figsize=(look.single_in * 1.25, height), layout="constrained")
    axes = figure.subplots(
        len(panels), 1, squeeze=False, gridspec_kw={"height_ratios": [n + 1.5 for n in lines]}
    )[:, 0]
    for ax, (boundary, coefficient), rows in zip(axes, keys, panels, strict=True):
        _panel(ax, rows)
        ax.set_title(boundary)
        ax.set_xlabel(labelled(coefficient, str(rows["unit"][0])), labelpad=1)
    _legend(figure, table)
    return figure


def _panel(ax: Axes, rows: Rows) -> None:
    y = -np.arange(len(rows["value"]), dtype=float)
    colour, accent = SERIES[0][0], SERIES[1][0]
    for i, kind in enumerate(rows["kind"]):
        span = [rows["lo90"][i], rows["hi90"][i]]
        if kind == "population":
            ax.axvspan(*span, color=BAND, alpha=0.45, linewidth=0, zorder=0)
            ax.plot(span, [y[i]] * 2, color=accent, zorder=3)
            ax.plot(rows["value"][i], y[i], "D", color=accent, zorder=4)
        elif kind == "next":
            ax.plot(span, [y[i]] * 2, color=accent, linestyle=(0, (3, 1.5)), zorder=3)
        else:
            ax.plot(span, [y[i]] * 2, color=colour, zorder=2)
            filled = "white" if rows["verdict"][i] == "unexplained" else colour
            ax.plot(
                rows["value"][i],
                y[i],
                MARKERS.get(rows["verdict"][i], "o"),
                color=colour,
                markerfacecolor=filled,
                zorder=3,
            )
    ax.set_yticks(y, [plain_text(label) for label in rows["label"]])
    ax.tick_params(axis="y", length=0, right=False)
    ax.set_ylim(y[-1] - 0.7, 0.7)
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.grid(axis="x", color="0.9", linewidth=0.4, zorder=0)
    ax.set_axisbelow(True)


def _legend(figure: Figure, table: Rows) -> None:
    """Only what occurs."""
    colour = SERIES[0][0]
    seen = set(table["verdict"][table["kind"] == "campaign"].tolist())
    handles = [
        Line2D(
            [],
            [],
            color=colour,
            marker=MARKERS.get(v, "o"),
            markerfacecolor="white" if v == "unexplained" else colour,
            label=word,
        )
        for v, word in nomenclature.VERDICTS.items()
        if v in seen
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, columnspacing=1.0)
