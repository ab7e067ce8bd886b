"""The chapter on proximity: how far away a boundary shows, and what would have to be better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from nearlift.declare import BOUNDARIES
from nearlift.flight.detection import MIN_BEYOND
from nearlift.report import blocks
from nearlift.report.evidence import Columns, Evidence
from nearlift.report.figures.detection import case
from nearlift.report.number import Number, Place
from nearlift.rounding import plain
from nearlift.stages.detect import DETECTION, PROXIMITY


def facts(evidence: Evidence) -> Markup:
    """Distance of significance and detection range of each boundary, and readings of the manifest.

    The range is by averaging time, with weight and supply known best and each known worst.
    """
    root, table = Place(evidence, PROXIMITY), evidence.table(DETECTION)
    sides = [p for side in BOUNDARIES if (p := root.at("boundaries", side)).content]
    cells = {str(p.key): _cells(table, str(p.key)) for p in sides}
    heads = ["boundary", "largest change of lift measured, %"]
    for words, *_ in cells[str(sides[0].key)] if sides else ():
        heads += [f"range, {words}", f"change needed, {words}, %"]
    rows = [
        (
            str(p.key).capitalize(),
            Markup("{} at ẑ = {}").format(
                p.percent("largest_change", digits=2), p.number("measured_z_hat", 0, digits=2)
            ),
            *(cell for _, *mine in cells[str(p.key)] for cell in mine),
        )
        for p in sides
    ]
    caption = "Detection range of each boundary"
    longest = max(table["averaging_s"].tolist(), default=0.0)
    return blocks.join(
        blocks.items(map(_significant, sides), ""),
        blocks.figure("detection"),
        blocks.fold(
            "Detection from lift alone, by the uncertainty of weight and supply",
            blocks.paragraph(
                "Detection range from lift alone, or from the hover throttle, with {} % false"
                " alarms and {} % misses, averaging over {:g} s: ẑ with its 90 % interval. A lower"
                " end of 0 means that the boundary may go undetected.",
                root.percent("false_alarm_rate", digits=2),
                root.percent("miss_rate", digits=2),
                longest,
            ),
            blocks.table(caption, heads, rows, hidden=True),
        ),
        *(
            blocks.paragraph(
                "{}: no distance from lift: {}.",
                str(p.key).capitalize(),
                p.content["refused"],
                note=True,
            )
            for p in sides
            if p.content.get("refused")
        ),
        blocks.table(
            "Readings of the manifest: distance of the boundary, if there is one (90 %), and"
            " probability of none within the measured distances (50 % before the reading)",
            ("boundary", "reading", "L/L∞", "ẑ", "mm", "none, %"),
            [_reading(r) for r in root.every("readings")],
        ),
    )


def _significant(side: Place) -> Markup:
    seen = side.at("significant")
    known = seen.content["z_hat"] is not None
    where = (
        Markup("within ẑ = {}{}").format(
            seen.number("z_hat", digits=2), blocks.span("90 %: {}", seen.ends(digits=2))
        )
        if known
        else "at no distance that was measured"
    )
    return Markup("{}: lift changes by more than {} % {}.").format(
        str(side.key).capitalize(), seen.percent("change", digits=2), where
    )


def _reading(r: Place) -> tuple[object, ...]:
    side, refused, z = r.content["boundary"].capitalize(), r.content.get("refused"), r.at("z_hat")
    if refused:
        return side, refused
    hover = r.content["throttle"] is not None
    return (
        side,
        Markup("hover at {} % throttle").format(r.percent("throttle", digits=3))
        if hover
        else "lift ratio",
        Markup("{} ± {}").format(r.number("ratio"), r.number("u", digits=2)),
        Markup("{}{}").format(z.number("median", digits=3), blocks.span("{}", z.ends(digits=3))),
        r.number("z_m", "median", digits=3, scale=1000, how="in mm"),
        _beyond(r),
    )


def _cells(table: Columns, side: str) -> list[tuple[object, ...]]:
    """Words, range and needed change of each case."""
    mine = table["boundary"] == side
    cells: list[tuple[object, ...]] = []
    for words, payload, voltage in cases(table, mine):
        at = mine & (table["payload"] == payload) & (table["voltage"] == voltage)
        best = int(np.flatnonzero(at)[np.argmax(table["averaging_s"][at])])
        reach, low, high, needed = (
            _number(table, best, name) for name in ("range_z_hat", "lo90", "hi90", "needed")
        )
        span = blocks.span("90 %: {} to {}", low, high)
        cells.append((words, Markup("{}{}").format(reach, span), needed))
    return cells


def cases(table: Columns, mine: NDArray[np.bool_]) -> list[tuple[str, float, float]]:
    """Uncertainties of weight and supply, in words, with both as fractions: best known, and each
    alone at its worst.
    """
    payloads, voltages = (
        sorted({float(v) for v in table[k][mine]}) for k in ("payload", "voltage")
    )
    best = payloads[0], voltages[0]
    known = dict.fromkeys([best, (payloads[-1], best[1]), (best[0], voltages[-1])])
    return [(case(payload, voltage), payload, voltage) for payload, voltage in known]


def _beyond(reading: Place) -> Number:
    """How likely there is no boundary within the distances measured."""
    beyond = reading.percent("beyond", digits=2)
    return replace(beyond, text="< 0.01") if beyond.value < MIN_BEYOND else beyond


def _number(table: Columns, i: int, name: str) -> Number:
    value = float(table[name][i])
    scale = 100 if name == "needed" else 1
    return Number(
        text=plain(scale * value, 2) if np.isfinite(value) else "at no distance",
        value=value,
        source=DETECTION.file,
        how=f"{name}, row {i}",
    )
