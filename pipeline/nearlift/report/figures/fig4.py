"""Figure 4: change of airspeed from the control, nearer and nearer to the boundary; a row and a
diverging colour scale per boundary.
"""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from nearlift.campaign.piv import PivCase
from nearlift.flow.field import VelocityField, difference
from nearlift.report.evidence import Evidence, frame, groups, pick
from nearlift.report.figures import flow_panels, style
from nearlift.report.figures.flow_panels import field_rows, manifest, origin, title
from nearlift.report.figures.spec import FigureSpec
from nearlift.stages.flow import FLOW, FLOW_FIELDS

#: Cases with a smaller tilt are untilted, rad.
LEVEL_RAD = 1e-3
ROWS = ("ceiling", "ground")


def cases(evidence: Evidence) -> list[PivCase]:
    """Untilted cases near a boundary, ceiling first, farthest first."""
    piv = manifest(evidence)
    untilted = [c for c in piv.case if c.boundary in ROWS and abs(c.tilt) < LEVEL_RAD]
    return sorted(untilted, key=lambda c: (ROWS.index(c.boundary), -(c.z_hat or 0.0)))


def _mean(evidence: Evidence, name: str) -> VelocityField:
    """The mean field of one case."""
    nodes = evidence.frame(FLOW_FIELDS, case=name)
    x, y = np.unique(nodes["x_m"]), np.unique(nodes["y_m"])
    vx, vy = (nodes[v].to_numpy().reshape(len(y), len(x)) for v in ("vx_m_s", "vy_m_s"))
    return VelocityField(x_m=x, y_m=y, vx_m_s=vx, vy_m_s=vy)


def table(evidence: Evidence) -> pd.DataFrame:
    """Rows as in Figure 3's upper panels; `value_m_s` is airspeed less the control's, nan where
    either has no vector. Empty where no case lies near a boundary.
    """
    parts = []
    control = _mean(evidence, manifest(evidence).control)
    for case in cases(evidence):
        less = difference(_mean(evidence, case.name), control).ravel()
        parts += field_rows(evidence, case, title(case), less)
    return frame(parts, flow_panels.COLUMNS)


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption."""
    return (
        "Change of time-averaged airspeed from the control (blue: slower, red: faster), with the"
        " streamlines of each case. Upper row: ceiling. Lower row: ground. Nearer from left to"
        " right. One colour scale for each row. Grey: no vectors in the case or in the control."
        " Outline: stagnation zone, slower than 0.3 of the control's downwash on the ground beneath"
        f" the rotors' inner halves. {origin(evidence, [c.name for c in cases(evidence)])}"
    )


def draw(table: pd.DataFrame) -> Figure:
    """Panels in the order of the table, broken into rows where the boundary changes."""
    panels = groups(pick(table, kind="node"), "panel", "label")
    lines = [
        [panel for panel in panels if panel[1].startswith(boundary)]
        for boundary in dict.fromkeys(label.split(",")[0] for _, label in panels)
    ]
    figure, axes = flow_panels.sheet(table, len(lines), max(map(len, lines)))
    used = [ax for line, places in zip(lines, axes, strict=True) for ax in places[: len(line)]]
    style.title(used, [label for _, label in panels])
    for line, places in zip(lines, axes, strict=True):
        names = [name for name, _ in line]
        mine = table[(table["kind"] == "node") & table["panel"].isin(names)]
        top = float(mine["value_m_s"].abs().quantile(0.995))
        norm, colours = Normalize(-top, top), matplotlib.colormaps["RdBu_r"]
        shade: Any = None
        for ax in places[len(line) :]:
            ax.set_axis_off()
        for name, ax in zip(names, places, strict=False):
            shade = flow_panels.field(ax, pick(table, panel=name), norm, colours, 0.35, 0.5)
        figure.colorbar(
            shade, ax=places.tolist(), extend="both", pad=0.01, aspect=14,
            label="airspeed change from\ncontrol (m/s)",
        )  # fmt: skip
    return figure


FIGURE = FigureSpec(
    "fig4", "Change of airspeed from the control", (FLOW_FIELDS, FLOW), table, caption, draw,
    "value_m_s",
)  # fmt: skip
