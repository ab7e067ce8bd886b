"""The chapter on proximity: how far away a boundary shows, and what would have to be better."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from nearlift.declare import BOUNDARIES
from nearlift.flight.proximity import inverse
from nearlift.products import DETECTION, PROXIMITY
from nearlift.report.evidence import Evidence
from nearlift.report.figures.detection import case
from nearlift.report.number import Number, Place
from nearlift.rounding import plain


def facts(evidence: Evidence) -> dict[str, object]:
    """A row for each boundary: range by averaging time with weight and supply known best, and with
    each known worst; and the readings.
    """
    content, table = evidence.document(PROXIMITY), evidence.table(DETECTION)
    root = Place(evidence, PROXIMITY)
    rows = []
    for side in (b for b in BOUNDARIES if b in content["boundaries"]):
        detected = content["boundaries"][side]
        mine = table["boundary"] == side
        cells = []
        for words, payload, voltage in cases(table, mine):
            at = mine & (table["payload"] == payload) & (table["voltage"] == voltage)
            best = int(np.flatnonzero(at)[np.argmax(table["averaging_s"][at])])
            cells.append(
                {
                    "case": words,
                    **{k: _row(table, best, k) for k in ("range_z_hat", "lo90", "hi90", "needed")},
                }
            )
        rows.append(
            {
                "boundary": side,
                "largest": root.percent("boundaries", side, "largest_change", digits=2),
                "nearest": root.number("boundaries", side, "measured_z_hat", 0, digits=2),
                "cells": cells,
                "change": root.percent("boundaries", side, "significant", "change", digits=2),
                "significant": [
                    root.number("boundaries", side, "significant", k, digits=2)
                    for k in ("z_hat", "lo90", "hi90")
                ]
                if detected["significant"]["z_hat"] is not None
                else None,
                "noticed": _noticed(root, side, content["averaging_s"]),
                "refused": detected.get("refused", ""),
            }
        )
    longest = max(table["averaging_s"].tolist(), default=0.0)
    rates = {k: root.percent(k, digits=2) for k in ("false_alarm_rate", "miss_rate")}
    return {
        "rows": rows,
        "readings": [_reading(root.at("readings", i)) for i in range(len(content["readings"]))],
        "longest": f"{longest:g}",
        "delay": f"{content['averaging_s']:g}",
        "alarms": root.number("false_alarms_per_hour", digits=2),
        **rates,
    }


def _noticed(root: Place, side: str, within_s: float) -> Number | None:
    """The farthest height at which the sequential test takes no longer than that."""
    heights = root.content["boundaries"][side]["noticed"]
    in_time = [
        i for i, n in enumerate(heights) if n["delay_s"] is not None and n["delay_s"] <= within_s
    ]
    return (
        root.number("boundaries", side, "noticed", in_time[-1], "z_hat", digits=2)
        if in_time
        else None
    )


def cases(table: Any, mine: Any) -> list[tuple[str, float, float]]:
    """What weight and supply are known to, in words, with both as fractions: best known, and each
    alone at its worst.
    """
    payloads, voltages = (
        sorted({float(v) for v in table[k][mine]}) for k in ("payload", "voltage")
    )
    best = payloads[0], voltages[0]
    known = dict.fromkeys([best, (payloads[-1], best[1]), (best[0], voltages[-1])])
    return [(case(payload, voltage), payload, voltage) for payload, voltage in known]


def _reading(place: Place) -> dict[str, object]:
    reading = place.content
    row: dict[str, object] = {
        "boundary": reading["boundary"],
        "refused": reading.get("refused", ""),
    }
    if row["refused"]:
        return row

    beyond = place.percent("beyond", digits=2)
    known = reading["throttle"] is not None
    return row | {
        "throttle": place.percent("throttle", digits=3) if known else None,
        "ratio": place.number("ratio", digits=4),
        "u": place.number("u", digits=2),
        "beyond": replace(beyond, text="< 0.01") if reading["beyond"] < inverse.NONE else beyond,
        **place.at("z_hat").numbers("median", "lo90", "hi90", digits=3),
        "z_mm": place.number("z_m", "median", digits=3, scale=1e3, how="in mm"),
    }


def _row(table: Any, i: int, name: str) -> Number:
    value = float(table[name][i])
    scale = 100 if name == "needed" else 1
    return Number(
        text=plain(scale * value, 2) if np.isfinite(value) else "nowhere",
        value=value,
        source=DETECTION.file,
        how=f"{name}, row {i}",
    )
