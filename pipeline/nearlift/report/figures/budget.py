"""Sources of error: the fall of each coefficient's uncertainty if that source were
known exactly; a panel per coefficient, a bar per source.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from nearlift.declare import Boundary
from nearlift.nomenclature import letter, mathematics
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, stack, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES, Style, effects, headed, note
from nearlift.report.tables import fall
from nearlift.results.quotation import CoefficientResult
from nearlift.stages.fit import FIT

#: A source from repeats whose knowledge would lessen no coefficient's uncertainty by this part is
#: not drawn; what was declared always is.
LEAST = 0.002
COLUMNS = ("panel", "parameter", "component", "type", "fall_percent", "u", "u_without")
LOOKS: dict[str, dict[str, Any]] = {
    kind: {"facecolor": colour, "hatch": hatch, "edgecolor": "white", "linewidth": 0.0}
    for kind, colour, hatch in (("A", SERIES[0][0], ""), ("B", SERIES[1][0], "////"))
}
MEANINGS = {"A": "type A: from repeats", "B": "type B: declared"}


def summarise(evidence: Evidence) -> Columns:
    """A row for each bar: `panel` (boundary), `parameter`, `component`, `type` (A from repeats, B
    declared), `fall_percent` of the coefficient's standard uncertainty if the source were known
    exactly, `u` that it adds, `u_without` it. Every panel has every component, the largest fall
    first; numbers are NaN where a coefficient has no such source.
    """
    budgets = [
        (b, name, c)
        for b in evidence.boundaries
        for name, c in evidence.quoted(b).coefficients.items()
        if c.budget
    ]
    return bars(budgets)


def bars(budgets: Sequence[tuple[Boundary, str, CoefficientResult]]) -> Columns:
    """The table of these coefficients' budgets."""
    falls: dict[str, list[float]] = {}
    kinds: dict[str, str] = {}
    for _, _, coefficient in budgets:
        for line in coefficient.budget:
            falls.setdefault(line.source, []).append(fall(line, coefficient.u))
            kinds[line.source] = line.kind
    shown = sorted(
        (c for c in falls if max(falls[c]) >= LEAST or kinds[c] == "B"),
        key=lambda c: -sum(falls[c]),
    )
    rows = []
    for boundary, name, coefficient in budgets:
        lines = {line.source: line for line in coefficient.budget}
        for source in shown:
            head = (boundary, name, source, kinds[source])
            row: dict[str, object] = dict(zip(COLUMNS, head, strict=False))
            if source in lines:
                line = lines[source]
                percent = 100 * fall(line, coefficient.u)
                row |= {"fall_percent": percent, "u": line.u, "u_without": line.u_without}
            rows.append(row)
    return stack(rows, COLUMNS)


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption, with the largest source of each coefficient."""
    words = []
    for panel, name in distinct(table["panel"], table["parameter"]):
        mine = where(table, panel=panel, parameter=name)
        top = np.nanargmax(mine["fall_percent"])
        source, percent = mine["component"][top], mine["fall_percent"][top]
        words.append(f"{letter(name)} ({panel}): {source}, {percent:.0f} %")
    return (
        "Fall of each coefficient's standard uncertainty if one source of error were known exactly."
        " Type A: from repeats. Type B: stated in the manifest. Sources are correlated, so the"
        " falls do not add. Largest:"
        f" {'; '.join(words)}."
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """Description for screen readers."""
    n = len(distinct(table["panel"], table["parameter"]))
    return (
        f"Horizontal bars in {n} panel{'s' if n != 1 else ''}. "
        + caption(evidence, table).split("Largest: ")[1]
    )


def draw(table: Rows, look: Style) -> Figure:
    """Panels side by side share the list of sources."""
    panels = distinct(table["panel"], table["parameter"])
    components = distinct(table["component"])
    height = min((0.19 * len(components) + 0.75) * look.text_pt / 8, look.height_in)
    figure = Figure(figsize=(look.double_in, height), layout="constrained")
    # names of sources reach to the figure's edge, and a printer's cut would take their first letter
    figure.set_layout_engine("constrained", rect=(0.012, 0.0, 0.976, 1.0))
    axes = figure.subplots(1, len(panels), squeeze=False, sharey=True)[0]
    titles = headed([f"{mathematics(parameter)}, {boundary}" for boundary, parameter in panels])
    for title, ax, (boundary, parameter) in zip(titles, axes, panels, strict=False):
        mine = where(table, panel=boundary, parameter=parameter)
        for y, (percent, kind) in enumerate(zip(mine["fall_percent"], mine["type"], strict=True)):
            if np.isnan(percent):
                # no source of this coefficient
                continue
            ax.barh(y, percent, height=0.7, **LOOKS[kind])
            note(ax, _percent(percent), (percent, y), (3, 0), va="center")
        ax.set_yticks(range(len(components)), [effects(c) for c in components])
        ax.set_ylim(len(components) - 0.4, -0.6)
        ax.set_xlim(0, 124)
        ax.set_xticks([0, 50, 100])
        ax.tick_params(axis="y", length=0)
        ax.set_title(title)
    words = "fall of the standard uncertainty if the source were known exactly (%)"
    figure.supxlabel(words, fontsize=look.text_pt)
    kinds = [kind for kind in LOOKS if np.any(table["type"] == kind)]
    handles = [Patch(label=MEANINGS[kind], **LOOKS[kind]) for kind in kinds]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def _percent(fall: float) -> str:
    if fall < 0.1:
        return "< 0.1" if fall > 0 else "0"
    return f"{fall:.1f}" if fall < 9.95 else f"{fall:.0f}"


FIGURE = FigureSpec(
    name="budget",
    title="Whose error it is",
    needs=(FIT,),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
