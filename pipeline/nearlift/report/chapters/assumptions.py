"""Assumptions behind Delta L: throttle, held quantity, rotor coefficient."""

from __future__ import annotations

from dataclasses import replace

from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place
from nearlift.stages.fit import FIT

TESTS = {
    "coefficient": "one coefficient",
    "curve": "one curve",
    "cells": "same ΔL per cell, no model",
}


def facts(evidence: Evidence) -> dict[str, object]:
    """Results on each assumption, for the boundaries that have one."""
    questions = {
        "collapse": "throttle_collapse",
        "held": "held_quantity",
        "rotor": "rotor_coefficient",
    }
    return {
        name: [
            place
            for b in evidence.boundaries
            if (place := Place(evidence, FIT, (question, b))).content
        ]
        for name, question in questions.items()
    } | {"tests": TESTS, "chance": chance}


def chance(place: Place) -> Number:
    """A p-value; below a thousandth only that."""
    p = place.number("p_value", digits=2)
    return replace(p, text="< 0.001", how="below a thousandth") if p.value < 1e-3 else p
