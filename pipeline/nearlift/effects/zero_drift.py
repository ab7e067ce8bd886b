"""Force: the zero drifts after each start.

    lift -> lift + zero_drift_N (1 - exp(-since_start_s / zero_drift_s))

Mechanism: cell and amplifier warm up once they are switched on or once the motors' air warms them.
A tare taken before the session, or before the warmer part of each record, leaves the drift in.

Convention: zero_drift_N > 0 reads too much lift later in the session; nothing at its first trial.

Size on a Crazyflie: 0.1 gf/K over a few kelvin, 0 to 1 gf (10 mN), with 60 to 1800 s.

Confounded with warm_up (in proportion to lift rather than the same at every throttle), cell_creep
and zero_temperature.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Prior, Source, normal, null


def evaluate(
    lift: Any, /, *, session: Any, since_start_s: Any, zero_drift_N: Any, zero_drift_s: Any
) -> Any:
    """Lift as read, in N, so long after the start of the session. Shapes broadcast."""
    return lift + zero_drift_N * -np.expm1(-since_start_s / zero_drift_s)


EFFECT = Effect(
    name="zero_drift",
    title="Zero drift",
    formula=r"L \to L + F_1 \left(1 - e^{-t_\mathrm{session} / \tau_0}\right)",
    evaluate=evaluate,
    acts_on="force",
    additive=True,
    mechanism="cell and amplifier warm up after each start, and their zero with them",
    varies_with="since_start_s",
    contains_line=True,
    separated_by="a tare after each trial, and several throttles at any time in the session",
    log_next_time=("session", "start", "tare_after"),
    needs=("session", "since_start_s"),
    parameters=(
        Parameter(
            name="zero_drift_N",
            unit="N",
            value=0.0,
            bounds=(-0.05, 0.05),
            prior=normal(0.0, 0.004),
            meaning=(
                "zero long after the start of a session less that at its start; positive reads too"
                " much lift later"
            ),
        ),
        Parameter(
            name="zero_drift_s",
            unit="s",
            value=400.0,
            bounds=(30.0, 4000.0),
            prior=Prior(distribution="lognorm", shape=(0.9,), scale=400.0),
            meaning="time over which the zero settles to 1/e",
            grid=(100.0, 400.0, 1600.0),
        ),
    ),
    source=Source(
        citation="Physics of the bench; public reports on drift of load-cell amplifiers",
        doubts=("Sizes are estimates for cheap amplifiers.",),
    ),
    checks=(
        null(0.3, session=0, since_start_s=900.0),
        Check(
            x=0.3,
            expected=0.3,
            arguments={"session": 0, "since_start_s": 0.0, "zero_drift_N": 0.01},
            quoted_by="nothing at the start",
        ),
        Check(
            x=0.3,
            expected=0.3 + 0.01 * 0.6321206,
            arguments={"session": 0, "since_start_s": 400.0, "zero_drift_N": 0.01},
            quoted_by="by hand: 1 - 1/e at one time constant",
        ),
    ),
    notes=__doc__ or "",
)
