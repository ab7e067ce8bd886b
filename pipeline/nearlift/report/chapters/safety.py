"""The chapter on safety: the paper's claims beside what was flown, risk and energy of the fitted
models, roll near a sidewall.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import BOUNDARIES
from nearlift.flight.simulation import presets
from nearlift.flight.simulation.corridor import BERTH
from nearlift.products import SAFETY
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, cite
from nearlift.rounding import plain


def facts(evidence: Evidence) -> dict[str, Any]:
    """Claims, presets and fitted models, each number with its source."""
    content = evidence.document(SAFETY)
    return {
        "presets": [_preset(evidence, name, own) for name, own in content["presets"].items()],
        "claims": [_claim(evidence, i, c) for i, c in enumerate(content["claims"])],
        "fitted": [
            _fitted(evidence, b, content["fitted"][b]) for b in BOUNDARIES if b in content["fitted"]
        ],
        "route": _route(evidence, content.get("route")),
        "roll": _roll(evidence, content["roll"]),
    }


def _preset(evidence: Evidence, name: str, own: dict[str, Any]) -> dict[str, Any]:
    tests = {
        (b, kind): found[kind]
        for b, found in own["boundaries"].items()
        for kind in ("convergence", "variants")
    }
    path = ("presets", name, "boundaries", *max(tests, key=lambda k: tests[k]["worst"]))
    return {
        "name": name,
        "meaning": own["meaning"],
        "converged": all(c["converged"] for c in tests.values()),
        "worst": cite(evidence, SAFETY, *path, "worst", digits=2),
        "flights": cite(evidence, SAFETY, *path, "flights", digits=6),
    }


def _claim(evidence: Evidence, i: int, claim: dict[str, Any]) -> dict[str, Any]:
    def number(preset: str, key: str) -> Number:
        return cite(evidence, SAFETY, "claims", str(i), "presets", preset, key, places=2)

    return {
        "says": claim["says"],
        "paper": claim["paper"],
        "tolerance": claim["tolerance"],
        "values": [
            {
                "number": number(name, "value"),
                "lo90": number(name, "lo90"),
                "hi90": number(name, "hi90"),
                "verdict": own["verdict"],
            }
            for name, own in claim["presets"].items()
        ],
    }


def _fitted(evidence: Evidence, boundary: str, own: dict[str, Any]) -> dict[str, Any]:
    path = ("fitted", boundary)

    def number(*keys: str, places: int = 2) -> Number:
        return cite(evidence, SAFETY, *path, *keys, places=places)

    return {
        "boundary": boundary,
        "model": own["title"],
        "effects": own["effects"],
        "left": own["left_on_the_bench"],
        "draws": own["draws"],
        "source": own["draws_from"],
        "bound": number("bound_z_hat"),
        "droop": cite(evidence, SAFETY, *path, "droop", scale=100, digits=2, how="in percent")
        if own["droop"]
        else None,
        "converged": own["convergence"]["converged"],
        "levels": [
            {
                "risk": f"{100 * e['risk']:g} %",
                "value": number("levels", str(i), "value"),
                "lo90": number("levels", str(i), "lo90"),
                "hi90": number("levels", str(i), "hi90"),
                "without": number("levels", str(i), "without_model"),
                "least": e["value"] == e["lowest_flown"],
            }
            for i, e in enumerate(own["levels"])
        ],
        "best": [
            {
                "price": f"{e['price']:g}",
                "target": number("best_set_points", str(i), "target_z_hat"),
                "lo90": number("best_set_points", str(i), "lo90"),
                "hi90": number("best_set_points", str(i), "hi90"),
                "cost": number("best_set_points", str(i), "relative_cost", places=3),
                "farthest": e["farthest"],
                "refused": "" if e["resolved"] else unresolved(e, own["flights"]),
                **{
                    name: cite(
                        evidence,
                        SAFETY,
                        *path,
                        "best_set_points",
                        str(i),
                        name,
                        scale=100,
                        digits=2,
                        how="in percent",
                    )
                    for name in ("rate", "rate_hi95")
                },
            }
            for i, e in enumerate(own["best_set_points"])
        ],
    }


def unresolved(found: dict[str, Any], flights: int) -> str:
    """Why no set-point is named for a price, and what would do."""
    enough = (
        f"about {plain(found['flights_needed'], 2)} would"
        if found["flights_needed"]
        else "no number of flights would"
    )
    return f"not resolved by {flights} flights; {enough}"


def _route(evidence: Evidence, entry: dict[str, Any] | None) -> dict[str, Any] | None:
    if not entry:
        return None
    seen = entry["share_by_basis"]
    return {
        "bound": f"{entry['risk_bound']:g}",
        "flights": entry["flights"],
        "energy": cite(evidence, SAFETY, "route", "energy", places=3),
        **{
            name: cite(evidence, SAFETY, "route", name, digits=2)
            for name in ("risk", "lo90", "hi90")
        },
        "berth": [b for b in presets.TARGETS if b not in entry["lowest_z_hat"]],
        "berth_z_hat": f"{BERTH:g}",
        "lowest": {
            side: cite(evidence, SAFETY, "route", "lowest_z_hat", side, digits=3)
            for side in entry["lowest_z_hat"]
        },
        "shares": [{"basis": b, "share": f"{100 * s:.0f} %"} for b, s in seen.items() if s > 0],
    }


def _roll(evidence: Evidence, content: dict[str, Any]) -> dict[str, Any]:
    rows = [
        {
            "assumption": r["assumption"],
            "torque": cite(
                evidence,
                SAFETY,
                "roll",
                "paper",
                str(i),
                "torque_N_m",
                scale=1e3,
                digits=2,
                how="in N mm",
            ),
            "low": cite(
                evidence, SAFETY, "roll", "paper", str(i), "acceleration_lo_deg_s2", places=0
            ),
            "high": cite(
                evidence, SAFETY, "roll", "paper", str(i), "acceleration_hi_deg_s2", places=0
            ),
        }
        for i, r in enumerate(content["paper"])
    ]
    own = content.get("fitted")
    fitted = []
    if own:
        for name, words in (
            ("near_pair_only", "the near pair alone loses lift"),
            ("same_law", "both pairs lose by one law, each over its own gap"),
        ):
            at = ("roll", "fitted", name)

            def torque(key: str, at: tuple[str, ...] = at) -> Number:
                return cite(evidence, SAFETY, *at, key, "0", scale=1e3, digits=2, how="in N mm")

            known = "acceleration_deg_s2" in own[name]
            fitted.append(
                {
                    "words": words,
                    "torque": torque("torque_N_m"),
                    "lo90": torque("lo90_N_m"),
                    "hi90": torque("hi90_N_m"),
                    "acceleration": [
                        cite(evidence, SAFETY, *at, k, digits=3)
                        for k in ("acceleration_deg_s2", "lo90_deg_s2", "hi90_deg_s2")
                    ]
                    if known
                    else [],
                }
            )
    return {
        "paper": rows,
        "fitted": fitted,
        "gap": cite(evidence, SAFETY, "roll", "fitted", "z_hat", "0", digits=2) if own else None,
        "u_inertia": cite(
            evidence, SAFETY, "roll", "fitted", "u_inertia", scale=100, digits=2, how="in percent"
        )
        if own
        else None,
    }
