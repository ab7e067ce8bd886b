"""The chapter on safety: crash rates by the paper's models and by the fitted ones, risk against
energy, roll near a wall.
"""

from __future__ import annotations

from nearlift.declare import BOUNDARIES
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.stages.simulate import SAFETY

#: Assumptions on the loss of lift of the two pairs of rotors next to a wall.
ROLLS = {
    "near_pair_only": "the near pair alone loses lift",
    "same_law": "both pairs lose by one law, each over its own gap",
}


def facts(evidence: Evidence) -> dict[str, object]:
    """safety.json, each preset with its worst step test, and the boundaries that were flown."""
    root = Place(evidence, SAFETY)
    return {
        "root": root,
        "presets": [_preset(place) for place in root.every("presets")],
        "fitted": [root.at("fitted", b) for b in BOUNDARIES if b in root.content["fitted"]],
        "rolls": ROLLS,
    }


def _preset(place: Place) -> dict[str, object]:
    tests = [boundary.at("convergence") for boundary in place.every("boundaries")]
    return {
        "place": place,
        "converged": all(test.content["converged"] for test in tests),
        "worst": max(tests, key=lambda test: test.content["worst"]),
    }
