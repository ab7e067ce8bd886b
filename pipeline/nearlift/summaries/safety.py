"""The campaign's models in flight: crash rate against set-point with the model's uncertainty, and
energy against risk.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.products import CRASH_RATES, SAFETY
from nearlift.rounding import plain
from nearlift.summaries.evidence import Columns, Evidence, stack
from nearlift.summaries.fig6 import SIDES, curve_rows

#: A rate of zero has no place on a logarithmic axis: it stands at half a crash.
FLOOR = 0.5


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each.

    Returns
    -------
    dict of arrays
        `row` (crash, front), `panel` (boundary), `kind` (none, model, cost, best), `label`, `x`,
        `y`, `lo90`, `hi90`. In the row `crash`, x is the set-point and y a crash rate (90 % over
        model and flights) or a relative cost (over what is not known of the held quantity); in
        `front`, x is the relative cost, y the crash rate, and `best` the set-points of least
        expected cost.
    """
    rates, content = evidence.table(CRASH_RATES), evidence.document(SAFETY)["fitted"]
    parts = []
    for side in SIDES:
        own = (rates["preset"] == "fitted") & (rates["boundary"] == side)
        if side not in content or not own.any():
            continue
        none, best = (
            own & (rates["exponent"] == 0),
            own & (rates["exponent"] != 0) & (rates["member"] == -1),
        )
        x = rates["target_z_hat"][best]
        draws = own & (rates["member"] >= 0)
        low, high = _band(rates, draws, len(x))
        label = content[side]["title"]
        ends = {"lo90": rates["lo90"][none], "hi90": rates["hi90"][none]}
        parts.append(
            curve_rows(
                "crash",
                side,
                "none",
                "no boundary effect",
                rates["target_z_hat"][none],
                rates["rate"][none],
                **ends,
            )
        )
        lo90, hi90 = np.minimum(low, rates["lo90"][best]), np.maximum(high, rates["hi90"][best])
        parts.append(
            curve_rows("crash", side, "model", label, x, rates["rate"][best], lo90=lo90, hi90=hi90)
        )
        costs = {"lo90": rates["cost_lo"][best], "hi90": rates["cost_hi"][best]}
        parts.append(
            curve_rows(
                "crash", side, "cost", content[side]["held"], x, rates["cost"][best], **costs
            )
        )
        parts.append(curve_rows("crash", side, "cost_paper", "paper", x, rates["cost_paper"][best]))
        floor = FLOOR / content[side]["flights"]
        shown = {
            k: np.maximum(v, floor)
            for k, v in (("y", rates["rate"][best]), ("lo90", lo90), ("hi90", hi90))
        }
        parts.append(
            curve_rows(
                "front",
                side,
                "model",
                label,
                rates["cost"][best],
                shown["y"],
                lo90=shown["lo90"],
                hi90=shown["hi90"],
            )
        )
        for found in content[side]["best_set_points"]:
            if found["resolved"]:
                name = f"{found['price']:g}: z_hat {found['target_z_hat']:g}"
                at = max(found["crashes"] / content[side]["flights"], floor)
                parts.append(
                    curve_rows("front", side, "best", name, [found["relative_cost"]], [at])
                )
    return stack(parts) if parts else {}


def _band(rates: Columns, draws: Any, n: int) -> tuple[Any, Any]:
    """5 and 95 % of the draws' rates, each widened by its own binomial interval's ends."""
    low = rates["lo90"][draws].reshape(-1, n)
    high = rates["hi90"][draws].reshape(-1, n)
    return np.percentile(low, 5, axis=0), np.percentile(high, 95, axis=0)


def caption(evidence: Evidence, table: Columns) -> str:
    """What is drawn, by boundary."""
    parts = [
        (
            "The fitted models in flight, with the paper's controller and gusts carried over to"
            " this vehicle (same dimensionless groups) unless the manifest gives its own."
        ),
        (
            "Above: crash rate against set-point, with the 90 % band of model and flights together,"
            " and the relative power to hover (right axis), by what the trials held (band: what is"
            " not known of it) and as the paper has it (dashed)."
        ),
        (
            "Below: power against risk, a rate without a crash standing at half a crash. Symbols"
            " are the set-points of least expected cost where a crash costs so many times the"
            " flight's energy, by rates of (crashes + 1/2) / (flights + 1) that fall with distance."
            " No set-point is named for a price at which even the upper bound of its risk (95 %)"
            " would cost more than it saves over the farthest set-point."
        ),
    ]
    for side, own in evidence.document(SAFETY)["fitted"].items():
        c = own["convergence"]
        refused = [
            (
                f"{e['price']:g} (about {plain(e['flights_needed'], 2)} flights would do)"
                if e["flights_needed"]
                else f"{e['price']:g}"
            )
            for e in own["best_set_points"]
            if not e["resolved"]
        ]
        left = (
            f" Not resolved by {own['flights']} flights: prices of {', '.join(refused)}."
            if refused
            else ""
        )
        parts.append(
            f"{side.capitalize()}: {own['title']}, {own['draws']} draws from {own['draws_from']},"
            f" {own['flights']} flights a point; L/L∞ is held below ẑ = {own['bound_z_hat']:.2g},"
            " where nothing was measured; halving the step changes a rate by up to"
            f" {c['worst']:.2g}.{left}"
        )
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = [
        f"{side}: a risk of {e['risk']:g} at z_hat {e['value']:.2f}"
        for side, own in evidence.document(SAFETY)["fitted"].items()
        for e in own["levels"]
        if e["value"] is not None
    ]
    return "Crash rate and power against set-point. " + "; ".join(parts) + "."
