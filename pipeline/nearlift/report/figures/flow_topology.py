"""The wake's topology against tilt: vortices, stagnation zone and split angle, left and right, each
with its bootstrap interval.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from nearlift.products import FLOW, FLOW_FIELDS, FLOW_TOPOLOGY
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, select, stack, where
from nearlift.report.figures import fig5
from nearlift.report.figures.flow_panels import origin
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES, Style

#: Panel, its axis label, the quantity drawn in it, and what the legend calls that.
PANELS = (
    ("vortices", "number", "vortices_ccw", "counter-clockwise"),
    ("vortices", "number", "vortices_cw", "clockwise"),
    ("area", "area / $r^2$", "stagnation_area_hat2", ""),
    ("height", "height / $r$", "stagnation_height_hat", ""),
    ("split", "split angle (deg)", "split_angle_deg", ""),
    ("asymmetry", "momentum asymmetry", "asymmetry", ""),
)
ACROSS = 3
TITLES = {
    "vortices": "standing vortices",
    "area": "stagnation zone, area",
    "height": "stagnation zone, height",
    "split": "where the wake splits",
    "asymmetry": "right less left",
}


def summarise(evidence: Evidence) -> Columns:
    """A row for each number of each tilted case: `panel`, `axis`, `label`, `tilt_deg`, `value`,
    `lo90`, `hi90`.
    """
    names = [c.name for c in fig5.cases(evidence)]
    if not names:
        return {}
    table = evidence.table(FLOW_TOPOLOGY)
    table = select(table, np.isin(table["case"], names) & np.isfinite(table["value"]))
    parts = []
    for panel, axis, quantity, label in PANELS:
        rows = where(table, quantity=quantity)
        rows = select(rows, np.argsort(rows["tilt_rad"]))
        parts.append(
            {
                "panel": panel,
                "axis": axis,
                "label": label,
                "tilt_deg": np.degrees(rows["tilt_rad"]),
                **{name: rows[name] for name in ("value", "lo90", "hi90")},
            }
        )
    return stack(parts)


def caption(evidence: Evidence, table: Columns) -> str:
    """What the reader must know."""
    return (
        "Topology of the wake against tilt of the ground. Bars: 90 % intervals over resampled sets"
        " of fields. Asymmetry: right-going less left-going momentum beneath the rotor plane over"
        f" their sum. {origin(evidence, [c.name for c in fig5.cases(evidence)])}"
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = []
    for panel in distinct(table["panel"]):
        values = where(table, panel=panel)["value"]
        parts.append(f"{panel} from {values.min():.3g} to {values.max():.3g}".replace("-", "−"))
    return f"Numbers of the wake against tilt: {'; '.join(parts)}."


def draw(table: Rows, look: Style) -> Figure:
    """A panel for each number."""
    names = distinct(table["panel"])
    down = -(-len(names) // ACROSS)
    figure = Figure(figsize=(look.double_in, 1.75 * down + 0.2), layout="constrained")
    axes = figure.subplots(down, ACROSS, squeeze=False)
    ends = table["tilt_deg"].min(), table["tilt_deg"].max()
    for ax in axes.ravel()[len(names) :]:
        ax.set_axis_off()
    for letter, name, ax in zip("abcdef", names, axes.ravel(), strict=False):
        mine = where(table, panel=name)
        labels = distinct(mine["label"])
        for shift, (colour, marker), label in zip((-0.12, 0.12), SERIES, labels, strict=False):
            series = where(mine, label=label)
            value = series["value"]
            x = series["tilt_deg"] + (shift if len(labels) > 1 else 0.0)
            ax.errorbar(
                x,
                value,
                np.abs([value - series["lo90"], series["hi90"] - value]),
                fmt=marker,
                color=colour,
                markerfacecolor="white",
                elinewidth=0.8,
                label=label or None,
            )
        if len(labels) > 1:
            ax.legend(loc="upper left")
            ax.margins(y=0.35)
            ax.yaxis.set_major_locator(MaxNLocator(integer=True))
        ax.axvline(0, color="0.8", linewidth=0.5, zorder=0)
        ax.set_xlim(ends[0] - 0.5, ends[1] + 0.5)
        ax.set_ylabel(mine["axis"][0])
        ax.set_xlabel(r"tilt $\theta$ (deg)")
        ax.set_title(f"{letter}) {TITLES[name]}")
    return figure


FIGURE = FigureSpec(
    name="flow_topology",
    title="The wake against tilt",
    needs=(FLOW_FIELDS, FLOW_TOPOLOGY, FLOW),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
