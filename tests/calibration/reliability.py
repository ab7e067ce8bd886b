"""Reliability of the stated probabilities: of explanations given 70 to 80 %, as many are true.

    python -m tests.calibration.reliability out/calibration.jsonl

Curve and decomposition are CORP (Dimitriadis, Gneiting and Jordan 2021, PNAS 118, e2016191118): the
isotonic regression of truth on probability. Band and test draw the true explanation of every
campaign from its own probabilities.
"""

from __future__ import annotations

import itertools
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import isotonic_regression
from tests.calibration import forms

DRAWS = 999
Row = dict[str, Any]


def entries(row: Row) -> tuple[list[float], list[bool]]:
    """Probabilities of a campaign's explanations, and whether each is true; nameless structure is
    one explanation.
    """
    truth = set(row["truth"])
    outside = bool(truth & {*forms.UNNAMED, *forms.STRANGE})
    listed = [e for e in row["probabilities"] if not e.get("other")]
    unnamed = sum(e["probability"] for e in listed if e.get("nameless"))
    named = [e for e in listed if not e.get("nameless")]
    right = [not outside and set(e["effects"]) == truth for e in named]
    return [unnamed, *(e["probability"] for e in named)], [outside, *right]


def miscalibration(probability: np.ndarray, true: np.ndarray) -> float:
    """Mean squared error less that of the isotonic regression, times the number of entries."""
    order = np.lexsort((true, probability))
    fitted = isotonic_regression(true[order]).x
    return float(np.sum((probability - true) ** 2) - np.sum((fitted - true[order]) ** 2))


def drawn(rows: list[Row], rng: np.random.Generator) -> np.ndarray:
    """Truth of all entries if the probabilities are right: at most one true entry a campaign."""
    truth = []
    for row in rows:
        probability, _ = entries(row)
        which = np.searchsorted(np.cumsum(probability), rng.random())
        truth += [float(i == which) for i in range(len(probability))]
    return np.array(truth)


def reliability(rows: list[Row], seed: int = 0) -> dict[str, Any]:
    """Counts and shares by bins of probability, Brier scores, and the p-value of the joint test."""
    each = [entries(row) for row in rows]
    probability = np.array([p for ps, _ in each for p in ps])
    true = np.array([float(t) for _, ts in each for t in ts])
    best = [int(np.argmax(ps)) for ps, _ in each]
    rng = np.random.default_rng(seed)
    found = miscalibration(probability, true)
    null = [miscalibration(probability, drawn(rows, rng)) for _ in range(DRAWS)]
    edges = np.array([0.0, 0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 1.0 + 1e-9])
    bins = [
        {
            "from": float(low),
            "n": int(mine.sum()),
            "stated": float(probability[mine].mean()),
            "true": float(true[mine].mean()),
        }
        for low, high in itertools.pairwise(edges)
        for mine in [(probability >= low) & (probability < high)]
        if mine.any()
    ]
    # a best name without its probability is one stated with certainty
    certain = [
        float(t if i != b else 1 - t)
        for (_, ts), b in zip(each, best, strict=True)
        for i, t in enumerate(ts)
    ]
    return {
        "campaigns": len(rows),
        "bins": bins,
        "brier": float(np.sum((probability - true) ** 2) / len(rows)),
        "brier_of_best_name": float(np.sum(certain) / len(rows)),
        "p_value": (1 + sum(value >= found for value in null)) / (1 + DRAWS),
    }


if __name__ == "__main__":
    lines = Path(sys.argv[1]).read_text().splitlines()
    rows = [row for row in map(json.loads, lines) if row.get("probabilities")]
    print(json.dumps(reliability(rows), indent=1))
