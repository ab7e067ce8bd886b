"""A coefficient over many campaigns: a panel per coefficient, a line per campaign, the population
and the next campaign beneath them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from nearlift.nomenclature import VERDICTS
from nearlift.report.evidence import Part, frame, groups, pick, records
from nearlift.report.figures import style
from nearlift.report.figures.style import BAND, DEFAULT, SERIES, Look, Style, labelled, plain_text
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


def table(comparison: CampaignComparison) -> pd.DataFrame:
    """Rows of the comparison: `kind` is campaign, population or next."""
    rows = [
        {"panel": group.boundary, "coefficient": group.coefficient, **line}
        for group in comparison.groups
        for line in _lines(group)
    ]
    return frame(rows, COLUMNS)


def _lines(group: ComparedCoefficient) -> Iterator[Part]:
    for c in group.campaigns:
        about = {"label": c.campaign, "vehicle": c.vehicle, "verdict": c.verdict}
        yield {"kind": "campaign", **about, **_interval(c.quoted)}
    if together := group.population:
        yield {"kind": "population", "label": "population mean", **_interval(together.mean)}
        yield {"kind": "next", "label": "next campaign", **_interval(together.next)}


def _interval(e: Estimate) -> Part:
    return {"unit": e.unit, "value": e.value, "lo90": e.lo90, "hi90": e.hi90}


def interval(value: float, low: float, high: float) -> str:
    """``2.00 (1.84 to 2.16)``: a value and its 90 % interval."""
    u = (high - low) / WIDTH_90
    return f"{like(value, u)} ({like(low, u)} to {like(high, u)})"


def caption(table: pd.DataFrame) -> str:
    """Caption, with counts."""
    campaigns = pick(table, kind="campaign")
    n = campaigns["label"].nunique()
    parts = [f"Headline coefficients of {n} campaign{'s' if n != 1 else ''}, with 90 % intervals."]
    if (campaigns["verdict"] == "unexplained").any():
        parts.append("Open symbols: unexplained structure.")
    if (table["kind"] == "population").any():
        parts.append(
            "Diamond and band: the population's mean. Dashed: prediction for a further campaign."
        )
    return " ".join(parts)


def draw(table: pd.DataFrame, look: Style = DEFAULT) -> Figure:
    """Campaigns from top to bottom in the order given."""
    keys = groups(table, "panel", "coefficient", "unit")
    panels = [pick(table, panel=b, coefficient=c) for b, c, _ in keys]
    lines = [len(rows) for rows in panels]
    height = LINE_IN * (sum(lines) + 3.2 * len(panels)) + 0.3
    ratios: Look = {"height_ratios": [n + 1.5 for n in lines]}
    figure, axes = style.canvas(look, len(panels), 1, height, 1.25 * look.single_in, **ratios)
    for ax, (boundary, coefficient, unit), rows in zip(axes[:, 0], keys, panels, strict=True):
        _panel(ax, rows)
        ax.set_title(boundary)
        ax.set_xlabel(labelled(coefficient, unit), labelpad=1)
    seen = set(pick(table, kind="campaign")["verdict"])
    handles = [Line2D([], [], label=VERDICTS[v], **_symbol(v)) for v in VERDICTS if v in seen]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, columnspacing=1.0)
    return figure


def _panel(ax: Axes, rows: pd.DataFrame) -> None:
    y = -np.arange(len(rows), dtype=float)
    accent = SERIES[1][0]
    for at, row in zip(y, records(rows), strict=True):
        span = [row.lo90, row.hi90]
        if row.kind == "population":
            ax.axvspan(row.lo90, row.hi90, color=BAND, alpha=0.45, linewidth=0, zorder=0)
            ax.plot(span, [at] * 2, color=accent, zorder=3)
            ax.plot(row.value, at, "D", color=accent, zorder=4)
        elif row.kind == "next":
            ax.plot(span, [at] * 2, color=accent, linestyle=(0, (3, 1.5)), zorder=3)
        else:
            ax.plot(span, [at] * 2, color=SERIES[0][0], zorder=2)
            ax.plot(row.value, at, zorder=3, **_symbol(str(row.verdict)))
    ax.set_yticks(y, [plain_text(label) for label in rows["label"]])
    ax.tick_params(axis="y", length=0, right=False)
    ax.set_ylim(y[-1] - 0.7, 0.7)
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.grid(axis="x", color="0.9", linewidth=0.4, zorder=0)
    ax.set_axisbelow(True)


def _symbol(verdict: str) -> Look:
    """Look of a campaign: only an open symbol has unexplained structure."""
    colour = SERIES[0][0]
    inside = "white" if verdict == "unexplained" else colour
    marker = "s" if verdict == "effect" else "o"
    return {"color": colour, "marker": marker, "markerfacecolor": inside}
