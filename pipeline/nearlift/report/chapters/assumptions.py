"""What the ratio takes for granted: throttle, held quantity, rotor coefficient."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from nearlift.declare import Boundary
from nearlift.products import FIT
from nearlift.report.evidence import Evidence
from nearlift.report.figures.assumptions import entry
from nearlift.report.number import Number, cite, quote

TESTS = {
    "coefficient": "one coefficient",
    "curve": "one curve",
    "cells": "same ΔL per cell, no model",
}


def facts(evidence: Evidence) -> dict[str, Any]:
    """The three questions, each with a line per boundary."""
    return {
        "collapse": [
            _collapse(evidence, b)
            for b in evidence.boundaries
            if entry(evidence, "throttle_collapse", b)
        ],
        "held": [
            _held(evidence, b) for b in evidence.boundaries if entry(evidence, "held_quantity", b)
        ],
        "rotor": [
            _rotor(evidence, b)
            for b in evidence.boundaries
            if entry(evidence, "rotor_coefficient", b)
        ],
        "tests": list(TESTS.values()),
    }


def _chance(evidence: Evidence, *path: str) -> Number:
    """A p-value; below a thousandth only that."""
    found = cite(evidence, FIT, *path, digits=2)
    return replace(found, text="< 0.001", how="below a thousandth") if found.value < 1e-3 else found


def _collapse(evidence: Evidence, boundary: Boundary) -> dict[str, Any]:
    path = ("throttle_collapse", boundary)
    found = entry(evidence, *path)

    def percent(what: str) -> Number | None:
        departure = found["largest_departure"][what]
        if departure is None:
            return None
        digits = 2 if departure["bound95"] < 1 else 3
        return cite(
            evidence,
            FIT,
            *path,
            "largest_departure",
            what,
            "bound95",
            digits=digits,
            scale=100,
            how="in percent",
        )

    return {
        "boundary": boundary,
        "text": found["text"],
        "p": [
            None if found["tests"][t] is None else _chance(evidence, *path, "tests", t, "p_value")
            for t in TESTS
        ],
        "name": found["coefficient"],
        "of_coefficient": percent("coefficient"),
        "of_lift": percent("delta_L"),
    }


def _held(evidence: Evidence, boundary: Boundary) -> dict[str, Any]:
    path = ("held_quantity", boundary)
    found = entry(evidence, *path)
    rows = [
        {
            "supposes": e["supposes"],
            "n": cite(evidence, FIT, *path, "plausible", str(i), "n", digits=2),
            "value": cite(evidence, FIT, *path, "plausible", str(i), "value", like_u=e["u"]),
            "lo90": cite(evidence, FIT, *path, "plausible", str(i), "lo90", like_u=e["u"]),
            "hi90": cite(evidence, FIT, *path, "plausible", str(i), "hi90", like_u=e["u"]),
            "p": _chance(evidence, *path, "plausible", str(i), "p_value"),
        }
        for i, e in enumerate(found["plausible"])
    ]
    return {
        "boundary": boundary,
        "declared": found["declared_text"],
        "text": found["text"],
        "name": found["coefficient"],
        "rows": rows,
    }


def _rotor(evidence: Evidence, boundary: Boundary) -> dict[str, Any]:
    path = ("rotor_coefficient", boundary)
    found = entry(evidence, *path)
    rows = [
        {
            "throttle": f"{100 * float(t):.4g} %",
            "speed": cite(evidence, FIT, *path, "per_throttle", t, "speed_Hz", digits=4),
            "C_L": quote(evidence, FIT, *path, "per_throttle", t),
        }
        for t in found.get("per_throttle", {})
    ]
    return {"boundary": boundary, "text": found["text"], "rows": rows}
