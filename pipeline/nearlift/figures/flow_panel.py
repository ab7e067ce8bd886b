"""One mean field on an axis: colour, streamlines, rotors, boundary. Lengths are over
rotor radius.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap, Normalize
from matplotlib.ticker import MultipleLocator

Rows = Mapping[str, Any]
UNOBSERVED = "0.80"
LINES = "0.10"


def speeds() -> Colormap:
    """Light to blue, without the darkest end, so that black streamlines show everywhere."""
    import matplotlib

    base = matplotlib.colormaps["YlGnBu"]
    return LinearSegmentedColormap.from_list("speeds", base(np.linspace(0.0, 0.78, 128)))


def select(table: Rows, rows: Any) -> dict[str, Any]:
    """The rows of a mask."""
    return {name: column[rows] for name, column in table.items()}


def panels(table: Rows) -> list[str]:
    """Names of the panels in order."""
    return list(dict.fromkeys(table["panel"].tolist()))


def grid(node: Rows, name: str) -> tuple[Any, Any, Any]:
    """Axes and a masked map of one column of nodes; the axes are exactly even, as streamlines want
    them.
    """
    x, y = np.unique(node["x_hat"]), np.unique(node["y_hat"])
    values = np.ma.masked_invalid(np.asarray(node[name], dtype=float).reshape(len(y), len(x)))
    return np.linspace(x[0], x[-1], len(x)), np.linspace(y[0], y[-1], len(y)), values


def limits(table: Rows) -> tuple[tuple[float, float], tuple[float, float]]:
    """Common limits of all panels: the nodes, half a radius beyond them downwards for the
    boundary.
    """
    node = table["kind"] == "node"
    x, y = table["x_hat"][node], table["y_hat"][node]
    return (x.min(), x.max()), (y.min() - 0.25, y.max() + 0.1)


def field(
    ax: Axes,
    rows: Rows,
    cmap: Colormap,
    norm: Normalize,
    line_pt: float = 0.45,
    density: float = 0.75,
) -> Any:
    """Draw one panel and hand back what a colour bar needs."""
    node = select(rows, rows["kind"] == "node")
    x, y, value = grid(node, "value_m_s")
    ax.set_facecolor(UNOBSERVED)
    shade = ax.pcolormesh(x, y, value, cmap=cmap, norm=norm, shading="nearest", rasterized=True)
    _, _, vx = grid(node, "vx_m_s")
    _, _, vy = grid(node, "vy_m_s")
    ax.streamplot(
        x,
        y,
        vx,
        vy,
        color=LINES,
        linewidth=line_pt,
        arrowsize=0.45,
        density=density,
        broken_streamlines=True,
        zorder=2,
    )
    _as_one(ax)
    for end in pairs(select(rows, rows["kind"] == "rotor")):
        ax.plot(*end, color="black", linewidth=2.0, solid_capstyle="butt", zorder=4)
    wall = select(rows, rows["kind"] == "boundary")
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


def _as_one(ax: Axes) -> None:
    """The hundreds of arrow heads of the streamlines as one artist, which is laid out and drawn in
    a fraction of the time.
    """
    arrows: list[Any] = list(ax.patches)
    ends = np.array([arrow._posA_posB for arrow in arrows]).reshape(-1, 2, 2)
    for arrow in arrows:
        arrow.remove()
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(along[:, 0], along[:, 1])
    seen = length > 0
    along = along[seen] / length[seen, None]
    style: dict[str, Any] = {
        "units": "inches",
        "width": 0.009,
        "headwidth": 4.5,
        "headlength": 5,
        "headaxislength": 5,
        "minlength": 0,
    }
    ax.quiver(
        *ends[seen, 0].T,
        *along.T,
        angles="xy",
        scale_units="inches",
        scale=18,
        pivot="mid",
        color=LINES,
        zorder=2.1,
        **style,
    )


def pairs(rows: Rows) -> list[tuple[Any, Any]]:
    """Line segments from rows that come two by two."""
    return [
        (rows["x_hat"][i : i + 2], rows["y_hat"][i : i + 2])
        for i in range(0, len(rows["x_hat"]), 2)
    ]


def highest(table: Rows) -> float:
    """Upper end of a colour scale of speeds: the fastest but a thousandth of all nodes."""
    value = table["value_m_s"][table["kind"] == "node"]
    return float(np.nanquantile(value, 0.999))
