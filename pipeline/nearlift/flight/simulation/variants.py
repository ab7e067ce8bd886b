"""The paper's flights with other gains and other noise: "the relative positioning of the curves
would be unaffected", it says.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.flight.simulation import safety
from nearlift.flight.simulation.curve import Curves
from nearlift.flight.simulation.flight import Map, Plan, Scheme, Setting, fly
from nearlift.flight.simulation.groups import Groups
from nearlift.flight.simulation.sweep import halved

#: Name, factor of all three gains, factor of the noise. The printed scheme bears no larger gains:
#: from 1.2 on, explicit Euler at 0.1 s diverges.
VARIANTS = (
    ("gains x 0.5", 0.5, 1.0),
    ("gains x 0.8", 0.8, 1.0),
    ("noise x 0.7", 1.0, 0.7),
    ("noise x 1.4", 1.0, 1.4),
)
#: The powers that the claims speak of.
EXPONENTS = (0.0, 0.6, 1.0, 1.4)
#: Set-points wide enough for levels of half of the flights in all of them, and close where the
#: converged ground's curves are steep.
TARGETS: dict[Boundary, FloatArray] = {
    "ground": np.round(np.concatenate([np.arange(6, 15) * 0.05, np.arange(4, 12) * 0.2]), 10),
    "ceiling": np.round(np.arange(3, 20) * 0.2, 10),
}
SHARE, LEAST = 0.25, 50
#: Powers whose step is tested, at every so many set-points.
CHECKED, EVERY = (0.0, 1.0), 2


def levels(
    boundary: Boundary,
    curves: Curves,
    exponents: Sequence[float],
    groups: Groups,
    *,
    scheme: Scheme,
    steps_per_hold: int,
    step_s: float,
    flights: int,
    key: int,
    rng: np.random.Generator,
    spread: Map = map,
) -> tuple[dict[tuple[str, float, str], FloatArray], safety.Convergence]:
    """Levels of half of the flights under one resampling, by (boundary, power, variant): arrays
    (m,), the first as flown.

    `exponents` says which power each of the `curves` is. A quarter of the flights are flown; a
    level that the set-points do not hold is nan. With them comes what half the step changes, for
    some powers and set-points of every variant.
    """
    few = min(flights, max(round(SHARE * flights), LEAST))
    targets = TARGETS[boundary]
    keys, settings = [], []
    for name, gain, noise in VARIANTS:
        g = groups.with_groups(
            alpha=gain * groups.alpha,
            beta=gain * groups.beta,
            gamma=gain * groups.gamma,
            noise=noise * groups.noise,
        )
        for k in EXPONENTS:
            keys.append((boundary, k, name))
            settings += [
                Setting(target_z_hat=float(z), groups=g, curve=list(exponents).index(k))
                for z in targets
            ]
    plan = Plan(
        boundary=boundary,
        settings=settings,
        curves=curves,
        scheme=scheme,
        steps_per_hold=steps_per_hold,
    )
    crashed = fly(plan, few, key, spread) >= 0
    again = [
        i * len(targets) + j
        for i, (_, k, _) in enumerate(keys)
        if k in CHECKED
        for j in range(0, len(targets), EVERY)
    ]
    weights = safety.resamples(few, rng)
    each = zip(keys, crashed.reshape(len(keys), len(targets), few), strict=True)
    found: dict[tuple[str, float, str], FloatArray] = {
        k: safety.held(targets, safety.levels(targets, c, 0.5, weights)) for k, c in each
    }
    return found, halved(plan, crashed, again, key, step_s, spread)
