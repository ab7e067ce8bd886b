"""What the ratio takes for granted: throttle, held quantity, rotor coefficient."""

from __future__ import annotations

from dataclasses import replace

from nearlift.products import FIT
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place

TESTS = {
    "coefficient": "one coefficient",
    "curve": "one curve",
    "cells": "same ΔL per cell, no model",
}


def facts(evidence: Evidence) -> dict[str, object]:
    """The three questions, each with a line per boundary."""

    def asked(question: str) -> list[Place]:
        places = [Place(evidence, FIT, (question, b)) for b in evidence.boundaries]
        return [place for place in places if place.content]

    return {
        "collapse": [_collapse(place) for place in asked("throttle_collapse")],
        "held": [_held(place) for place in asked("held_quantity")],
        "rotor": [_rotor(place) for place in asked("rotor_coefficient")],
        "tests": list(TESTS.values()),
    }


def _chance(place: Place, *below: str | int) -> Number:
    """A p-value; below a thousandth only that."""
    p = place.number(*below, digits=2)
    return replace(p, text="< 0.001", how="below a thousandth") if p.value < 1e-3 else p


def _collapse(place: Place) -> dict[str, object]:
    collapse = place.content

    def percent(what: str) -> Number | None:
        departure = collapse["largest_departure"][what]
        if departure is None:
            return None
        digits = 2 if departure["bound95"] < 1 else 3
        return place.percent("largest_departure", what, "bound95", digits=digits)

    return {
        "boundary": place.path[-1],
        "text": collapse["text"],
        "p": [
            None if collapse["tests"][t] is None else _chance(place, "tests", t, "p_value")
            for t in TESTS
        ],
        "name": collapse["coefficient"],
        "of_coefficient": percent("coefficient"),
        "of_lift": percent("delta_L"),
    }


def _held(place: Place) -> dict[str, object]:
    held = place.content
    rows = []
    for i, e in enumerate(held["plausible"]):
        at = place.at("plausible", i)
        rows.append(
            {
                "supposes": e["supposes"],
                "n": at.number("n", digits=2),
                **at.numbers("value", "lo90", "hi90", like_u=e["u"]),
                "p": _chance(at, "p_value"),
            }
        )
    return {
        "boundary": place.path[-1],
        "declared": held["declared_text"],
        "text": held["text"],
        "name": held["coefficient"],
        "rows": rows,
    }


def _rotor(place: Place) -> dict[str, object]:
    rotor = place.content
    rows = [
        {
            "throttle": f"{100 * float(t):.4g} %",
            "speed": place.number("per_throttle", t, "speed_Hz", digits=4),
            "C_L": place.quote("per_throttle", t),
        }
        for t in rotor.get("per_throttle", {})
    ]
    return {"boundary": place.path[-1], "text": rotor["text"], "rows": rows}
