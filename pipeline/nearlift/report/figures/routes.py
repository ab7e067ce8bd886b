"""Ways through the corridor, seen from the side, and their energy against risk."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import matplotlib
import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from nearlift.flight.simulation.corridor import BASES, BERTH
from nearlift.flight.simulation.presets import TARGETS
from nearlift.products import ROUTES, SAFETY
from nearlift.report.evidence import Columns, Evidence, stack, text_column
from nearlift.report.figures.spec import FigureSpec
from nearlift.report.figures.style import FITTED, SEQUENTIAL, SERIES, Style

#: So many ways are drawn: the cheapest, the chosen, the safest, and some between.
SHOWN = 5


Rows = Mapping[str, Any]


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each.

    Returns
    -------
    dict of arrays
        `kind` (way, box, end, front, bound), `way`, `chosen`, `x` and `y` (m; of the front: energy
        and risk), `x2` and `y2` (a box's far corner; of the front: the ends of the risk's 90 %
        interval), `seen` (1 where the risk rests on flights that crashed).
    """
    table, entry = evidence.table(ROUTES), evidence.document(SAFETY).get("route")
    if not entry or not len(table["way"]):
        return {}
    numbers = np.unique(table["way"])
    chosen = int(table["way"][table["chosen"] == 1][0])
    spread = numbers[np.linspace(0, len(numbers) - 1, min(SHOWN, len(numbers))).astype(int)]
    parts = [_rows("box", -1, 0, [b[0]], [b[2]], [b[1]], [b[3]]) for b in entry["boxes_m"]]
    parts.append(_rows("room", -1, 0, [0.0], [0.0], [entry["length_m"]], [entry["height_m"]]))
    parts.append(_rows("end", -1, 0, *zip(entry["start_m"], entry["goal_m"], strict=True)))
    for way in sorted({chosen, *spread.tolist()}):
        mine = table["way"] == way
        seen = table["risk_from"][mine] == BASES[0]
        parts.append(
            _rows("way", way, int(way == chosen), table["x_m"][mine], table["z_m"][mine])
            | {"seen": seen.astype(int)}
        )
    found = entry["ways"]
    for i, w in enumerate(found):
        parts.append(
            _rows(
                "front", i, int(w["chosen"]), [w["energy"]], [w["risk"]], [w["lo90"]], [w["hi90"]]
            )
        )
    parts.append(_rows("bound", -1, 0, [np.nan], [entry["risk_bound"]]))
    return stack(parts)


def _rows(
    kind: str, way: int, chosen: int, x: object, y: object, x2: object = np.nan, y2: object = np.nan
) -> Columns:
    xs = np.asarray(x, dtype=float)
    n = len(xs)
    far = {
        name: np.broadcast_to(np.asarray(v, dtype=float), (n,))
        for name, v in (("y", y), ("x2", x2), ("y2", y2))
    }
    return {
        "kind": text_column(kind, n),
        "way": np.full(n, way),
        "chosen": np.full(n, chosen),
        "x": xs,
        **far,
        "seen": np.ones(n, dtype=int),
    }


def caption(evidence: Evidence, table: Columns) -> str:
    """What is drawn, and what the way is not."""
    e = evidence.document(SAFETY)["route"]
    shares = e["share_by_basis"]
    rests = ", ".join(
        f"{100 * share:.0f} % on {basis}" for basis, share in shares.items() if share > 0
    )
    berth = "".join(
        f" From the {side}, of which no model was fitted, they keep ẑ ≥ {BERTH:g}."
        for side in TARGETS
        if side not in e["boundaries"]
    )
    lowest = " and ".join(f"ẑ ≥ {z:.3g} from the {side}" for side, z in e["lowest_z_hat"].items())
    return (
        f"Ways through a corridor of {e['length_m']:g} by {e['height_m']:g} m at {e['speed_m_s']:g}"
        f" m/s, from the fitted models near {' and '.join(e['boundaries'])}. Colours: risk of a"
        " crash, solid where flights crashed, dashed where it is only a bound set by"
        f" {e['flights']} flights a set-point. Bold, and square on the right: the cheapest way"
        f" whose risk is shown to be at most {e['risk_bound']:g} (dashed line); of its points' risk"
        f" rests {rests}. It takes {e['energy']:.3f} of the straight way's energy far from"
        f" boundaries, at a risk of {e['risk']:.2g} (90 %: {e['lo90']:.2g} to {e['hi90']:.2g}), and"
        f" keeps {lowest}, below which nothing was both measured and flown.{berth} Right: energy"
        " against risk of all ways on the front, 90 % over model and flights. A plan on a grid for"
        " hover's aerodynamics, no trajectory: neither forward flight's weaker ground effect nor"
        " tracking error along the way is in it."
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    e = evidence.document(SAFETY)["route"]
    return (
        f"{len(e['ways'])} ways between floor and ceiling; the chosen one has energy"
        f" {e['energy']:.3f} and risk {e['risk']:.2g}."
    )


def draw(table: Rows, look: Style) -> Figure:
    """Corridor on the left, front on the right."""
    figure = Figure(figsize=(look.double_in, 0.36 * look.double_in), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2.1, 1.0))
    front = {name: column[table["kind"] == "front"] for name, column in table.items()}
    risk = {int(w): float(y) for w, y in zip(front["way"], front["y"], strict=True)}
    least = max(min(risk.values()), 1e-12)
    # at least a decade of colours, so that small differences look small
    middle = np.sqrt(least * max(max(risk.values()), least))
    norm = LogNorm(min(least, middle / np.sqrt(10)), max(*risk.values(), middle * np.sqrt(10)))
    colours = matplotlib.colormaps[SEQUENTIAL]
    for i in np.flatnonzero(table["kind"] == "box"):
        x, y, x2, y2 = (float(table[k][i]) for k in ("x", "y", "x2", "y2"))
        left.add_patch(
            Rectangle((x, y), x2 - x, y2 - y, facecolor="0.8", edgecolor="0.4", linewidth=0.6)
        )
    room = int(np.flatnonzero(table["kind"] == "room")[0])
    for height in (0.0, float(table["y2"][room])):
        left.axhline(height, color="0.35", linewidth=2.0)
    for way in dict.fromkeys(table["way"][table["kind"] == "way"].tolist()):
        mine = (table["kind"] == "way") & (table["way"] == way)
        bold = bool(table["chosen"][mine][0])
        if bold:
            left.plot(table["x"][mine], table["y"][mine], color="0.85", linewidth=3.4, zorder=3)
        x, y, seen = (table[k][mine] for k in ("x", "y", "seen"))
        # stretches of one kind, each with the first point of the next
        turns = [0, *(np.flatnonzero(np.diff(seen)) + 1).tolist(), len(x)]
        for a, b in itertools.pairwise(turns):
            style = "-" if seen[a] else (0, (3, 1.5))
            left.plot(
                x[a : b + 1],
                y[a : b + 1],
                color=colours(norm(max(risk[way], least))),
                linewidth=1.3,
                linestyle=style,
                zorder=4 if bold else 2,
            )
    ends = table["kind"] == "end"
    left.plot(
        table["x"][ends], table["y"][ends], "o", color=FITTED, markerfacecolor="white", zorder=5
    )
    left.set_xlim(0, float(table["x2"][room]))
    left.set_xlabel("along the corridor (m)")
    left.set_ylabel("height of rotor plane (m)")
    left.set_title("a) ways", loc="left", fontsize=look.text_pt)
    figure.colorbar(
        ScalarMappable(norm, colours), ax=left, label="risk of a crash", pad=0.02, aspect=20
    )
    right.set_yscale("log")
    y, low, high = (np.maximum(front[k], 1e-12) for k in ("y", "x2", "y2"))
    right.errorbar(
        front["x"],
        y,
        yerr=(y - low, high - y),
        color=FITTED,
        marker=".",
        markersize=3,
        elinewidth=0.6,
        capsize=1.2,
    )
    best = front["chosen"] == 1
    right.plot(
        front["x"][best],
        front["y"][best],
        SERIES[1][1],
        color=SERIES[1][0],
        markerfacecolor="white",
        markersize=5,
        zorder=4,
    )
    right.axhline(
        float(table["y"][table["kind"] == "bound"][0]),
        color="0.45",
        linestyle=(0, (4, 2)),
        linewidth=0.8,
    )
    # an interval that reaches far below all risks leaves the frame
    right.set_ylim(bottom=0.3 * least)
    right.set_xlabel("relative energy")
    right.set_ylabel("risk of a crash")
    right.set_title("b) energy against risk", loc="left", fontsize=look.text_pt)
    return figure


FIGURE = FigureSpec(
    name="routes",
    title="Ways through the corridor",
    needs=(ROUTES, SAFETY),
    summarise=summarise,
    draw=draw,
    caption=caption,
    alt=alt,
    asked=lambda campaign: campaign.simulate is not None and campaign.simulate.route is not None,
)
