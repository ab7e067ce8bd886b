"""What each model's parameters were before the data and are after: 90 % intervals, in units of the
prior's.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import BOUNDARIES
from nearlift.products import FIT
from nearlift.rounding import plain
from nearlift.summaries.evidence import Columns, Evidence

#: Above this ratio of widths the prior still has a say; as `fit.learnt` has it.
SHAPED = 0.3


def summarise(evidence: Evidence) -> Columns:
    """A row for each parameter of each fitted model, base models first.

    Returns
    -------
    dict of arrays
        `panel` (boundary), `model` (its title), `base` (1 or 0), `parameter`, `prior_lo90`,
        `prior_hi90`, `lo90`, `median`, `hi90` in the parameter's unit, the last three again as
        `low`, `middle`, `high` with the prior's interval going from 0 to 1, and `ratio`, the
        posterior's width over the prior's.
    """
    content = evidence.document(FIT)
    rows: list[dict[str, Any]] = []
    for boundary in (b for b in BOUNDARIES if b in content["boundaries"]):
        base = content["base"][boundary]
        fits = content["boundaries"][boundary]
        for model in (base, *(m for m in fits if m != base)):
            for name, entry in fits[model].get("posterior", {}).get("parameters", {}).items():
                prior = entry["prior"]
                width = prior["hi90"] - prior["lo90"]
                row: dict[str, Any] = {
                    "panel": boundary,
                    "model": fits[model]["title"],
                    "base": int(model == base),
                    "parameter": name,
                }
                row |= {
                    "prior_lo90": prior["lo90"],
                    "prior_hi90": prior["hi90"],
                    **{k: entry[k] for k in ("lo90", "median", "hi90")},
                }
                place = {"low": "lo90", "middle": "median", "high": "hi90"}
                row |= {k: (entry[v] - prior["lo90"]) / width for k, v in place.items()}
                rows.append(row | {"ratio": entry["width_ratio"]})
    text = ("panel", "model", "parameter")
    return (
        {k: np.array([r[k] for r in rows], dtype=object if k in text else None) for k in rows[0]}
        if rows
        else {}
    )


def caption(evidence: Evidence, table: Columns) -> str:
    """What the reader must know to read the figure, numbers included."""
    shaped = table["ratio"] > SHAPED
    kept = zip(
        table["parameter"][shaped], table["model"][shaped], table["ratio"][shaped], strict=True
    )
    told = (
        f"{int(shaped.sum())} of {len(shaped)} parameters keep more than {100 * SHAPED:.0f} % of"
        " their prior's width: " + ", ".join(f"{p} of {m} ({100 * r:.0f} %)" for p, m, r in kept)
        if shaped.any()
        else (
            f"All {len(shaped)} parameters are known to better than {100 * SHAPED:.0f} % of their"
            " prior's width"
        )
    )
    return (
        "Grey: each parameter's central 90 % before the data, from its declared prior, drawn from"
        " 0 to 1. Black: the same after the data, with the median; the number is the ratio of the"
        f" widths. {told}. An interval beside the grey says that prior and data disagree."
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    least, most = float(table["ratio"].min()), float(table["ratio"].max())
    times = f"{plain(least, 2)} to {plain(most, 2)} times as wide as the prior"
    return (
        f"Prior and posterior intervals of {len(table['ratio'])} parameters; the posterior is"
        f" {times}."
    )
