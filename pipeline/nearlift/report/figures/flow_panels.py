"""Mean flow fields over rotor radius: nodes, rotors, boundary, vortices and the cut as rows, and as
colour and streamlines on an axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from nearlift.campaign.piv import Piv, PivCase
from nearlift.declare import FloatArray
from nearlift.flow.downwash import NOT_AT_THE_DISK
from nearlift.flow.field import Scene
from nearlift.report.evidence import Evidence, Part, pick
from nearlift.report.figures import style
from nearlift.report.figures.style import SERIES
from nearlift.rounding import fixed
from nearlift.stages.flow import DOWNWASH, DOWNWASH_PROFILE, FLOW, FLOW_FIELDS

#: Columns of a field's table; only nodes have them all.
COLUMNS = (
    *("panel", "kind", "label"),
    *("x_hat", "y_hat", "vx_m_s", "vy_m_s", "value_m_s", "u_value_m_s", "flag"),
)
X, Y = r"$x / r$", r"$y / r$"
UNOBSERVED, LINES = "0.80", "0.10"
#: Colour of stagnation zones.
ZONE = SERIES[1][0]
#: Light to blue, without the darkest end, so that black streamlines show everywhere.
SPEEDS = LinearSegmentedColormap.from_list(
    "speeds", matplotlib.colormaps["YlGnBu"](np.linspace(0.0, 0.78, 128))
)


def manifest(evidence: Evidence) -> Piv:
    """[piv]; the figures that ask for it are made only where its products exist."""
    assert evidence.campaign.piv is not None
    return evidence.campaign.piv


def title(case: PivCase) -> str:
    """Title of a panel."""
    return "control" if case.z_hat is None else f"{case.boundary}, $\\hat{{z}} = {case.z_hat:g}$"


def field_rows(
    evidence: Evidence, case: PivCase, label: str, value: FloatArray | None = None
) -> list[Part]:
    """One panel: its nodes coloured by speed (or by `value`), its rotors and its boundary."""
    r = evidence.campaign.vehicle.rotor_radius
    flow = evidence.frame(FLOW_FIELDS, case=case.name)
    rotors = tuple(manifest(evidence).setting(case, "rotors"))
    node: Part = {"x_hat": flow["x_m"] / r, "y_hat": flow["y_m"] / r, "flag": flow["stagnant"]}
    node |= {"vx_m_s": flow["vx_m_s"], "vy_m_s": flow["vy_m_s"], "value_m_s": value}
    if value is None:
        node["value_m_s"] = np.hypot(flow["vx_m_s"], flow["vy_m_s"])
    parts: list[Part] = [{"kind": "node", **node}]
    parts += [{"kind": "rotor", "x_hat": [c / r - 1, c / r + 1], "y_hat": 0.0} for c in rotors]
    if case.boundary != "none":
        ends = np.array([flow["x_m"].min() - 2 * r, flow["x_m"].max() + 2 * r])
        place = Scene(
            boundary=case.boundary,
            distance_m=math.inf if case.z_hat is None else case.z_hat * r,
            tilt_rad=case.tilt,
            rotors_m=rotors,
            radius_m=r,
        )
        line = {"x_hat": ends / r, "y_hat": place.boundary_y_m(ends) / r}
        parts.append({"kind": "boundary", **line, "flag": 1 if case.boundary == "ground" else -1})
    return [{"panel": case.name, "label": label, **part} for part in parts]


def profile_rows(evidence: Evidence, name: str, panel: str, kind: str) -> Part:
    """The cut of one case; `flag` is 1 where it was mirrored."""
    profile = evidence.frame(DOWNWASH_PROFILE, case=name)
    return {
        "panel": panel,
        "kind": kind,
        "label": name,
        "x_hat": profile["x_m"] / evidence.campaign.vehicle.rotor_radius,
        "value_m_s": profile["downwash_m_s"],
        "u_value_m_s": profile["u_downwash_m_s"],
        "flag": profile["mirrored"],
    }


def cut(evidence: Evidence, name: str) -> Part:
    """The row of downwash.parquet of one case."""
    [row] = evidence.frame(DOWNWASH, case=name, rotor="all").to_dict("records")
    return {str(column): value for column, value in row.items()}


def reduction_text(row: Part) -> str:
    """``8.7 % (90 %: 3.4 to 13.9)``, and where that is not at the disk, a note; a dash where the
    cut has no vectors.
    """
    if not math.isfinite(row["reduction"]):
        return "–"
    ends = ("reduction", "reduction_lo90", "reduction_hi90")
    middle, low, high = (fixed(100 * row[end], 1) for end in ends)
    interval = f" (90 %: {low} to {high})" if math.isfinite(row["reduction_lo90"]) else ""
    elsewhere = set(row["warnings"].split()) & set(NOT_AT_THE_DISK)
    return f"{middle} %{interval}{', not the inflow at the disk' if elsewhere else ''}"


def origin(evidence: Evidence, shown: Iterable[str]) -> str:
    """Origin of the fields for captions: simulated or measured, their number, mirrored ones."""
    cases = [evidence.document(FLOW)["cases"][name] for name in shown]
    counts = sorted({int(case["fields"]) for case in cases})
    number = " to ".join(dict.fromkeys(str(end) for end in (counts[0], counts[-1])))
    simulated = "SIMULATED fields, no measurement. " if evidence.campaign.simulated else ""
    said = f"{simulated}Each panel is the mean of {number} velocity fields"
    reflected = sum(bool(case["mirrored"]) for case in cases)
    if reflected:
        share = "all" if reflected == len(cases) else f"{reflected} of {len(cases)}"
        said += f"; in {share} cases one half was measured and the other is its reflection"
    return said + "."


def highest(table: pd.DataFrame) -> Normalize:
    """Scale of speeds up to the fastest but a thousandth of all nodes."""
    return Normalize(0, float(pick(table, kind="node")["value_m_s"].quantile(0.999)))


def limits(table: pd.DataFrame) -> tuple[tuple[float, float], tuple[float, float]]:
    """Common limits of all panels: the nodes, and a quarter of a radius below them for the
    boundary.
    """
    node = pick(table, kind="node")
    x, y = node["x_hat"], node["y_hat"]
    return (x.min(), x.max()), (y.min() - 0.25, y.max() + 0.1)


def sheet(table: pd.DataFrame, down: int, across: int, more_in: float = 0.35) -> tuple[Figure, Any]:
    """Panels in rows and columns over the whole width, all with the same limits; the axes that they
    share are labelled at its edges.
    """
    (x0, x1), (y0, y1) = limits(table)
    tall = (style.DOUBLE_IN - 0.95) / across * (y1 - y0) / (x1 - x0)
    height = down * (tall + 0.25) + more_in
    figure, axes = style.canvas(down, across, height, style.DOUBLE_IN, sharex=True, sharey=True)
    axes[0, 0].set(xlim=(x0, x1), ylim=(y0, y1))
    for ax in axes[:, 0]:
        ax.set_ylabel(Y)
    for ax in axes[-1]:
        ax.set_xlabel(X)
    return figure, axes


def field(
    ax: Axes,
    rows: pd.DataFrame,
    norm: Normalize,
    cmap: Colormap = SPEEDS,
    line_pt: float = 0.45,
    density: float = 0.6,
) -> Any:
    """Draw one panel with the outline of its stagnation zone; returns what a colour bar needs."""
    node, wall = pick(rows, kind="node"), pick(rows, kind="boundary")
    grid = node.pivot(index="y_hat", columns="x_hat")
    value, vx, vy, zone = (
        np.ma.masked_invalid(grid[name].to_numpy(dtype=float))
        for name in ("value_m_s", "vx_m_s", "vy_m_s", "flag")
    )
    # exactly even, as streamlines need them
    x, y = (
        np.linspace(node[name].min(), node[name].max(), n)
        for name, n in zip(("x_hat", "y_hat"), value.shape[::-1], strict=True)
    )
    wide, high = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    ax.set_facecolor(UNOBSERVED)
    shade = ax.imshow(
        value, cmap=cmap, norm=norm, origin="lower", interpolation="nearest", zorder=0,
        extent=(x[0] - wide, x[-1] + wide, y[0] - high, y[-1] + high),
    )  # fmt: skip
    stream = ax.streamplot(
        x, y, vx, vy, num_arrows=0, zorder=2, color=LINES, linewidth=line_pt, density=density
    )
    _heads(ax, stream.lines.get_segments())
    for end in pairs(pick(rows, kind="rotor")):
        ax.plot(*end, color="black", linewidth=2.0, solid_capstyle="butt", zorder=4)
    if len(wall):
        outside = -50.0 if wall["flag"].iloc[0] > 0 else 50.0
        ax.fill_between(
            wall.x_hat, wall.y_hat, outside, linewidth=0, zorder=3, facecolor="white",
            edgecolor="0.55", hatch="/////",
        )  # fmt: skip
        ax.plot(wall.x_hat, wall.y_hat, color="black", linewidth=1.0, zorder=3.5)
    if zone.max() > 0:
        ax.contour(x, y, zone.filled(0), levels=[0.5], colors=[ZONE], linewidths=1.1, zorder=5)
    ax.set_aspect("equal")
    ax.xaxis.set_major_locator(MultipleLocator(2))
    ax.yaxis.set_major_locator(MultipleLocator(1))
    return shade


def _heads(ax: Axes, lines: Iterable[Any]) -> None:
    """An arrow head on the middle of each line, all as one artist."""
    middle = np.array([line[len(line) // 2 - 1 : len(line) // 2 + 1] for line in lines])
    if not len(middle):
        return
    along = middle[:, 1] - middle[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])
    seen = length > 0
    ax.quiver(
        *middle[seen, 0].T, *(along[seen] / length[seen, None]).T, scale=18, width=0.009,
        pivot="mid", color=LINES, zorder=2.1, angles="xy", units="inches", scale_units="inches",
        headwidth=4.5, headlength=5, headaxislength=5, minlength=0,
    )  # fmt: skip


def pairs(rows: pd.DataFrame) -> list[tuple[Any, Any]]:
    """Line segments from rows that come two by two."""
    ends = (slice(i, i + 2) for i in range(0, len(rows), 2))
    return [(rows["x_hat"][end], rows["y_hat"][end]) for end in ends]
