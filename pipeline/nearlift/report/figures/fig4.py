"""Figure 4: change of airspeed from the control, nearer and nearer to the boundary; a row and a
diverging colour scale per boundary.
"""

from __future__ import annotations

from typing import Any

import matplotlib
import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from nearlift.campaign.piv import PivCase
from nearlift.flow.field import VelocityField, difference
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, stack, where
from nearlift.report.figures import flow_panels as flow_panel
from nearlift.report.figures.flow_panels import field_rows, manifest, origin, title
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import Style
from nearlift.rounding import plain
from nearlift.stages.flow import FLOW, FLOW_FIELDS

LEVEL = 1e-3
ROWS = ("ceiling", "ground")


def cases(evidence: Evidence) -> list[PivCase]:
    """Untilted cases near a boundary, ceiling first, farthest first."""
    piv = manifest(evidence)
    untilted = [c for c in piv.case if c.boundary in ROWS and abs(c.tilt) < LEVEL]
    return sorted(untilted, key=lambda c: (ROWS.index(c.boundary), -(c.z_hat or 0.0)))


def as_field(evidence: Evidence, name: str) -> VelocityField:
    """The mean field of one case."""
    table = where(evidence.table(FLOW_FIELDS), case=name)
    x, y = np.unique(table["x_m"]), np.unique(table["y_m"])
    vx, vy = (table[name].reshape(len(y), len(x)) for name in ("vx_m_s", "vy_m_s"))
    return VelocityField(x_m=x, y_m=y, vx_m_s=vx, vy_m_s=vy)


def summarise(evidence: Evidence) -> Columns:
    """Rows as in Figure 3's upper panels; `value_m_s` is airspeed less the control's, nan where
    either has no vector. Empty where no case lies near a boundary.
    """
    parts = []
    control = as_field(evidence, manifest(evidence).control)
    for case in cases(evidence):
        less = difference(as_field(evidence, case.name), control).ravel()
        parts += field_rows(evidence, case, title(case), less)
    return stack(parts, flow_panel.COLUMNS)


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption."""
    return (
        "Change of time-averaged airspeed from the control (blue: slower, red: faster), with the"
        " streamlines of each case. Upper row: ceiling. Lower row: ground. Nearer from left to"
        " right. One colour scale for each row. Grey: no vectors in the case or in the control."
        " Outline: stagnation zone, slower than 0.3 of the control's downwash on the ground beneath"
        f" the rotors' inner halves. {origin(evidence, [c.name for c in cases(evidence)])}"
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """Text alternative of the figure."""
    parts = []
    for case in cases(evidence):
        value = where(table, panel=case.name, kind="node")["value_m_s"]
        low, high = (plain(float(end), 2) for end in (np.nanmin(value), np.nanmax(value)))
        parts.append(f"{case.boundary} {plain(case.z_hat or 0.0, 3)}: {low} to {high} m/s")
    return (
        "Maps of the change of airspeed from the control. Range at each distance over rotor radius:"
        f" {'; '.join(parts)}."
    )


def draw(table: Rows, look: Style) -> Figure:
    """Panels in the order of the table, broken into rows where the boundary changes."""
    labels = dict(distinct(table["panel"], table["label"]))
    lines = [
        [name for name, label in labels.items() if label.startswith(boundary)]
        for boundary in dict.fromkeys(label.split(",")[0] for label in labels.values())
    ]
    across = max(len(line) for line in lines)
    figure, axes = flow_panel.sheet(table, look, len(lines), across)
    letters = iter("abcdefghijklmnopqrstuvwxyz")
    for line, places in zip(lines, axes, strict=True):
        shade: Any = None
        mine = (table["kind"] == "node") & np.isin(table["panel"], line)
        top = float(np.nanquantile(np.abs(table["value_m_s"][mine]), 0.995))
        norm = Normalize(-top, top)
        for ax in places[len(line) :]:
            ax.set_axis_off()
        for name, ax in zip(line, places, strict=False):
            rows, colours = where(table, panel=name), matplotlib.colormaps["RdBu_r"]
            shade = flow_panel.field(ax, rows, colours, norm, line_pt=0.35, density=0.5)
            flow_panel.outline(ax, rows)
            ax.set_title(f"{next(letters)}) {labels[name]}")
        words, beside = "airspeed change from\ncontrol (m/s)", places.tolist()
        figure.colorbar(shade, ax=beside, label=words, pad=0.01, aspect=14, extend="both")
    return figure


FIGURE = FigureSpec(
    name="fig4",
    title="Change of airspeed from the control",
    needs=(FLOW_FIELDS, FLOW),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
