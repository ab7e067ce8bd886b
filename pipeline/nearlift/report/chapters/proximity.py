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
from nearlift.report.number import Number, cite
from nearlift.rounding import plain


def facts(evidence: Evidence) -> dict[str, Any]:
    """A row for each boundary: range by averaging time with weight and supply known best, and with
    each known worst; and the readings.
    """
    content, table = evidence.document(PROXIMITY), evidence.table(DETECTION)
    rows = []
    for side in (b for b in BOUNDARIES if b in content["boundaries"]):
        own = content["boundaries"][side]
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
                "largest": cite(
                    evidence,
                    PROXIMITY,
                    "boundaries",
                    side,
                    "largest_change",
                    scale=100,
                    digits=2,
                    how="in percent",
                ),
                "nearest": cite(
                    evidence, PROXIMITY, "boundaries", side, "measured_z_hat", "0", digits=2
                ),
                "cells": cells,
                "refused": own.get("refused", ""),
            }
        )
    longest = max(table["averaging_s"].tolist(), default=0.0)
    rates = {
        k: cite(evidence, PROXIMITY, k, scale=100, digits=2, how="in percent")
        for k in ("false_alarm_rate", "miss_rate")
    }
    return {
        "rows": rows,
        "readings": [_reading(evidence, i, r) for i, r in enumerate(content["readings"])],
        "longest": f"{longest:g}",
        **rates,
    }


def cases(table: Any, mine: Any) -> list[tuple[str, float, float]]:
    """What weight and supply are known to, in words, with both as fractions: best known, and each
    alone at its worst.
    """
    payloads, voltages = (
        sorted({float(v) for v in table[k][mine]}) for k in ("payload", "voltage")
    )
    found = [(case(payloads[0], voltages[0]), payloads[0], voltages[0])]
    if len(payloads) > 1:
        found.append((case(payloads[-1], voltages[0]), payloads[-1], voltages[0]))
    if len(voltages) > 1:
        found.append((case(payloads[0], voltages[-1]), payloads[0], voltages[-1]))
    return found


def _reading(evidence: Evidence, i: int, found: dict[str, Any]) -> dict[str, Any]:
    told: dict[str, Any] = {"boundary": found["boundary"], "refused": found.get("refused", "")}
    if told["refused"]:
        return told

    def number(*path: str, digits: int = 3, **further: Any) -> Number:
        return cite(evidence, PROXIMITY, "readings", str(i), *path, digits=digits, **further)

    beyond = number("beyond", scale=100, digits=2, how="in percent")
    return told | {
        "throttle": number("throttle", scale=100, how="in percent")
        if found["throttle"] is not None
        else None,
        "ratio": number("ratio", digits=4),
        "u": number("u", digits=2),
        "beyond": replace(beyond, text="< 0.01") if found["beyond"] < inverse.NONE else beyond,
        **{name: number("z_hat", name) for name in ("median", "lo90", "hi90")},
        "z_mm": number("z_m", "median", scale=1e3, how="in mm"),
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
