"""Ways through the corridor, and their energy against risk."""

from __future__ import annotations

import numpy as np

from nearlift.flight.simulation.presets import TARGETS
from nearlift.flight.simulation.route import BASES, BERTH
from nearlift.products import ROUTES, SAFETY
from nearlift.summaries.evidence import Columns, Evidence, stack, text_column

#: So many ways are drawn: the cheapest, the chosen, the safest, and some between.
SHOWN = 5


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
