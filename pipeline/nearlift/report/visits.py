"""Next visits as text."""

from __future__ import annotations

from nearlift.results.next_visits import NextVisits


def text(batch: NextVisits) -> str:
    """Table of the visits, then their gain, stopping point and cost."""
    moved = any(v.supply_V is not None for v in batch.visits)
    lines = [
        f"{batch.boundary}, {batch.trials} trials, {batch.base_model}",
        "",
        "visit   distance     z/R" + ("  supply" if moved else "") + "   throttles",
    ]
    for i, v in enumerate(batch.visits):
        free = v.z_hat == float("inf")
        where = f"{'free air':>11}" if free else f"{1e3 * v.distance_m:8.2f} mm"
        supply = f"{v.supply_V:6.2f} V" if v.supply_V is not None else ""
        throttles = " ".join(f"{100 * t:.3g}" for t in v.throttles)
        ratio = "" if free else f"{v.z_hat:.3g}"
        via = f", from {1e3 * v.via_m:.2f} mm" if v.via_m is not None else ""
        lines.append(f"{i + 1:>5}{where}{ratio:>8}{supply}   {throttles} %{via}")
    return "\n".join([*lines, "", *batch.lines, *(f"note: {note}" for note in batch.notes)])
