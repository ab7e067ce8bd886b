"""Figure 3: mean airspeed and streamlines for the control, a ground and a ceiling; beneath each,
the downwash along the cut.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from nearlift.campaign.piv import Piv, PivCase
from nearlift.likelihood import student
from nearlift.report.evidence import Evidence, frame, pick
from nearlift.report.figures import flow_panels, style
from nearlift.report.figures.flow_panels import cut, manifest, profile_rows
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES
from nearlift.rounding import fixed, plain
from nearlift.stages.flow import DOWNWASH, DOWNWASH_PROFILE, FLOW, FLOW_FIELDS

#: Distances of the paper's Figure 3, taken where the manifest names no cases.
PAPER_Z_HAT = {"ground": 3.4, "ceiling": 2.0}


def columns(piv: Piv) -> list[PivCase]:
    """The cases of the figure: the manifest's, else the control and the untilted cases nearest to
    the paper's distances.
    """
    if piv.figure3:
        return [piv.named(n) for n in piv.figure3]
    cases = [piv.named(piv.control)]
    for boundary, wanted in PAPER_Z_HAT.items():
        near = [c for c in piv.case if c.boundary == boundary and c.z_hat is not None]
        if near:
            cases.append(min(near, key=lambda c: (abs(c.tilt), abs((c.z_hat or 0.0) - wanted))))
    return cases


def table(evidence: Evidence) -> pd.DataFrame:
    """Rows by `kind`: node, rotor, boundary (upper panels); profile, control, span, cut (lower
    panels). Lengths over rotor radius.
    """
    piv, r = manifest(evidence), evidence.campaign.vehicle.rotor_radius
    parts = []
    for case in columns(piv):
        row = cut(evidence, case.name)
        parts += flow_panels.field_rows(evidence, case, flow_panels.title(case))
        parts.append(profile_rows(evidence, case.name, case.name, "profile"))
        if case.name != piv.control:
            parts.append(profile_rows(evidence, piv.control, case.name, "control"))
        for centre in piv.setting(case, "rotors"):
            ends = (np.array([-1.0, 1.0]) * row["half_span_m"] + centre) / r
            height = -row["below_m"] / r
            parts.append({"panel": case.name, "kind": "span", "x_hat": ends, "y_hat": height})
    return frame(parts, flow_panels.COLUMNS)


def caption(evidence: Evidence, table: pd.DataFrame) -> str:
    """Caption, numbers included."""
    piv, r = manifest(evidence), evidence.campaign.vehicle.rotor_radius
    cases = columns(piv)
    first = cut(evidence, piv.control)
    text = (
        "Time-averaged airspeed (colour) and streamlines. Thrust points up, also where the vehicle"
        " was inverted. Grey: no vectors. Orange outline: stagnation zone."
        f" {flow_panels.origin(evidence, [c.name for c in cases])} Below: downwash along the dashed"
        f" cut, {plain(first['below_m'] / r, 3)} rotor radii below the rotor plane, with its 90 %"
        " band. Dotted: the control. Shade: the averaged span. Control:"
        f" {fixed(first['downwash_m_s'], 2)} m/s."
    )
    reduced = [
        f"{c.boundary.capitalize()} at ẑ = {plain(c.z_hat or 0.0, 3)}: reduced by"
        f" {flow_panels.reduction_text(cut(evidence, c.name))}."
        for c in cases
        if c.name != piv.control
    ]
    return " ".join([text, *reduced])


def draw(table: pd.DataFrame) -> Figure:
    """One colour scale for all fields, one velocity axis for all cross-sections."""
    names = list(table["panel"].unique())
    (x0, x1), (y0, y1) = flow_panels.limits(table)
    n = len(names)
    width = style.DOUBLE_IN if n > 1 else style.SINGLE_IN
    height = 1.45 * (width - 0.9) / n * (y1 - y0) / (x1 - x0) + 1.05
    figure, axes = style.canvas(
        2, n, height, width, sharex=True, sharey="row", height_ratios=(1.0, 0.5)
    )
    labels = [pick(table, panel=name, kind="node")["label"].iloc[0] for name in names]
    style.title(axes.flat, [*labels, *["along the cut"] * n])
    norm: Any = flow_panels.highest(table)
    shade: Any = None
    for name, upper, lower in zip(names, *axes, strict=True):
        mine = pick(table, panel=name)
        shade = flow_panels.field(upper, mine, norm)
        for x, y in flow_panels.pairs(pick(mine, kind="span")):
            upper.plot(x, y, color="black", linewidth=0.9, linestyle=(0, (3, 1.5)), zorder=5)
            lower.axvspan(*x, color="0.92", linewidth=0, zorder=0)
        upper.set(xlim=(x0, x1), ylim=(y0, y1))
        _section(lower, mine)
    axes[0, 0].set_ylabel(flow_panels.Y)
    axes[1, 0].set_ylabel("downwash (m/s)")
    figure.colorbar(shade, ax=axes[0].tolist(), label="airspeed (m/s)", pad=0.01, aspect=18)
    return figure


def _section(ax: Axes, mine: pd.DataFrame) -> None:
    style.zero(ax)
    control, profile = pick(mine, kind="control"), pick(mine, kind="profile")
    dotted = (0, (1, 1.2))
    ax.plot(
        control.x_hat, control.value_m_s, color="0.35", linestyle=dotted, linewidth=0.9, zorder=2
    )
    colour, value = SERIES[0][0], profile["value_m_s"]
    reach = student.NORMAL_90 * profile["u_value_m_s"]
    style.band(ax, profile.x_hat, value - reach, value + reach, colour, alpha=0.3)
    # what was mirrored is thin
    for y, width in ((value, 0.6), (value.mask(profile["flag"] > 0), 1.3)):
        ax.plot(profile.x_hat, y, color=colour, linewidth=width, zorder=3)
    ax.xaxis.set_major_locator(MultipleLocator(2))
    ax.set_xlabel(flow_panels.X)


FIGURE = FigureSpec(
    "fig3", "Flow near ground and ceiling", (DOWNWASH, DOWNWASH_PROFILE, FLOW_FIELDS, FLOW),
    table, caption, draw, "value_m_s", ("panel", "kind"),
)  # fmt: skip
