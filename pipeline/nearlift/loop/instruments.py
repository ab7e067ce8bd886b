"""What no disturbance of a flight moves, and what therefore tells cause from answer: where the
height was asked to be, time, and what a vehicle does sideways.

In closed loop command, climb and height answer the disturbances that lift is scattered by. The loop
judges flights by what they share with these columns alone: two-stage least squares (Wooldridge
2010, Econometric Analysis of Cross Section and Panel Data, ch. 5).
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit.closed_loop import instruments_of, since_start
from nearlift.likelihood.subspace import cosines
from nearlift.loop.families import BOOKKEEPING, indicators, powers
from nearlift.results import Observations

#: Cosines along the run order, and powers of the time within a start.
SLOW, WITHIN = 8, 3
#: Columns that the controller of height does not touch.
SIDEWAYS = ("command_share_", "level_speed_m_s", "tilt_rad")


def instruments(data: Observations) -> FloatArray | None:
    """Columns (n, q); None of trials that are no flights."""
    known = data.covariates
    if not data.in_flight:
        return None
    history = [values for name, values in sorted(known.items()) if name.startswith(BOOKKEEPING)]
    start = data.flight_start
    aside = [
        powers(values, 2)
        for name, values in sorted(known.items())
        if name.startswith(SIDEWAYS) and np.isfinite(values).all()
    ]
    return np.hstack(
        [
            indicators(start),
            powers(since_start(start).astype(float), WITHIN),
            cosines(known["run_order"], SLOW),
            instruments_of(np.stack(history, axis=1), 0.0, data.radius_m),
            *aside,
        ]
    )
