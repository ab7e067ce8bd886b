"""From how far a boundary shows in lift, and what a reading says of the distance."""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import BOUNDARIES
from nearlift.products import DETECTION, PROXIMITY
from nearlift.summaries.evidence import Columns, Evidence, stack, text_column

REAL = ("payload_percent", "x", "y", "lo90", "hi90")


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each.

    Returns
    -------
    dict of arrays
        `row` (range, located), `panel` (boundary), `payload_percent`, `x`, `y`, `lo90`, `hi90`. In `range`, x is the averaging
        time in s and y the range in z_hat (nan: none); in `located`, x is the true z_hat and y the posterior's median.
    """
    table, content = evidence.table(DETECTION), evidence.document(PROXIMITY)["boundaries"]
    parts = []
    for side in (b for b in BOUNDARIES if b in content):
        mine = table["boundary"] == side
        for payload in np.unique(table["payload"][mine]):
            own = mine & (table["payload"] == payload)
            ends = {"lo90": table["lo90"][own], "hi90": table["hi90"][own]}
            parts.append(_rows("range", side, table["averaging_s"][own], table["range_z_hat"][own], payload_percent=100 * payload, **ends))
        found = content[side].get("located", [])
        if found:
            parts.append(_rows("located", side, *(np.array([f[k] for f in found]) for k in ("z_hat", "median")), **{
                k: np.array([f[k] for f in found]) for k in ("lo90", "hi90")}))  # fmt: skip
    return stack(parts) if parts else {}


def _rows(row: str, panel: str, x: Any, y: Any, **further: Any) -> Columns:
    n = len(x)
    real = {"x": x, "y": y, **further}
    return {"row": text_column(row, n), "panel": text_column(panel, n)} | {
        name: np.broadcast_to(np.asarray(real.get(name, np.nan), dtype=float), (n,)) for name in REAL
    }


def caption(evidence: Evidence, table: Columns) -> str:
    """What is drawn, at which rates and with which sensor."""
    content = evidence.document(PROXIMITY)
    parts = [
        (
            f"Above: the farthest distance at which a boundary is noticed with {100 * content['false_alarm_rate']:g} % false alarms and "
            f"{100 * content['miss_rate']:g} % misses, against averaging time, by the uncertainty of the payload; bands: 90 % over the model's "
            "uncertainty. Where there is no curve, no distance that was measured would do."
        ),
        f"Below: what a reading averaged over {content['averaging_s']:g} s says of the distance (median and 90 %, payload known best).",
    ]
    for side, own in content["boundaries"].items():
        what = f"largest change of lift measured {100 * own['largest_change']:+.2g} %, noise {100 * own['short_per_sqrt_Hz']:.2g} %/√Hz"
        parts.append(f"{side.capitalize()}, {own['model']}: {what} and {100 * own['floor']:.2g} % that averaging leaves.")
        if "refused" in own:
            parts.append(f"Not inverted: {own['refused']}.")
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    rows = evidence.table(DETECTION)
    parts = []
    for side in dict.fromkeys(rows["boundary"].tolist()):
        ranges = rows["range_z_hat"][rows["boundary"] == side]
        known = ranges[np.isfinite(ranges)]
        parts.append(f"{side}: noticed from z_hat {known.min():.2g} to {known.max():.2g} away" if len(known) else f"{side}: never noticed")
    return "Detection range against averaging time. " + "; ".join(parts) + "."
