"""A coefficient over many campaigns: a panel per coefficient, a line per campaign, the population
and the next campaign beneath them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from nearlift.nomenclature import VERDICTS
from nearlift.report.evidence import Part, frame, groups, pick, records
from nearlift.report.figures import style
from nearlift.report.figures.style import BAND, SERIES
from nearlift.results.answers import CampaignComparison
from nearlift.results.estimate import Estimate

COLUMNS = (
    *("panel", "coefficient", "unit", "kind", "label", "vehicle", "verdict"),
    *("value", "lo90", "hi90"),
)


def table(comparison: CampaignComparison) -> pd.DataFrame:
    """Rows of the comparison: `kind` is campaign, population or next."""
    parts: list[Part] = []
    for group in comparison.groups:
        rows: list[tuple[Part, Estimate]] = [
            ({"label": c.campaign, "vehicle": c.vehicle, "verdict": c.verdict}, c.quoted)
            for c in group.campaigns
        ]
        if group.population:
            rows.append(({"kind": "population", "label": "population mean"}, group.population.mean))
            rows.append(({"kind": "next", "label": "next campaign"}, group.population.next))
        about = {"panel": group.boundary, "coefficient": group.coefficient, "kind": "campaign"}
        parts += [
            {**about, "unit": e.unit, "value": e.value, "lo90": e.lo90, "hi90": e.hi90, **row}
            for row, e in rows
        ]
    return frame(parts, COLUMNS)


def draw(table: pd.DataFrame) -> Figure:
    """Campaigns from top to bottom in the order given."""
    keys = groups(table, "panel", "coefficient", "unit")
    panels = [pick(table, panel=b, coefficient=c) for b, c, _ in keys]
    lines = [len(rows) for rows in panels]
    height = 0.17 * (sum(lines) + 3.2 * len(panels)) + 0.3
    figure, axes = style.canvas(
        len(panels), 1, height, 1.25 * style.SINGLE_IN, height_ratios=[n + 1.5 for n in lines]
    )
    for ax, (boundary, coefficient, unit), rows in zip(axes[:, 0], keys, panels, strict=True):
        _panel(ax, rows)
        ax.set(title=boundary, xlabel=style.labelled(coefficient, unit))
    seen = set(pick(table, kind="campaign")["verdict"])
    handles = [Line2D([], [], label=VERDICTS[v], **_symbol(v)) for v in VERDICTS if v in seen]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, columnspacing=1.0)
    return figure


def _panel(ax: Axes, rows: pd.DataFrame) -> None:
    y = -np.arange(len(rows), dtype=float)
    for at, row in zip(y, records(rows), strict=True):
        campaign = row.kind == "campaign"
        colour = SERIES[0 if campaign else 1][0]
        dashes: Any = (0, (3, 1.5)) if row.kind == "next" else "-"
        ax.plot([row.lo90, row.hi90], [at, at], color=colour, linestyle=dashes, zorder=2)
        if row.kind == "population":
            ax.axvspan(row.lo90, row.hi90, color=BAND, alpha=0.45, linewidth=0, zorder=0)
        if row.kind != "next":
            symbol = _symbol(row.verdict) if campaign else {"marker": "D", "color": colour}
            ax.plot(row.value, at, zorder=3, **symbol)
    ax.set_yticks(y, [style.plain_text(label) for label in rows["label"]])
    ax.tick_params(axis="y", length=0, right=False)
    ax.set_ylim(y[-1] - 0.7, 0.7)
    ax.xaxis.set_major_locator(MaxNLocator(6))
    ax.grid(axis="x", color="0.9", linewidth=0.4, zorder=0)
    ax.set_axisbelow(True)


def _symbol(verdict: str) -> dict[str, Any]:
    """Look of a campaign: only an open symbol has unexplained structure."""
    colour = SERIES[0][0]
    inside = "white" if verdict == "unexplained" else colour
    marker = "s" if verdict == "effect" else "o"
    return {"color": colour, "marker": marker, "markerfacecolor": inside}
