"""The chapter on proximity: how far away a boundary shows, and what would have to be better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import BOUNDARIES
from nearlift.flight.detection import MIN_BEYOND
from nearlift.report.evidence import Columns, Evidence
from nearlift.report.figures.detection import case
from nearlift.report.number import Number, Place
from nearlift.rounding import plain
from nearlift.stages.detect import DETECTION, PROXIMITY


def facts(evidence: Evidence) -> dict[str, object]:
    """The whole file, and of each boundary its range by averaging time with weight and supply known
    best, and with each known worst.
    """
    root, table = Place(evidence, PROXIMITY), evidence.table(DETECTION)
    return {
        "root": root,
        "rows": [
            {"place": place, "cells": _cells(table, side)}
            for side in BOUNDARIES
            if (place := root.at("boundaries", side)).content
        ],
        "longest": max(table["averaging_s"].tolist(), default=0.0),
        "beyond": _beyond,
    }


def _cells(table: Columns, side: str) -> list[dict[str, object]]:
    mine = table["boundary"] == side
    cells = []
    for words, payload, voltage in cases(table, mine):
        at = mine & (table["payload"] == payload) & (table["voltage"] == voltage)
        best = int(np.flatnonzero(at)[np.argmax(table["averaging_s"][at])])
        names = ("range_z_hat", "lo90", "hi90", "needed")
        cells.append({"case": words, **{name: _number(table, best, name) for name in names}})
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
