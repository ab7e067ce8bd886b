"""Proximity: the distance at which a boundary shows in lift."""

from __future__ import annotations

import math

from markupsafe import Markup

from nearlift.declare import BOUNDARIES
from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.number import Place
from nearlift.rounding import plain
from nearlift.stages.detect import DETECTION, PROXIMITY


def facts(evidence: Evidence) -> Markup:
    """Distance of significance of each boundary, and detection ranges."""
    root = Place(evidence, PROXIMITY)
    sides = [p for side in BOUNDARIES if (p := root.at("boundaries", side)).content]
    heads = (
        *("boundary", "change of lift, %", "within ẑ", "90 %", "largest change measured, %"),
        "at ẑ",
    )
    return blocks.join(
        blocks.table("Distance of a significant change of lift", heads, map(_significant, sides)),
        *(_ranges(evidence, side) for side in sides),
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


def _ranges(evidence: Evidence, side: Place) -> Markup:
    """Detection range by averaging time, for each uncertainty of weight or supply alone."""
    every = evidence.frame(DETECTION, boundary=side.path[-1])
    alone = (every[["voltage", "payload"]] == every[["voltage", "payload"]].min()).any(axis=1)
    ranges = every[alone].pivot(
        index=["voltage", "payload"], columns="averaging_s", values="range_z_hat"
    )
    rows = [
        (
            *(f"{100 * u:.3g}" for u in (payload, voltage)),
            *("none" if math.isnan(z) else plain(z, 3) for z in far),
        )
        for voltage, payload, *far in ranges.reset_index().to_numpy(dtype=float)
    ]
    times = (f"{plain(float(t), 3)} s" for t in ranges.columns)
    caption = f"{side.title}: farthest ẑ detected, by averaging time"
    heads = ("u(weight), %", "u(supply voltage), %", *times)
    return blocks.table(caption, heads, rows, source=DETECTION.file)
