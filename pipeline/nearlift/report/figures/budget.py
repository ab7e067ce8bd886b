"""Sources of error: the fall of each coefficient's uncertainty if that source were known exactly; a
panel per coefficient, a bar per source.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from nearlift.declare import Boundary
from nearlift.nomenclature import letter, mathematics
from nearlift.report.evidence import Evidence, groups, pick, records
from nearlift.report.figures import style
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import DEFAULT, SERIES, Look, Style
from nearlift.report.tables import fall
from nearlift.results.quotation import CoefficientResult
from nearlift.stages.fit import FIT

#: A source from repeats whose knowledge would lessen no coefficient's uncertainty by this part is
#: not drawn; what was declared always is.
LEAST = 0.002
COLUMNS = ("panel", "parameter", "component", "type", "fall_percent", "u", "u_without")
LOOKS: dict[str, Look] = {
    kind: {"facecolor": colour, "hatch": hatch, "edgecolor": "white", "linewidth": 0.0}
    for kind, colour, hatch in (("A", SERIES[0][0], ""), ("B", SERIES[1][0], "////"))
}
MEANINGS = {"A": "type A: from repeats", "B": "type B: stated"}


def table(evidence: Evidence) -> pd.DataFrame:
    """A row for each bar, the largest fall first.

    `fall_percent` is the fall of the coefficient's standard uncertainty if the component were known
    exactly. `u` is the uncertainty that it adds, `u_without` that without it.
    """
    return bars(
        [
            (b, name, c)
            for b in evidence.boundaries
            for name, c in evidence.quoted(b).coefficients.items()
        ]
    )


def bars(budgets: Sequence[tuple[Boundary, str, CoefficientResult]]) -> pd.DataFrame:
    """The table of these coefficients' budgets."""
    rows = [
        (b, name, part.source, part.kind, 100 * fall(part, c.u), part.u, part.u_without)
        for b, name, c in budgets
        for part in c.budget
    ]
    every = pd.DataFrame(rows, columns=list(COLUMNS))
    of_source = every.groupby("component")["fall_percent"]
    shown = (of_source.transform("max") >= 100 * LEAST) | (every["type"] == "B")
    every = every.assign(total=-of_source.transform("sum"))[shown]
    # panels as they come, sources by their sum
    order = every.groupby(["panel", "parameter"], sort=False).ngroup()
    every = every.assign(order=order).sort_values(["order", "total"], kind="stable")
    return every[list(COLUMNS)].reset_index(drop=True)


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption, with the largest source of each coefficient."""
    words = []
    for panel, name in groups(table, "panel", "parameter"):
        mine = pick(table, panel=panel, parameter=name)
        top = mine.sort_values("fall_percent", kind="stable").iloc[-1]
        words.append(f"{letter(name)} ({panel}): {top['component']}, {top['fall_percent']:.0f} %")
    return (
        "Fall of each coefficient's standard uncertainty if one source of error were known exactly."
        " Type A: from repeats. Type B: stated in the manifest. Sources are correlated, so the"
        f" falls do not add. Largest: {'; '.join(words)}."
    )


def draw(table: pd.DataFrame, look: Style = DEFAULT) -> Figure:
    """Panels side by side share the list of sources."""
    panels = groups(table, "panel", "parameter")
    total = table.groupby("component", sort=False)["fall_percent"].sum()
    components = list(total.sort_values(ascending=False, kind="stable").index)
    height = (0.19 * len(components) + 0.75) * look.text_pt / 8
    figure, axes = style.canvas(look, 1, len(panels), height, look.double_in, sharey=True)
    titles = style.lettered([f"{mathematics(name)}, {boundary}" for boundary, name in panels])
    for title, ax, (boundary, name) in zip(titles, axes[0], panels, strict=True):
        for row in records(pick(table, panel=boundary, parameter=name)):
            y = components.index(row.component)
            ax.barh(y, row.fall_percent, height=0.7, **LOOKS[str(row.type)])
            style.note(ax, _percent(row.fall_percent), (row.fall_percent, y), (3, 0), va="center")
        ax.set_yticks(range(len(components)), [style.effects(c) for c in components])
        ax.set(ylim=(len(components) - 0.4, -0.6), xlim=(0, 124), xticks=[0, 50, 100], title=title)
        ax.tick_params(axis="y", length=0)
    words = "fall of the standard uncertainty if the source were known exactly (%)"
    figure.supxlabel(words, fontsize=look.text_pt)
    kinds = [kind for kind in LOOKS if np.any(table["type"] == kind)]
    handles = [Patch(label=MEANINGS[kind], **LOOKS[kind]) for kind in kinds]
    figure.legend(handles=handles, loc="outside upper center", ncols=2)
    return figure


def _percent(fall: float) -> str:
    if fall < 0.1:
        return "< 0.1" if fall > 0 else "0"
    return f"{fall:.1f}" if fall < 9.95 else f"{fall:.0f}"


FIGURE = FigureSpec(
    name="budget",
    title="Whose error it is",
    needs=(FIT,),
    rows=table,
    draw=draw,
    caption=caption,
    shows="fall_percent",
    within=("panel", "parameter"),
)
