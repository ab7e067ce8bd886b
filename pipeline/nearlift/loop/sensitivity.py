"""Sensitivity of a diagnosis of few trials: what was searched for, and the detection limits."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from nearlift.loop.families import STEP, families
from nearlift.loop.foresight import Foresight
from nearlift.loop.handle import LIMIT_POWER, Handle, handles
from nearlift.loop.search_problem import SearchProblem
from nearlift.results.outlook import DetectionLimit, Sensitivity
from nearlift.rounding import plain


def sensitivity(stage: SearchProblem, seen: Collection[str] = ()) -> Sensitivity:
    """Families and effects searched for, and the detection limits of the effects.

    Limits hold about the base fit, which is wrong where an effect was `seen`: those are left out.
    """
    foresight, data = Foresight(stage=stage), stage.data
    declared = (data.u_lift_N / data.lift_N) ** 2 / stage.space.covariance.variance
    listed = [
        _limit(foresight, handle)
        for effect in foresight.candidates
        if effect.name not in seen
        for handle in handles(effect)
    ]
    return Sensitivity(
        trials=data.n,
        families=tuple(dict.fromkeys(f.name for f in families(data) if f.name != STEP)),
        effects=tuple(e.name for e in foresight.candidates),
        chance=LIMIT_POWER,
        declared_share=float(np.median(declared)),
        limits=tuple(
            sorted(listed, key=lambda row: (row.size is None, (row.size or 0.0) / row.plausible))
        ),
    )


def _limit(foresight: Foresight, handle: Handle) -> DetectionLimit:
    """Detection limit of one effect's parameter, at a power of `LIMIT_POWER`."""
    size, parameter, text = foresight.limit(handle), handle.parameter, handle.effect.name
    if size is not None:
        unit = "" if parameter.unit == "1" else f" {parameter.unit}"
        away = "" if parameter.value == 0 else f" away from {plain(parameter.value, 3)}"
        text += f" of {parameter.name} ≥ {plain(size, 2)}{unit}{away}"
    return DetectionLimit(
        effect=handle.effect.name,
        parameter=parameter.name,
        unit=parameter.unit,
        size=size,
        plausible=handle.plausible,
        text=text,
    )
