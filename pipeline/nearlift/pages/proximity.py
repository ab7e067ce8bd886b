"""The chapter on proximity: how far away a boundary shows, and what would have to be better."""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import BOUNDARIES
from nearlift.pages.number import Number, cite
from nearlift.products import DETECTION, PROXIMITY
from nearlift.summaries.evidence import Evidence
from nearlift.summaries.rounding import plain


def facts(evidence: Evidence) -> dict[str, Any]:
    """A row for each boundary: range by averaging time with the payload known best, and with it known worst."""
    content, table = evidence.document(PROXIMITY), evidence.table(DETECTION)
    rows = []
    for side in (b for b in BOUNDARIES if b in content["boundaries"]):
        own = content["boundaries"][side]
        mine = table["boundary"] == side
        payloads = sorted({float(p) for p in table["payload"][mine]})
        cells = []
        for payload in (payloads[0], payloads[-1]):
            at = mine & (table["payload"] == payload)
            best = int(np.flatnonzero(at)[np.argmax(table["averaging_s"][at])])
            cells.append({"payload": f"{100 * payload:g} %", **{k: _row(table, best, k) for k in ("range_z_hat", "lo90", "hi90", "needed")}})
        rows.append(
            {
                "boundary": side,
                "largest": cite(evidence, PROXIMITY, "boundaries", side, "largest_change", scale=100, digits=2, how="in percent"),
                "nearest": cite(evidence, PROXIMITY, "boundaries", side, "measured_z_hat", "0", digits=2),
                "cells": cells,
                "refused": own.get("refused", ""),
            }
        )
    longest = max(table["averaging_s"].tolist(), default=0.0)
    rates = {k: cite(evidence, PROXIMITY, k, scale=100, digits=2, how="in percent") for k in ("false_alarm_rate", "miss_rate")}
    return {"rows": rows, "longest": f"{longest:g}", **rates}


def _row(table: Any, i: int, name: str) -> Number:
    value = float(table[name][i])
    scale = 100 if name == "needed" else 1
    return Number(text=plain(scale * value, 2) if np.isfinite(value) else "nowhere", value=value, source=DETECTION.file, how=f"{name}, row {i}")
