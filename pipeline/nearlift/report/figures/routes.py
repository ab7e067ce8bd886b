"""Ways through the corridor, seen from the side, and their energy against risk."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from nearlift.flight.simulation.corridor import BASES, BERTH
from nearlift.flight.simulation.presets import TARGETS
from nearlift.products import ROUTES, SAFETY
from nearlift.report.evidence import Columns, Evidence, Rows, distinct, stack, where
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import FITTED, SERIES, Style, note, plain_log

#: So many ways are drawn: the cheapest, the chosen, the safest, and some between.
SHOWN = 5
COLUMNS = ("kind", "way", "chosen", "x", "y", "x2", "y2", "seen")
#: Lines where flights crashed, and where the risk is only a bound.
SEEN: Any = "-"
BOUND: Any = (0, (3, 1.5))
#: Width of the chosen way's line in points, and markers along each way.
BOLD, MARKS = 2.4, 4
#: A risk of zero has no place on a logarithmic axis.
LEAST = 1e-12

#: Colour and marker of each way that is drawn.
Looks = Mapping[int, tuple[str, str]]


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each: `kind` (way, box, end, front, bound), `way`, `chosen`,
    `x` and `y` (m; of the front: energy and risk), `x2` and `y2` (a box's far corner; of the front:
    the ends of the risk's 90 % interval), `seen` (1 where the risk rests on flights that crashed).
    """
    table, entry = evidence.table(ROUTES), evidence.safety.route
    if not entry or not len(table["way"]):
        return {}
    numbers = np.unique(table["way"])
    chosen = int(where(table, chosen=1)["way"][0])
    spread = numbers[np.linspace(0, len(numbers) - 1, min(SHOWN, len(numbers))).astype(int)]
    parts: list[dict[str, object]] = [
        {"kind": "box", "x": left, "x2": right, "y": bottom, "y2": top}
        for left, right, bottom, top in entry.boxes_m
    ]
    room = {"x": 0.0, "x2": entry.length_m, "y": 0.0, "y2": entry.height_m}
    parts.append({"kind": "room", **room})
    (x, z), (x2, z2) = entry.start_m, entry.goal_m
    parts.append({"kind": "end", "x": [x, x2], "y": [z, z2]})
    for way in sorted({chosen, *spread.tolist()}):
        mine = where(table, way=way)
        parts.append(
            {
                "kind": "way",
                "way": way,
                "chosen": int(way == chosen),
                "x": mine["x_m"],
                "y": mine["z_m"],
                "seen": (mine["risk_from"] == BASES[0]).astype(int),
            }
        )
    for i, w in enumerate(entry.ways):
        risk = {"x": w.energy, "y": w.risk, "x2": w.lo90, "y2": w.hi90}
        parts.append({"kind": "front", "way": i, "chosen": int(w.chosen), **risk})
    parts.append({"kind": "bound", "y": entry.risk_bound})
    return stack([{"way": -1, "chosen": 0, "seen": 1, **part} for part in parts], COLUMNS)


def caption(evidence: Evidence, table: Columns) -> str:
    """What is drawn, and what the way is not."""
    e = evidence.safety.route
    assert e is not None
    shares = e.share_by_basis.items()
    rests = ", ".join(f"{100 * share:.0f} % on {basis}" for basis, share in shares if share > 0)
    berth = "".join(
        f" From the {side}, of which no model was fitted, they keep ẑ ≥ {BERTH:g}."
        for side in TARGETS
        if side not in e.boundaries
    )
    lowest = " and ".join(f"ẑ ≥ {z:.3g} from the {side}" for side, z in e.lowest_z_hat.items())
    return (
        f"Ways through a corridor of {e.length_m:g} by {e.height_m:g} m at {e.speed_m_s:g}"
        f" m/s, from the fitted models near {' and '.join(e.boundaries)}. Solid where the risk"
        " comes from flights that crashed, dashed where it is only a bound set by"
        f" {e.flights} flights a set-point. Bold: the cheapest way"
        f" whose risk is shown to be at most {e.risk_bound:g} (dashed line); of its points' risk"
        f" rests {rests}. It takes {e.energy:.3f} of the straight way's energy far from"
        f" boundaries, at a risk of {e.risk:.2g} (90 %: {e.lo90:.2g} to {e.hi90:.2g}), and"
        f" keeps {lowest}, below which nothing was both measured and flown, or it matters what lift"
        f" does nearer than measured.{berth} Right: energy"
        " against risk of all ways on the front, 90 % over model and flights. A plan on a grid for"
        " hover's aerodynamics, no trajectory: neither forward flight's weaker ground effect nor"
        " tracking error along the way is in it."
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    e = evidence.safety.route
    assert e is not None
    return (
        f"{len(e.ways)} ways between floor and ceiling; the chosen one has energy"
        f" {e.energy:.3f} and risk {e.risk:.2g}."
    )


def draw(table: Rows, look: Style) -> Figure:
    """Corridor on the left, front on the right, one colour and marker for a way in both."""
    figure = Figure(figsize=(look.double_in, 0.43 * look.double_in), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.9, 1.0))
    front, ways = where(table, kind="front"), where(table, kind="way")
    looks = dict(zip(distinct(ways["way"]), SERIES, strict=False))
    _corridor(left, table, looks)
    _front(right, front, looks, float(where(table, kind="bound")["y"][0]))
    handles, names = [], []
    for way, (colour, marker) in looks.items():
        (i,) = np.flatnonzero(front["way"] == way)
        words = f"risk {front['y'][i]:.3g}, energy {front['x'][i]:.3f}"
        names.append(f"{words}: chosen" if front["chosen"][i] else words)
        width = BOLD if front["chosen"][i] else None
        handles.append(
            Line2D([], [], color=colour, marker=marker, markerfacecolor="white", linewidth=width)
        )
    for dashes, words in (
        (SEEN, "risk from flights that crashed"),
        (BOUND, "no crash flown: risk is a bound"),
    ):
        if (dashes == SEEN) in ways["seen"]:
            handles.append(Line2D([], [], color="0.35", linestyle=dashes))
            names.append(words)
    figure.legend(handles, names, loc="outside lower center", ncols=2)
    return figure


def _corridor(ax: Axes, table: Rows, looks: Looks) -> None:
    boxes, room, ends = (where(table, kind=kind) for kind in ("box", "room", "end"))
    for x, y, x2, y2 in zip(*(boxes[k] for k in ("x", "y", "x2", "y2")), strict=True):
        box = Rectangle((x, y), x2 - x, y2 - y, facecolor="0.8", edgecolor="0.4", linewidth=0.6)
        ax.add_patch(box)
    for height in (0.0, float(room["y2"][0])):
        ax.axhline(height, color="0.35", linewidth=2.0)
    for way, (colour, marker) in looks.items():
        mine = where(table, kind="way", way=way)
        chosen = bool(mine["chosen"][0])
        x, y, seen = (mine[k] for k in ("x", "y", "seen"))
        # stretches of one kind, each with the first point of the next
        turns = [0, *(np.flatnonzero(np.diff(seen)) + 1).tolist(), len(x)]
        for a, b in itertools.pairwise(turns):
            ax.plot(
                x[a : b + 1],
                y[a : b + 1],
                color=colour,
                linewidth=BOLD if chosen else 1.1,
                linestyle=SEEN if seen[a] else BOUND,
                zorder=3 if chosen else 4,
            )
        at = np.searchsorted(x, x[-1] * (np.arange(MARKS) + 0.5) / MARKS)
        ax.plot(x[at], y[at], marker, color=colour, markerfacecolor="white", zorder=5)
    ax.plot(ends["x"], ends["y"], "|", color=FITTED, markersize=9, zorder=6)
    ax.set_xlim(0, float(room["x2"][0]))
    ax.set_xlabel("along the corridor (m)")
    ax.set_ylabel("height of rotor plane (m)")
    ax.set_title("a) routes")


def _front(ax: Axes, front: Rows, looks: Looks, bound: float) -> None:
    ax.set_yscale("log")
    y, low, high = (np.maximum(front[k], LEAST) for k in ("y", "x2", "y2"))
    ax.plot(front["x"], y, color="0.6", linewidth=0.8, zorder=1)
    for i, way in enumerate(front["way"].tolist()):
        colour, marker = looks.get(way, ("0.6", "."))
        ax.errorbar(
            [front["x"][i]],
            [y[i]],
            yerr=[[y[i] - low[i]], [high[i] - y[i]]],
            color=colour,
            marker=marker,
            markerfacecolor="white",
            elinewidth=0.6,
            capsize=1.2,
            linestyle="none",
        )
    ax.axhline(bound, color="0.35", linestyle=BOUND, linewidth=0.8)
    note(
        ax,
        "highest risk allowed",
        (0.97, bound),
        (0, 2),
        xycoords=("axes fraction", "data"),
        ha="right",
        color="0.25",
    )
    # an interval that reaches far below all risks leaves the frame
    ax.set_ylim(0.3 * float(y.min()), 2.5 * max(bound, float(high.max())))
    plain_log(ax.yaxis)
    ax.margins(x=0.12)
    ax.set_xlabel("energy / that of the straight route, far away")
    ax.set_ylabel("risk of a crash")
    ax.set_title("b) energy against risk")


FIGURE = FigureSpec(
    name="routes",
    title="Routes through the corridor",
    needs=(ROUTES, SAFETY),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
    asked=lambda campaign: campaign.simulate is not None and campaign.simulate.route is not None,
)
