"""Proximity: the distance at which a boundary shows in lift, and readings of the manifest."""

from __future__ import annotations

from dataclasses import replace

from markupsafe import Markup

from nearlift.declare import BOUNDARIES
from nearlift.flight.proximity import MIN_BEYOND
from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.stages.detect import PROXIMITY


def facts(evidence: Evidence) -> Markup:
    """Distance of significance of each boundary, the detection range, and the readings."""
    root = Place(evidence, PROXIMITY)
    sides = [p for side in BOUNDARIES if (p := root.at("boundaries", side)).content]
    heads = (
        *("boundary", "change of lift, %", "within ẑ", "90 %", "largest change measured, %"),
        "at ẑ",
    )
    return blocks.join(
        blocks.table("Distance of a significant change of lift", heads, map(_significant, sides)),
        blocks.figure("detection"),
        blocks.table(
            "Readings of the manifest: distance of a boundary (90 %), and probability of none"
            " within the measured distances (prior: 50 %)",
            ("boundary", "reading", "L/L∞", "ẑ", "mm", "none, %"),
            [_reading(r) for r in root.every("readings")],
        ),
    )


def _significant(side: Place) -> tuple[object, ...]:
    seen = side.at("significant")
    known = seen.content["z_hat"] is not None
    return (
        side.title,
        seen.percent("change", digits=2),
        seen.number("z_hat", digits=2) if known else "not measured",
        seen.ends(digits=2) if known else "–",
        side.percent("largest_change", digits=2),
        side.number("measured_z_hat", 0, digits=2),
    )


def _reading(r: Place) -> tuple[object, ...]:
    side, refused, z = r.content["boundary"].capitalize(), r.content.get("refused"), r.at("z_hat")
    if refused:
        return side, refused
    throttle = r.percent("throttle", digits=3)
    beyond = r.percent("beyond", digits=2)
    if beyond.value < MIN_BEYOND:
        beyond = replace(beyond, text="< 0.01")
    return (
        side,
        "lift ratio" if r.content["throttle"] is None else Markup("hover at {} %").format(throttle),
        Markup("{} ± {}").format(r.number("ratio"), r.number("u", digits=2)),
        Markup("{}{}").format(z.number("median", digits=3), blocks.span("{}", z.ends(digits=3))),
        r.number("z_m", "median", digits=3, scale=1000, how="in mm"),
        beyond,
    )
