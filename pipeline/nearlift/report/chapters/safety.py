"""The chapter on safety: the paper's claims beside what was flown, risk and energy of the fitted
models, roll near a sidewall.
"""

from __future__ import annotations

from nearlift.declare import BOUNDARIES
from nearlift.flight.simulation import presets
from nearlift.flight.simulation.corridor import BERTH
from nearlift.flight.simulation.energy import MOST_FLIGHTS, BestSetPoint
from nearlift.products import SAFETY
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.rounding import plain

#: How the pairs of rotors beside a wall may lose lift.
ROLLS = {
    "near_pair_only": "the near pair alone loses lift",
    "same_law": "both pairs lose by one law, each over its own gap",
}


def facts(evidence: Evidence) -> dict[str, object]:
    """The whole file, presets with what halving the step does to them, and the boundaries that were
    flown.
    """
    root = Place(evidence, SAFETY)
    return {
        "root": root,
        "presets": [_preset(place) for place in root.every("presets")],
        "fitted": [root.at("fitted", b) for b in BOUNDARIES if b in root.content["fitted"]],
        "refusals": {
            boundary: [refusal(point, fitted.flights) for point in fitted.best_set_points]
            for boundary, fitted in evidence.safety.fitted.items()
        },
        "rolls": ROLLS,
        "sides": presets.TARGETS,
        "berth_z_hat": BERTH,
    }


def _preset(place: Place) -> dict[str, object]:
    tests = [
        test
        for boundary in place.every("boundaries")
        for test in (boundary.at("convergence"), boundary.at("variants"))
    ]
    return {
        "place": place,
        "converged": all(test.content["converged"] for test in tests),
        "worst": max(tests, key=lambda test: test.content["worst"]),
    }


def refusal(point: BestSetPoint, flights: int) -> str:
    """Why no set-point is named for a price, and what would do; empty where one is."""
    if not point.agrees:
        return "no advice: it depends on lift nearer than measured; measure nearer"
    if point.resolved:
        return ""
    enough = (
        f"about {plain(point.flights_needed, 2)} would"
        if point.flights_needed
        else f"{MOST_FLIGHTS / 1e6:g} million would not either"
    )
    return f"not resolved by {flights} flights; {enough}"
