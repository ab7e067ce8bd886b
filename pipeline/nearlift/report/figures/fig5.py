"""Figure 5: the wake over a tilted ground: airspeed, streamlines, vortex cores and the outline of
the stagnation zone, three panels to a row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from nearlift.campaign.piv import PivCase
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, single, stack, where
from nearlift.report.figures import flow_panels as flow_panel
from nearlift.report.figures.fig4 import LEVEL
from nearlift.report.figures.flow_panels import field_rows, manifest, origin, title
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import Style, circles
from nearlift.rounding import fixed, plain
from nearlift.stages.flow import FLOW, FLOW_FIELDS, FLOW_TOPOLOGY

ACROSS = 3
#: Height of the legend, inches.
LEGEND_IN = 0.35


def cases(evidence: Evidence) -> list[PivCase]:
    """Tilted ground cases from the most positive to the most negative tilt."""
    tilted = [c for c in manifest(evidence).case if c.boundary == "ground" and abs(c.tilt) >= LEVEL]
    return sorted(tilted, key=lambda c: -c.tilt)


def summarise(evidence: Evidence) -> Columns:
    """Rows as in Figure 3's upper panels; `vortex` rows carry the sign of rotation in `flag`. Empty
    without tilted cases.
    """
    r = evidence.campaign.vehicle.rotor_radius
    parts = []
    for case in cases(evidence):
        parts += field_rows(evidence, case, title(case, tilted=True))
        parts += [
            {
                "panel": case.name,
                "kind": "vortex",
                "x_hat": vortex["x_m"] / r,
                "y_hat": vortex["y_m"] / r,
                "flag": np.sign(vortex["circulation_m2_s"]),
            }
            for vortex in evidence.document(FLOW)["cases"][case.name]["vortices"]
        ]
    return stack(parts, flow_panel.COLUMNS)


def topology(evidence: Evidence, case: str) -> dict[str, Any]:
    """Row of flow_topology.parquet of one case."""
    table = evidence.table(FLOW_TOPOLOGY)
    return single(table, table["case"] == case)


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption, with the area of the stagnation zone at each tilt."""
    names = [c.name for c in cases(evidence)]
    areas = [fixed(topology(evidence, n)["stagnation_area_hat2"], 2) for n in names]
    tilts = [f"{math.degrees(c.tilt):+.1f}°".replace("-", "−") for c in cases(evidence)]
    return (
        "Time-averaged airspeed and streamlines over a tilted ground. θ > 0 where the ground falls"
        " away to the right. Circles: standing vortices (|Γ₂| > 2/π and |Γ₁| > 0.5), filled where"
        " they turn counter-clockwise. Outline: stagnation zone, air slower than 0.3 of the"
        " control's downwash on the ground beneath the rotors' inner halves. Its area for"
        f" {', '.join(tilts)} is {', '.join(areas)} r²."
        f" {origin(evidence, names)}"
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """Text alternative of the figure."""
    parts = []
    for case in cases(evidence):
        row = topology(evidence, case.name)
        ccw, cw = (plain(row[f"vortices_{s}"]) for s in ("ccw", "cw"))
        angle = f"{math.degrees(case.tilt):+.1f}".replace("-", "−")
        parts.append(f"{angle} degrees: {ccw} counter-clockwise and {cw} clockwise vortices")
    return f"{len(parts)} panels of airspeed with streamlines. {'; '.join(parts)}."


def draw(table: Rows, look: Style) -> Figure:
    """One colour scale for all panels."""
    names = distinct(table["panel"])
    across = min(ACROSS, len(names))
    down = -(-len(names) // across)
    figure, axes = flow_panel.sheet(table, look, down, across)
    figure.set_figheight(figure.get_figheight() + LEGEND_IN)
    norm = Normalize(0, flow_panel.highest(table))
    shade: Any = None
    for ax in axes.ravel()[len(names) :]:
        ax.set_axis_off()
    for letter, name, ax in zip("abcdefghijkl", names, axes.ravel(), strict=False):
        mine = where(table, panel=name)
        shade = flow_panel.field(ax, mine, flow_panel.speeds(), norm)
        flow_panel.outline(ax, mine)
        for turns, fill in ((1, flow_panel.ZONE), (-1, "white")):
            core = where(mine, kind="vortex", flag=turns)
            x, y = core["x_hat"], core["y_hat"]
            circles(ax, x, y, "black", markerfacecolor=fill, markersize=4.2, zorder=6)
        ax.set_title(f"{letter}) {mine['label'][0]}")
    figure.colorbar(shade, ax=axes.ravel().tolist(), label="airspeed (m/s)", pad=0.01, aspect=30)
    vortices = [
        Line2D(
            [],
            [],
            linestyle="none",
            marker="o",
            color="black",
            markersize=4.2,
            markerfacecolor=fill,
            label=f"{sense} vortex",
        )
        for sense, fill in (("counter-clockwise", flow_panel.ZONE), ("clockwise", "white"))
    ]
    handles = [
        *vortices,
        Line2D([], [], color=flow_panel.ZONE, linewidth=1.1, label="stagnation zone"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


FIGURE = FigureSpec(
    name="fig5",
    title="Wake over a tilted ground",
    needs=(FLOW_FIELDS, FLOW_TOPOLOGY, FLOW),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
