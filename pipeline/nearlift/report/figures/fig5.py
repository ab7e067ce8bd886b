"""Figure 5: the wake over a tilted ground: airspeed, streamlines, vortex cores and the outline of
the stagnation zone, three panels to a row.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from nearlift.campaign.piv import PivCase
from nearlift.report.evidence import Evidence, Part, frame, groups, pick
from nearlift.report.figures import flow_panels, style
from nearlift.report.figures.fig4 import LEVEL_RAD
from nearlift.report.figures.flow_panels import ZONE, field_rows, manifest, origin
from nearlift.report.figures.spec import FigureSpec
from nearlift.rounding import fixed
from nearlift.stages.flow import FLOW, FLOW_FIELDS, FLOW_TOPOLOGY

ACROSS = 3
#: Vortices by the sign of their rotation: face and name.
VORTICES = {1.0: (ZONE, "counter-clockwise vortex"), -1.0: ("white", "clockwise vortex")}


def cases(evidence: Evidence) -> list[PivCase]:
    """Tilted ground cases from the most positive to the most negative tilt."""
    ground = [c for c in manifest(evidence).case if c.boundary == "ground"]
    return sorted((c for c in ground if abs(c.tilt) >= LEVEL_RAD), key=lambda c: -c.tilt)


def table(evidence: Evidence) -> pd.DataFrame:
    """Rows as in Figure 3's upper panels; `vortex` rows carry the sign of rotation in `flag`. Empty
    without tilted cases.
    """
    r = evidence.campaign.vehicle.rotor_radius
    parts = []
    for case in cases(evidence):
        label = f"$\\theta = {math.degrees(case.tilt):+.1f}^\\circ$"
        parts += field_rows(evidence, case, label)
        for vortex in evidence.document(FLOW)["cases"][case.name]["vortices"]:
            core = {"x_hat": vortex["x_m"] / r, "y_hat": vortex["y_m"] / r}
            turns = float(np.sign(vortex["circulation_m2_s"]))
            parts.append({"panel": case.name, "kind": "vortex", **core, "flag": turns})
    return frame(parts, flow_panels.COLUMNS)


def topology(evidence: Evidence, case: str) -> Part:
    """Row of flow_topology.parquet of one case."""
    [row] = evidence.frame(FLOW_TOPOLOGY, case=case).to_dict("records")
    return {str(column): value for column, value in row.items()}


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption, with the area of the stagnation zone at each tilt."""
    names = [c.name for c in cases(evidence)]
    areas = [fixed(topology(evidence, n)["stagnation_area_hat2"], 2) for n in names]
    tilts = [f"{math.degrees(c.tilt):+.1f}°".replace("-", "−") for c in cases(evidence)]
    return (
        "Time-averaged airspeed and streamlines over a tilted ground. θ > 0 where the ground falls"
        " away to the right. Circles: standing vortices (|Γ₂| > 2/π and |Γ₁| > 0.5), filled where"
        " they turn counter-clockwise. Outline: stagnation zone, air slower than 0.3 of the"
        " control's downwash on the ground beneath the rotors' inner halves. Its area for"
        f" {', '.join(tilts)} is {', '.join(areas)} r². {origin(evidence, names)}"
    )


def draw(table: pd.DataFrame) -> Figure:
    """One colour scale for all panels."""
    panels = groups(pick(table, kind="node"), "panel", "label")
    across = min(ACROSS, len(panels))
    figure, axes = flow_panels.sheet(table, -(-len(panels) // across), across, 0.7)
    style.title(axes.flat, [label for _, label in panels])
    norm: Any = flow_panels.highest(table)
    shade: Any = None
    for ax in axes.flat[len(panels) :]:
        ax.set_axis_off()
    mark: Part = {"marker": "o", "color": "black", "linestyle": "none", "markersize": 4.2}
    for (name, _), ax in zip(panels, axes.flat, strict=False):
        mine = pick(table, panel=name)
        shade = flow_panels.field(ax, mine, norm)
        for turns, (face, _) in VORTICES.items():
            core = pick(mine, kind="vortex", flag=turns)
            ax.plot(
                core.x_hat, core.y_hat, markerfacecolor=face, markeredgewidth=0.8, zorder=6, **mark
            )
    figure.colorbar(shade, ax=axes.ravel().tolist(), label="airspeed (m/s)", pad=0.01, aspect=30)
    handles = [
        Line2D([], [], markerfacecolor=face, label=name, **mark) for face, name in VORTICES.values()
    ]
    handles.append(Line2D([], [], color=ZONE, linewidth=1.1, label="stagnation zone"))
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


FIGURE = FigureSpec(
    "fig5", "Wake over a tilted ground", (FLOW_FIELDS, FLOW_TOPOLOGY, FLOW), table, caption, draw,
    "value_m_s",
)  # fmt: skip
