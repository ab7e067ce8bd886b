"""Figure 3: mean airspeed and streamlines for the control, a ground and a ceiling; beneath each,
the downwash along the cut.
"""

from __future__ import annotations

from string import ascii_lowercase
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from nearlift.campaign.piv import Piv, PivCase
from nearlift.likelihood import student
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, stack, where
from nearlift.report.figures import flow_panels as flow_panel
from nearlift.report.figures.flow_panels import cut, manifest, profile_rows
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import SERIES, Style
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


def summarise(evidence: Evidence) -> Columns:
    """Rows by `kind`: node, rotor, boundary (upper panels); profile, control, span, cut (lower
    panels). Lengths over rotor radius.
    """
    piv, r = manifest(evidence), evidence.campaign.vehicle.rotor_radius
    parts = []
    for case in columns(piv):
        row = cut(evidence, case.name)
        parts += flow_panel.field_rows(evidence, case, flow_panel.title(case))
        parts.append(profile_rows(evidence, case.name, case.name, "profile"))
        if case.name != piv.control:
            parts.append(profile_rows(evidence, piv.control, case.name, "control"))
        for centre in piv.setting(case, "rotors"):
            ends = (np.array([-1.0, 1.0]) * row["half_span_m"] + centre) / r
            height = -row["below_m"] / r
            parts.append({"panel": case.name, "kind": "span", "x_hat": ends, "y_hat": height})
    return stack(parts, flow_panel.COLUMNS)


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption, numbers included."""
    piv, r = manifest(evidence), evidence.campaign.vehicle.rotor_radius
    cases = columns(piv)
    first = cut(evidence, piv.control)
    text = (
        "Time-averaged airspeed (colour) and streamlines. Thrust points up, also where the vehicle"
        " was inverted. Grey: no vectors."
        f" {flow_panel.origin(evidence, [c.name for c in cases])} Below: downwash along the dashed"
        f" cut, {plain(first['below_m'] / r, 3)} rotor radii below the rotor plane, with its 90 %"
        " band. Dotted: the control. Shade: the averaged span. Control:"
        f" {fixed(first['downwash_m_s'], 2)} m/s."
    )
    reduced = [
        f"{c.boundary.capitalize()} at ẑ = {plain(c.z_hat or 0.0, 3)}: reduced by"
        f" {flow_panel.reduction_text(cut(evidence, c.name))}."
        for c in cases
        if c.name != piv.control
    ]
    return " ".join([text, *reduced])


def alt(evidence: Evidence, table: Columns) -> str:
    """Description for screen readers."""
    named = [
        f"{c.name}, downwash {plain(cut(evidence, c.name)['downwash_m_s'], 3)} m/s"
        for c in columns(manifest(evidence))
    ]
    return (
        f"{len(named)} panels of airspeed with streamlines, and beneath each the downwash along a"
        f" cut: {'; '.join(named)}."
    )


def draw(table: Rows, look: Style) -> Figure:
    """One colour scale for all fields, one velocity axis for all cross-sections."""
    names = distinct(table["panel"])
    (x0, x1), (y0, y1) = flow_panel.limits(table)
    n = len(names)
    width = look.double_in if n > 1 else look.single_in
    tall = (width - 0.9) / n * (y1 - y0) / (x1 - x0)
    figure = Figure(figsize=(width, tall + 0.45 * tall + 1.05), layout="constrained")
    axes = figure.subplots(2, n, squeeze=False, sharex=True, sharey="row", height_ratios=(1.0, 0.5))
    norm = Normalize(0, flow_panel.highest(table))
    shade: Any = None
    letters = zip(ascii_lowercase, ascii_lowercase[n:], names, axes[0], axes[1], strict=False)
    for letter, below, name, upper, lower in letters:
        mine = where(table, panel=name)
        shade = flow_panel.field(upper, mine, flow_panel.speeds(), norm)
        for x, y in flow_panel.pairs(where(mine, kind="span")):
            upper.plot(x, y, color="black", linewidth=0.9, linestyle=(0, (3, 1.5)), zorder=5)
        upper.set_xlim(x0, x1)
        upper.set_ylim(y0, y1)
        upper.set_title(f"{letter}) {mine['label'][0]}")
        _section(lower, mine)
        lower.set_title(f"{below}) along the cut")
        lower.set_xlabel(flow_panel.X)
    axes[0, 0].set_ylabel(flow_panel.Y)
    axes[1, 0].set_ylabel("downwash (m/s)")
    figure.colorbar(shade, ax=axes[0].tolist(), label="airspeed (m/s)", pad=0.01, aspect=18)
    return figure


def _section(ax: Axes, mine: Rows) -> None:
    for x, _ in flow_panel.pairs(where(mine, kind="span")):
        ax.axvspan(x[0], x[1], color="0.92", linewidth=0, zorder=0)
    ax.axhline(0, color="0.6", linewidth=0.5, zorder=1)
    control, profile = where(mine, kind="control"), where(mine, kind="profile")
    x, value, dotted = control["x_hat"], control["value_m_s"], (0, (1, 1.2))
    ax.plot(x, value, color="0.35", linestyle=dotted, linewidth=0.9, zorder=2)
    colour, x, value = SERIES[0][0], profile["x_hat"], profile["value_m_s"]
    reach = student.NORMAL_90 * profile["u_value_m_s"]
    ax.fill_between(x, value - reach, value + reach, color=colour, alpha=0.3, linewidth=0)
    measured = np.where(profile["flag"] > 0, np.nan, value)
    ax.plot(x, value, color=colour, linewidth=0.6, zorder=3)
    ax.plot(x, measured, color=colour, linewidth=1.3, zorder=3)
    ax.xaxis.set_major_locator(MultipleLocator(2))


FIGURE = FigureSpec(
    name="fig3",
    title="Flow near ground and ceiling",
    needs=(DOWNWASH, DOWNWASH_PROFILE, FLOW_FIELDS, FLOW),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
)
