"""What a diagnosis of few trials could have seen: the families and effects that they carry, and of
each effect the size that would have shown.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.loop.families import STEP, families
from nearlift.loop.foresight import LIMIT_POWER, Foresight, Handle, handles
from nearlift.loop.search_problem import SearchProblem
from nearlift.rounding import plain


def sensitivity(stage: SearchProblem, seen: Collection[str] = ()) -> dict[str, Any]:
    """The block `sensitivity` of a boundary in diagnosis.json: what was searched, and the detection
    limit of each candidate.

    Limits are about the base fit, so those of effects that were `seen` would say nothing.
    """
    foresight = Foresight(stage=stage, seed=stage.options.seed)
    listed = [
        _limit(foresight, handle)
        for effect in foresight.candidates
        if effect.name not in seen
        for handle in handles(effect)
    ]
    return {
        "trials": stage.data.n,
        "families": list(dict.fromkeys(f.name for f in families(stage.data) if f.name != STEP)),
        "effects": [e.name for e in foresight.candidates],
        "chance": LIMIT_POWER,
        "declared_share": float(np.median(_declared(stage))),
        "limits": sorted(
            listed, key=lambda row: (row["size"] is None, (row["size"] or 0.0) / row["plausible"])
        ),
    }


def _declared(stage: SearchProblem) -> FloatArray:
    """What part of each trial's variance came with it, (n,)."""
    data = stage.data
    share: FloatArray = (data.u_lift_N / data.lift_N) ** 2 / stage.space.covariance.variance
    return share


def _limit(foresight: Foresight, handle: Handle) -> dict[str, Any]:
    """The size of one effect that is seen with a chance of 80 %, also in words; null where none
    that is possible is.
    """
    size, parameter = foresight.limit(handle), handle.parameter
    unit = "" if parameter.unit == "1" else f" {parameter.unit}"
    row = {
        "effect": handle.effect.name,
        "parameter": parameter.name,
        "unit": parameter.unit,
        "size": size,
        "plausible": handle.plausible,
    }
    if size is None:
        return {**row, "text": handle.effect.name}
    away = "" if parameter.value == 0 else f" away from {plain(parameter.value, 3)}"
    return {
        **row,
        "text": f"{handle.effect.name} of {parameter.name} ≥ {plain(size, 2)}{unit}{away}",
    }
