"""Sample time histories: flights that show what the boundary changes, chosen by a rule and not by
eye.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary
from nearlift.flight.simulation import groups, presets
from nearlift.flight.simulation.curve import tabulate
from nearlift.flight.simulation.flight import Plan, Setting, fly, steps_per_hold, trace

#: Set-points of Fig. 6a and b: near the middle of what the model changes.
SHOWN: dict[Boundary, float] = {"ground": 1.0, "ceiling": 1.75}
#: So many flights are looked through, and so many shown.
LOOKED_AT, PICKED = 60, 2


def paper(preset: presets.Preset, boundary: Boundary, key: int) -> list[dict[str, Any]]:
    """Rows of flights.parquet: the first flights in which model and no model end differently, each
    flown with both.

    Above a ground those that crash only without the model, below a ceiling those that crash only
    with it: the rule is the paper's own illustration. All flights together are in the crash rates.
    """
    model = catalogue.model(presets.MODELS[boundary])
    geometry = {n: presets.GEOMETRY[n] for n in model.needs}
    curves = tabulate([np.ones_like, lambda z: model(z, **geometry)], presets.BOUND_Z_HAT)
    own = groups.of(preset.craft, preset.gains(boundary), preset.disturbance, preset.duration_s)
    plan = Plan(
        boundary=boundary,
        settings=[Setting(target_z_hat=SHOWN[boundary], groups=own, curve=c) for c in (0, 1)],
        curves=curves,
        scheme=preset.scheme,
        steps_per_hold=steps_per_hold(preset.disturbance.hold_s, preset.step_s),
    )
    ended = fly(plan, LOOKED_AT, key)
    bad, good = (0, 1) if boundary == "ground" else (1, 0)
    picked = np.flatnonzero((ended[bad] >= 0) & (ended[good] < 0))[:PICKED]
    rows = []
    for flight in picked.tolist():
        for name, heights in zip(("none", model.name), trace(plan, flight, key), strict=True):
            alive = np.flatnonzero(np.isfinite(heights))
            rows += [
                {
                    "preset": preset.name,
                    "boundary": boundary,
                    "model": name,
                    "target_z_hat": SHOWN[boundary],
                    "flight": flight,
                    "t_s": k * preset.disturbance.hold_s,
                    "z_hat": float(heights[k]),
                }
                for k in alive.tolist()
            ]
    return rows
