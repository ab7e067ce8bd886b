"""Figure 6: sample flights, crash rates and energy near ground and ceiling, as the paper has them
and with a converged time step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.products import CRASH_RATES, FLIGHTS, SAFETY
from nearlift.summaries.evidence import Columns, Evidence, stack, text_column

SIDES = ("ground", "ceiling")
ROWS = ("histories", "paper", "converged")
#: Of a sample flight so much is shown before and after the crash that it is about, s.
BEFORE_S, AFTER_S = 20.0, 10.0
REAL = ("exponent", "flight", "x", "y", "lo90", "hi90")


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each.

    Returns
    -------
    dict of arrays
        `row` (histories, paper, converged), `panel` (boundary), `kind` (flight, crash, cost_paper,
        cost), `label` (model), `exponent` of the ratio, `flight`, `x` (time in s or set-point), `y`
        (z_hat, crash rate or relative cost), `lo90` and `hi90` of a crash rate. A flight that
        crashed ends at z_hat = 0, on the line through its last two heights.
    """
    rates, flights = evidence.table(CRASH_RATES), evidence.table(FLIGHTS)
    parts = []
    for side in SIDES:
        mine = flights["boundary"] == side
        for flight in flights["flight"][mine][:1].tolist():
            models = flights["model"][mine & (flights["flight"] == flight)]
            end = min(
                flights["t_s"][mine & (flights["flight"] == flight) & (flights["model"] == m)].max()
                for m in set(models.tolist())
            )
            near = (flights["t_s"] >= end - BEFORE_S) & (flights["t_s"] <= end + AFTER_S)
            for model in (
                "none",
                *dict.fromkeys(m for m in flights["model"][mine].tolist() if m != "none"),
            ):
                own = mine & near & (flights["flight"] == flight) & (flights["model"] == model)
                t_s, z_hat = touching(flights["t_s"][own], flights["z_hat"][own])
                label = "none" if model == "none" else catalogue.model(model).title
                parts.append(
                    curve_rows("histories", side, "flight", label, t_s, z_hat, flight=flight)
                )
        for preset in ROWS[1:]:
            for exponent in dict.fromkeys(
                rates["exponent"][
                    (rates["preset"] == preset) & (rates["boundary"] == side)
                ].tolist()
            ):
                own = (
                    (rates["preset"] == preset)
                    & (rates["boundary"] == side)
                    & (rates["exponent"] == exponent)
                )
                x, label = rates["target_z_hat"][own], str(rates["model"][own][0])
                ends = {"lo90": rates["lo90"][own], "hi90": rates["hi90"][own]}
                parts.append(
                    curve_rows(
                        preset,
                        side,
                        "crash",
                        label,
                        x,
                        rates["rate"][own],
                        exponent=exponent,
                        **ends,
                    )
                )
                if exponent == 1.0:
                    parts += [
                        curve_rows(
                            preset, side, kind, label, x, rates[kind][own], exponent=exponent
                        )
                        for kind in ("cost_paper", "cost")
                    ]
    return stack(parts) if parts else {}


def touching(t_s: Any, z_hat: Any) -> tuple[Any, Any]:
    """A flight up to where it touched: a last height below zero, a step after the touch, becomes
    the touch.
    """
    if len(z_hat) < 2 or z_hat[-1] > 0:
        return t_s, z_hat
    share = z_hat[-2] / (z_hat[-2] - z_hat[-1])
    return np.append(t_s[:-1], t_s[-2] + share * (t_s[-1] - t_s[-2])), np.append(z_hat[:-1], 0.0)


def curve_rows(
    row: str, panel: str, kind: str, label: str, x: Any, y: Any, **further: Any
) -> Columns:
    """Rows of one curve; a single value stands in all of them, what is not given is nan."""
    n = len(x)
    table: Columns = {
        "row": text_column(row, n),
        "panel": text_column(panel, n),
        "kind": text_column(kind, n),
        "label": text_column(label, n),
    }
    real = {"x": x, "y": y, **further}
    return table | {
        name: np.broadcast_to(np.asarray(real.get(name, np.nan), dtype=float), (n,))
        for name in REAL
    }


def caption(evidence: Evidence, table: Columns) -> str:
    """What is drawn, and which of it may be believed."""
    content = evidence.document(SAFETY)["presets"]
    flights = {own["flights"] for p in content.values() for own in p["boundaries"].values()}
    parts = [
        "Flights of the paper's vehicle (27 g, spacing 90 mm) with its models and controller.",
        (
            "First row: the seconds around a crash in the first flight that the model decides"
            " (above the ground it saves the vehicle, below the ceiling it is what loses it); both"
            " curves meet the same gusts; a cross is the crash."
        ),
        (
            "Below: share of flights that touch the boundary against set-point, for no model and"
            " for the model's ratio raised to powers,"
            f" {' or '.join(str(f) for f in sorted(flights))} flights a point with the same gusts"
            " throughout; shade: 90 % binomial interval."
        ),
        (
            "Right axis: relative power to hover, (L/L∞)^(−3/2) as the paper has it (dashed) and"
            " L∞/L, as its theories mean it (dotted)."
        ),
    ]
    for name, own in content.items():
        worst = max(b["convergence"]["worst"] for b in own["boundaries"].values())
        good = all(b["convergence"]["converged"] for b in own["boundaries"].values())
        verdict = (
            "no rate leaves its interval"
            if good
            else "its rates are the time step's as much as the vehicle's"
        )
        parts.append(
            f"{name.capitalize()}: {own['meaning']}; halving the step changes a crash rate by up to"
            f" {worst:.2g}: {verdict}."
        )
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = []
    for name, own in evidence.document(SAFETY)["presets"].items():
        for side, found in own["boundaries"].items():
            half = {e["exponent"]: e["value"] for e in found["levels"] if e["risk"] == 0.5}
            if half:
                parts.append(
                    f"{name}, {side}: half of the flights crash at z_hat {half[0.0]:.2f} without"
                    f" and {half[1.0]:.2f} with the model"
                )
    return "Crash rates against set-point. " + "; ".join(parts) + "."
