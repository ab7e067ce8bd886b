"""The chapter on safety: the paper's claims beside what was flown, risk and energy of the fitted
models, roll near a sidewall.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import BOUNDARIES
from nearlift.flight.simulation import presets
from nearlift.flight.simulation.corridor import BERTH
from nearlift.flight.simulation.energy import MOST_FLIGHTS
from nearlift.products import SAFETY
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place
from nearlift.rounding import plain

#: Of a level of risk: the set-point, its interval, and what it would be on other readings.
LEVEL = ("value", "lo90", "hi90", "without_model", "held")


def facts(evidence: Evidence) -> dict[str, object]:
    """Claims, presets and fitted models, each number with its source."""
    content, root = evidence.document(SAFETY), Place(evidence, SAFETY)
    return {
        "presets": [_preset(root.at("presets", name), name) for name in content["presets"]],
        "claims": [_claim(root.at("claims", i)) for i in range(len(content["claims"]))],
        "fitted": [_fitted(root.at("fitted", b), b) for b in BOUNDARIES if b in content["fitted"]],
        "route": _route(root.at("route")) if content.get("route") else None,
        "roll": _roll(root.at("roll")),
    }


def _preset(place: Place, name: str) -> dict[str, object]:
    tests = {
        (b, kind): flown[kind]
        for b, flown in place.content["boundaries"].items()
        for kind in ("convergence", "variants")
    }
    worst = place.at("boundaries", *max(tests, key=lambda k: tests[k]["worst"]))
    return {
        "name": name,
        "meaning": place.content["meaning"],
        "converged": all(c["converged"] for c in tests.values()),
        "worst": worst.number("worst", digits=2),
        "flights": worst.number("flights", digits=6),
    }


def _claim(place: Place) -> dict[str, object]:
    claim = place.content
    return {
        "says": claim["says"],
        "paper": claim["paper"],
        "tolerance": claim["tolerance"],
        "values": [
            {
                **place.at("presets", name).numbers("value", "lo90", "hi90", places=2),
                "verdict": preset["verdict"],
            }
            for name, preset in claim["presets"].items()
        ],
    }


def _fitted(place: Place, boundary: str) -> dict[str, object]:
    fitted = place.content
    return {
        "boundary": boundary,
        "model": fitted["title"],
        "effects": fitted["effects"],
        "left": fitted["left_on_the_bench"],
        "draws": fitted["draws"],
        "source": fitted["draws_from"],
        "contact": place.number("contact_z_hat", places=2),
        "contact_mm": place.number("contact_m", scale=1e3, digits=3, how="in mm"),
        "nearest": place.number("measured_z_hat", 0, places=2),
        "gains": [place.number("gains", k, digits=3) for k in ("kP", "kD", "kI")],
        "droop": place.percent("droop", digits=2) if fitted["droop"] else None,
        "converged": fitted["convergence"]["converged"],
        "levels": [
            {
                "risk": f"{100 * e['risk']:g} %",
                **place.at("levels", i).numbers(*LEVEL, places=2),
                "least": e["value"] == e["lowest_flown"],
                "agrees": e["agrees"],
            }
            for i, e in enumerate(fitted["levels"])
        ],
        "best": [
            _best(place.at("best_set_points", i), fitted["flights"])
            for i in range(len(fitted["best_set_points"]))
        ],
    }


def _best(place: Place, flights: int) -> dict[str, object]:
    point = place.content
    return {
        "price": f"{point['price']:g}",
        **place.numbers("target_z_hat", "lo90", "hi90", places=2),
        "cost": place.number("relative_cost", places=3),
        "farthest": point["farthest"],
        "refused": refusal(point, flights),
        "rate": place.percent("rate", digits=2),
        "rate_hi95": place.percent("rate_hi95", digits=2),
    }


def refusal(point: dict[str, Any], flights: int) -> str:
    """Why no set-point is named for a price, and what would do; empty where one is."""
    if not point["agrees"]:
        return "no advice: it depends on lift nearer than measured; measure nearer"
    if point["resolved"]:
        return ""
    enough = (
        f"about {plain(point['flights_needed'], 2)} would"
        if point["flights_needed"]
        else f"{MOST_FLIGHTS / 1e6:g} million would not either"
    )
    return f"not resolved by {flights} flights; {enough}"


def _route(place: Place) -> dict[str, object]:
    entry = place.content
    lowest, seen = entry["lowest_z_hat"], entry["share_by_basis"]
    return {
        "bound": f"{entry['risk_bound']:g}",
        "flights": entry["flights"],
        "energy": place.number("energy", places=3),
        **place.numbers("risk", "lo90", "hi90", digits=2),
        "berth": [b for b in presets.TARGETS if b not in lowest],
        "berth_z_hat": f"{BERTH:g}",
        "lowest": {side: place.number("lowest_z_hat", side, digits=3) for side in lowest},
        "shares": [{"basis": b, "share": f"{100 * s:.0f} %"} for b, s in seen.items() if s > 0],
    }


def _roll(place: Place) -> dict[str, object]:
    content = place.content
    rows = [
        {
            "assumption": r["assumption"],
            "torque": _torque(place.at("paper", i), "torque_N_m"),
            "low": place.number("paper", i, "acceleration_lo_deg_s2", places=0),
            "high": place.number("paper", i, "acceleration_hi_deg_s2", places=0),
        }
        for i, r in enumerate(content["paper"])
    ]
    torques = content.get("fitted")
    if not torques:
        return {"paper": rows, "fitted": [], "gap": None, "u_inertia": None}
    fitted = []
    for name, words in (
        ("near_pair_only", "the near pair alone loses lift"),
        ("same_law", "both pairs lose by one law, each over its own gap"),
    ):
        at, known = place.at("fitted", name), "acceleration_deg_s2" in torques[name]
        accelerations = ("acceleration_deg_s2", "lo90_deg_s2", "hi90_deg_s2")
        fitted.append(
            {
                "words": words,
                "torque": _torque(at, "torque_N_m", 0),
                "lo90": _torque(at, "lo90_N_m", 0),
                "hi90": _torque(at, "hi90_N_m", 0),
                "acceleration": [at.number(k, digits=3) for k in accelerations if known],
            }
        )
    return {
        "paper": rows,
        "fitted": fitted,
        "gap": place.number("fitted", "z_hat", 0, digits=2),
        "u_inertia": place.percent("fitted", "u_inertia", digits=2),
    }


def _torque(place: Place, *path: str | int) -> Number:
    return place.number(*path, scale=1e3, digits=2, how="in N mm")
