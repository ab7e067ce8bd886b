"""Sources of error: the fall of each coefficient's uncertainty if that source were known exactly; a
panel per coefficient, a bar per source.
"""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from nearlift.declare import Boundary
from nearlift.nomenclature import letter, mathematics
from nearlift.report.evidence import Evidence, groups, pick
from nearlift.report.figures import style
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES, Style
from nearlift.report.tables import fall
from nearlift.results.quotation import CoefficientResult
from nearlift.stages.fit import FIT

#: A source from repeats whose knowledge would lessen no coefficient's uncertainty by this part is
#: not drawn; what was declared always is.
MIN_FALL = 0.002
COLUMNS = ["panel", "parameter", "component", "type", "fall_percent", "u", "u_without"]
#: Types of evaluation: colour, hatch and meaning.
TYPES = {
    "A": (SERIES[0][0], "", "type A: from repeats"),
    "B": (SERIES[1][0], "////", "type B: stated"),
}


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
    every = pd.DataFrame(
        [
            (b, name, part.source, part.kind, 100 * fall(part, c.u), part.u, part.u_without)
            for b, name, c in budgets
            for part in c.budget
        ],
        columns=COLUMNS,
    )
    falls = every.groupby("component")["fall_percent"]
    # panels as they come, sources by their sum
    order = every.groupby(["panel", "parameter"], sort=False).ngroup()
    every = every.assign(order=order, total=-falls.transform("sum"))
    shown = (falls.transform("max") >= 100 * MIN_FALL) | (every["type"] == "B")
    every = every[shown].sort_values(["order", "total"], kind="stable")
    return every[COLUMNS].reset_index(drop=True)


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


def draw(table: pd.DataFrame, look: Style) -> Figure:
    """Panels side by side share the list of sources."""
    panels = groups(table, "panel", "parameter")
    total = table.groupby("component", sort=False)["fall_percent"].sum()
    components = list(total.sort_values(ascending=False, kind="stable").index)
    height = 0.19 * len(components) + 0.75
    figure, axes = style.canvas(look, 1, len(panels), height, look.double_in, sharey=True)
    style.title(axes[0], [f"{mathematics(name)}, {boundary}" for boundary, name in panels])
    for ax, (boundary, name) in zip(axes[0], panels, strict=True):
        rows = pick(table, panel=boundary, parameter=name)
        colours, hatches, _ = zip(*(TYPES[kind] for kind in rows["type"]), strict=True)
        drawn = ax.barh(
            [components.index(c) for c in rows["component"]], rows["fall_percent"], height=0.7,
            color=colours, hatch=hatches, edgecolor="white", linewidth=0,
        )  # fmt: skip
        ax.bar_label(drawn, map(_percent, rows["fall_percent"]), padding=3, size=style.SMALL_PT)
        ax.set_yticks(range(len(components)), [style.effects(c) for c in components])
        ax.set(ylim=(len(components) - 0.4, -0.6), xlim=(0, 124), xticks=[0, 50, 100])
        ax.tick_params(axis="y", length=0)
    figure.supxlabel("fall of the standard uncertainty if the source were known exactly (%)")
    handles = [
        Patch(facecolor=colour, hatch=hatch, edgecolor="white", linewidth=0, label=meaning)
        for kind, (colour, hatch, meaning) in TYPES.items()
        if (table["type"] == kind).any()
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=2)
    return figure


def _percent(fall: float) -> str:
    if fall < 0.1:
        return "< 0.1" if fall > 0 else "0"
    return f"{fall:.1f}" if fall < 9.95 else f"{fall:.0f}"


FIGURE = FigureSpec(
    "budget", "Whose error it is", (FIT,), table, caption, draw, "fall_percent",
    ("panel", "parameter"),
)  # fmt: skip
