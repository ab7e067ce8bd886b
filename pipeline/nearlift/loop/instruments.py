"""Instrumental variables of flights: the history of the height set-point, time and lateral motion.

In closed loop command, climb rate and height respond to the disturbances that scatter lift. Flights
are therefore judged only by what they share with columns that no disturbance moves: two-stage least
squares (Wooldridge 2010, Econometric Analysis of Cross Section and Panel Data, ch. 5).
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit.closed_loop import instruments_of, since_start
from nearlift.likelihood.subspace import cosines
from nearlift.loop.families import BOOKKEEPING, indicators, powers
from nearlift.results import Observations

#: Number of cosines along the run order, and of powers of the window's index within its start.
SLOW, WITHIN = 8, 3
#: Prefixes of the covariates that the height controller does not drive.
SIDEWAYS = ("command_share_", "level_speed_m_s", "tilt_rad")


def instruments(data: Observations) -> FloatArray | None:
    """Instruments (n, q); None of trials that are no flights."""
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
