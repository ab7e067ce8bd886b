"""Mean flow fields over rotor radius: nodes, rotors, boundary, vortices and the cut as rows, and as
colour and streamlines on an axis.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from nearlift.campaign.piv import Piv, PivCase
from nearlift.declare import FloatArray
from nearlift.flow.downwash import NOT_AT_THE_DISK
from nearlift.flow.field import Scene
from nearlift.report.evidence import Evidence, Rows, single, where
from nearlift.report.figures.style import SERIES, Style
from nearlift.rounding import fixed
from nearlift.stages.flow import DOWNWASH, DOWNWASH_PROFILE, FLOW, FLOW_FIELDS

#: Columns of a field's table; only nodes have them all.
COLUMNS = (
    *("panel", "kind", "label"),
    *("x_hat", "y_hat", "vx_m_s", "vy_m_s", "value_m_s", "u_value_m_s", "flag"),
)
X, Y = r"$x / r$", r"$y / r$"
UNOBSERVED = "0.80"
LINES = "0.10"
#: Colour of stagnation zones.
ZONE = SERIES[1][0]


def manifest(evidence: Evidence) -> Piv:
    """[piv]; the figures that ask for it are made only where its products exist."""
    assert evidence.campaign.piv is not None
    return evidence.campaign.piv


def title(case: PivCase, tilted: bool = False) -> str:
    """Title of a panel."""
    if tilted:
        return f"$\\theta = {math.degrees(case.tilt):+.1f}^\\circ$"
    return "control" if case.z_hat is None else f"{case.boundary}, $\\hat{{z}} = {case.z_hat:g}$"


def field_rows(
    evidence: Evidence, case: PivCase, label: str, value: FloatArray | None = None
) -> list[dict[str, object]]:
    """One panel: its nodes coloured by speed (or by `value`), its rotors and its boundary."""
    r = evidence.campaign.vehicle.rotor_radius
    flow = where(evidence.table(FLOW_FIELDS), case=case.name)
    vx, vy = flow["vx_m_s"], flow["vy_m_s"]
    rotors = tuple(manifest(evidence).setting(case, "rotors"))
    parts: list[dict[str, object]] = [
        {
            "kind": "node",
            "x_hat": flow["x_m"] / r,
            "y_hat": flow["y_m"] / r,
            "vx_m_s": vx,
            "vy_m_s": vy,
            "value_m_s": np.hypot(vx, vy) if value is None else value,
            "flag": flow["stagnant"],
        }
    ]
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
        parts.append(
            {
                "kind": "boundary",
                "x_hat": ends / r,
                "y_hat": place.boundary_y_m(ends) / r,
                "flag": 1.0 if case.boundary == "ground" else -1.0,
            }
        )
    return [{"panel": case.name, "label": label, **part} for part in parts]


def profile_rows(evidence: Evidence, name: str, panel: str, kind: str) -> dict[str, object]:
    """The cut of one case; `flag` is 1 where it was mirrored."""
    profile = where(evidence.table(DOWNWASH_PROFILE), case=name)
    return {
        "panel": panel,
        "kind": kind,
        "label": name,
        "x_hat": profile["x_m"] / evidence.campaign.vehicle.rotor_radius,
        "value_m_s": profile["downwash_m_s"],
        "u_value_m_s": profile["u_downwash_m_s"],
        "flag": profile["mirrored"],
    }


def cut(evidence: Evidence, name: str, rotor: str = "all") -> dict[str, Any]:
    """The row of downwash.parquet of one case."""
    table = evidence.table(DOWNWASH)
    return single(table, (table["case"] == name) & (table["rotor"] == rotor))


def reduction_text(row: dict[str, Any]) -> str:
    """``8.7 % (90 %: 3.4 to 13.9)``, and where that does not speak of the disk, so; a dash where
    the cut has no vectors.
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
    every = evidence.document(FLOW)["cases"]
    facts = {name: every[name] for name in shown}
    counts = sorted({int(f["fields"]) for f in facts.values()})
    number = str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    said = (
        f"{'SIMULATED fields, no measurement. ' if evidence.campaign.simulated else ''}Each panel"
        f" is the mean of {number} velocity fields"
    )
    reflected = [n for n, f in facts.items() if f["mirrored"]]
    if reflected:
        share = "all" if len(reflected) == len(facts) else f"{len(reflected)} of {len(facts)}"
        said += f"; in {share} cases one half was measured and the other is its reflection"
    return said + "."


def speeds() -> Colormap:
    """Light to blue, without the darkest end, so that black streamlines show everywhere."""
    base = matplotlib.colormaps["YlGnBu"]
    return LinearSegmentedColormap.from_list("speeds", base(np.linspace(0.0, 0.78, 128)))


def grid(node: Rows, name: str) -> tuple[Any, Any, Any]:
    """Axes and a masked map of one column of nodes; the axes are exactly even, as streamlines want
    them.
    """
    x, y = np.unique(node["x_hat"]), np.unique(node["y_hat"])
    values = np.ma.masked_invalid(np.asarray(node[name], dtype=float).reshape(len(y), len(x)))
    return np.linspace(x[0], x[-1], len(x)), np.linspace(y[0], y[-1], len(y)), values


def limits(table: Rows) -> tuple[tuple[float, float], tuple[float, float]]:
    """Common limits of all panels: the nodes, and a quarter of a radius below them for the
    boundary.
    """
    node = where(table, kind="node")
    x, y = node["x_hat"], node["y_hat"]
    return (x.min(), x.max()), (y.min() - 0.25, y.max() + 0.1)


def sheet(table: Rows, look: Style, down: int, across: int) -> tuple[Figure, Any]:
    """Panels in rows and columns over the whole width, all with the same limits; the axes that they
    share are labelled at its edges.
    """
    (x0, x1), (y0, y1) = limits(table)
    tall = (look.double_in - 0.95) / across * (y1 - y0) / (x1 - x0)
    height = min(down * (tall + 0.25) + 0.35, look.height_in)
    figure = Figure(figsize=(look.double_in, height), layout="constrained")
    axes = figure.subplots(down, across, squeeze=False, sharex=True, sharey=True)
    axes[0, 0].set(xlim=(x0, x1), ylim=(y0, y1))
    for ax in axes[:, 0]:
        ax.set_ylabel(Y)
    for ax in axes[-1]:
        ax.set_xlabel(X)
    return figure, axes


def field(
    ax: Axes,
    rows: Rows,
    cmap: Colormap,
    norm: Normalize,
    line_pt: float = 0.45,
    density: float = 0.6,
) -> Any:
    """Draw one panel and hand back what a colour bar needs."""
    node = where(rows, kind="node")
    x, y, value = grid(node, "value_m_s")
    ax.set_facecolor(UNOBSERVED)
    wide, high = (x[1] - x[0]) / 2, (y[1] - y[0]) / 2
    ends = (x[0] - wide, x[-1] + wide, y[0] - high, y[-1] + high)
    shade = ax.imshow(
        value, cmap=cmap, norm=norm, extent=ends, origin="lower", interpolation="nearest", zorder=0
    )
    _, _, vx = grid(node, "vx_m_s")
    _, _, vy = grid(node, "vy_m_s")
    stream = ax.streamplot(
        x, y, vx, vy, color=LINES, linewidth=line_pt, density=density, num_arrows=0, zorder=2
    )
    _heads(ax, stream.lines.get_segments())
    for end in pairs(where(rows, kind="rotor")):
        ax.plot(*end, color="black", linewidth=2.0, solid_capstyle="butt", zorder=4)
    wall = where(rows, kind="boundary")
    if len(wall["x_hat"]):
        outside = -50.0 if wall["flag"][0] > 0 else 50.0
        ax.fill_between(
            wall["x_hat"],
            wall["y_hat"],
            outside,
            facecolor="white",
            edgecolor="0.55",
            hatch="/////",
            linewidth=0,
            zorder=3,
        )
        ax.plot(wall["x_hat"], wall["y_hat"], color="black", linewidth=1.0, zorder=3.5)
    ax.set_aspect("equal")
    ax.xaxis.set_major_locator(MultipleLocator(2))
    ax.yaxis.set_major_locator(MultipleLocator(1))
    return shade


def outline(ax: Axes, rows: Rows) -> None:
    """Outline of the stagnation zone of one panel."""
    x, y, zone = grid(where(rows, kind="node"), "flag")
    if zone.max() > 0:
        ax.contour(x, y, zone.filled(0), levels=[0.5], colors=[ZONE], linewidths=1.1, zorder=5)


def _heads(ax: Axes, lines: Sequence[Any]) -> None:
    """An arrow head on the middle of each line, all as one artist."""
    middle = np.array([line[len(line) // 2 - 1 : len(line) // 2 + 1] for line in lines])
    if not len(middle):
        return
    along = middle[:, 1] - middle[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])
    seen = length > 0
    ax.quiver(
        *middle[seen, 0].T,
        *(along[seen] / length[seen, None]).T,
        angles="xy",
        scale_units="inches",
        scale=18,
        pivot="mid",
        color=LINES,
        zorder=2.1,
        units="inches",
        width=0.009,
        headwidth=4.5,
        headlength=5,
        headaxislength=5,
        minlength=0,
    )


def pairs(rows: Rows) -> list[tuple[Any, Any]]:
    """Line segments from rows that come two by two."""
    return [
        (rows["x_hat"][i : i + 2], rows["y_hat"][i : i + 2])
        for i in range(0, len(rows["x_hat"]), 2)
    ]


def highest(table: Rows) -> float:
    """Upper end of a colour scale of speeds: the fastest but a thousandth of all nodes."""
    return float(np.nanquantile(where(table, kind="node")["value_m_s"], 0.999))
