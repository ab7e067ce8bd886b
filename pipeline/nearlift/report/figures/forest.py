"""A coefficient over many campaigns: a panel per coefficient, a line per campaign, the population
and the next campaign beneath them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from nearlift.nomenclature import VERDICTS, letter
from nearlift.report.evidence import Columns, Rows, distinct, stack, where
from nearlift.report.figures.style import BAND, SERIES, Style, labelled, plain_text
from nearlift.results.comparison import CampaignComparison, ComparedCoefficient
from nearlift.results.estimate import Estimate
from nearlift.rounding import like

#: A 90 % interval of a normal is so many standard deviations wide.
WIDTH_90 = 3.289707253902945
COLUMNS = (
    *("panel", "coefficient", "unit", "kind", "label", "vehicle", "verdict"),
    *("value", "lo90", "hi90"),
)
LINE_IN = 0.17
MARKERS = {"effect": "s"}


def summarise(comparison: CampaignComparison) -> Columns:
    """Rows of the comparison: `kind` is campaign, population or next."""
    rows = [
        {"panel": group.boundary, "coefficient": group.coefficient, **line}
        for group in comparison.groups
        for line in _lines(group)
    ]
    return stack(rows, COLUMNS)


def _lines(group: ComparedCoefficient) -> Iterator[dict[str, object]]:
    for c in group.campaigns:
        about = {"label": c.campaign, "vehicle": c.vehicle, "verdict": c.verdict}
        yield {"kind": "campaign", **about, **_interval(c.quoted)}
    if together := group.population:
        yield {"kind": "population", "label": "population mean", **_interval(together.mean)}
        yield {"kind": "next", "label": "next campaign", **_interval(together.next)}


def _interval(e: Estimate) -> dict[str, object]:
    return {"unit": e.unit, "value": e.value, "lo90": e.lo90, "hi90": e.hi90}


def interval(rows: Mapping[str, Any], i: int) -> str:
    """``2.00 (1.84 to 2.16)``: value and 90 % interval of one row."""
    value, low, high = (float(rows[end][i]) for end in ("value", "lo90", "hi90"))
    u = (high - low) / WIDTH_90
    return f"{like(value, u)} ({like(low, u)} to {like(high, u)})"


def caption(table: Columns) -> str:
    """Caption, with counts."""
    campaigns = where(table, kind="campaign")
    n = len(distinct(campaigns["label"]))
    parts = [f"Headline coefficients of {n} campaign{'s' if n != 1 else ''}, with 90 % intervals."]
    if "unexplained" in campaigns["verdict"]:
        parts.append("Open symbols: unexplained structure.")
    if "population" in table["kind"]:
        parts.append(
            "Diamond and band: the population's mean. Dashed: prediction for a further campaign."
        )
    return " ".join(parts)


def alt(table: Columns) -> str:
    """Description for screen readers."""
    parts = []
    for boundary, coefficient in distinct(table["panel"], table["coefficient"]):
        rows = where(table, panel=boundary, coefficient=coefficient)
        lines = "; ".join(f"{name} {interval(rows, i)}" for i, name in enumerate(rows["label"]))
        parts.append(f"{boundary.capitalize()}, {letter(coefficient)}: {lines}.")
    return " ".join(parts)


def draw(table: Rows, look: Style) -> Figure:
    """Campaigns from top to bottom in the order given."""
    keys = distinct(table["panel"], table["coefficient"])
    panels = [where(table, panel=b, coefficient=c) for b, c in keys]
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
            marker, inside = _symbol(rows["verdict"][i])
            ax.plot(rows["value"][i], y[i], marker, color=colour, mfc=inside, zorder=3)
    ax.set_yticks(y, [plain_text(label) for label in rows["label"]])
    ax.tick_params(axis="y", length=0, right=False)
    ax.set_ylim(y[-1] - 0.7, 0.7)
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.grid(axis="x", color="0.9", linewidth=0.4, zorder=0)
    ax.set_axisbelow(True)


def _symbol(verdict: str) -> tuple[str, str]:
    """Marker and its inside: what the loop said of the campaign decides, and only an open symbol
    has unexplained structure.
    """
    inside = "white" if verdict == "unexplained" else SERIES[0][0]
    return MARKERS.get(verdict, "o"), inside


def _legend(figure: Figure, table: Rows) -> None:
    """Only what occurs."""
    seen = distinct(where(table, kind="campaign")["verdict"])
    handles = [
        Line2D([], [], label=word, color=SERIES[0][0], marker=marker, markerfacecolor=inside)
        for verdict, word in VERDICTS.items()
        for marker, inside in [_symbol(verdict)]
        if verdict in seen
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, columnspacing=1.0)
