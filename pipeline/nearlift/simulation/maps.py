"""Crash rate over two dimensionless groups, derivative gain and noise, all others as flown."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.simulation import safety
from nearlift.simulation.curve import tabulate
from nearlift.simulation.flight import Map, Plan, Scheme, Setting, fly
from nearlift.simulation.groups import Groups

#: Times the flown groups; equally spaced on logarithmic axes.
FACTORS = np.round(np.geomspace(1 / 3, 3, 11), 6)
FLIGHTS = 150
TARGETS: dict[Boundary, float] = {"ground": 1.0, "ceiling": 2.0}
#: The largest gain makes a loop three times as fast, so the step is halved.
FINER = 2


def scan(
    boundary: Boundary,
    ratio: Callable[[FloatArray], FloatArray],
    model: str,
    bound: float,
    *,
    groups: Groups,
    scheme: Scheme,
    steps_per_hold: int,
    step_s: float,
    key: int,
    spread: Map = map,
) -> list[dict[str, Any]]:
    """Rows of crash_map.parquet: beta (with alpha and gamma in proportion, so that the loop keeps its shape) against noise."""
    target = max(TARGETS[boundary], bound)
    pairs = [(g, n) for g in FACTORS for n in FACTORS]
    settings = [
        Setting(
            target_z_hat=target,
            groups=groups.with_groups(alpha=groups.alpha * g, beta=groups.beta * g, gamma=groups.gamma * g, noise=groups.noise * n),
        )
        for g, n in pairs
    ]
    plan = Plan(boundary=boundary, settings=settings, curves=tabulate([ratio], bound), scheme=scheme, steps_per_hold=FINER * steps_per_hold)
    crashes = (fly(plan, FLIGHTS, key, spread) >= 0).sum(axis=1)
    low, high = safety.binomial90(crashes, FLIGHTS)
    return [
        {
            "boundary": boundary,
            "model": model,
            "target_z_hat": target,
            "beta": abs(s.groups.beta),
            "noise": s.groups.noise,
            "flights": FLIGHTS,
            "crashes": int(crashes[i]),
            "rate": float(crashes[i] / FLIGHTS),
            "lo90": float(low[i]),
            "hi90": float(high[i]),
        }
        for i, s in enumerate(settings)
    ]
