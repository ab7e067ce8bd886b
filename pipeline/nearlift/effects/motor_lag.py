"""Force: motors lag more, or less, than was allowed for.

    lift -> lift exp(lag_left_s lag_slope)

Mechanism: a motor follows its command as a first-order system does. A trial's throttle is the
command behind the lag that was found or given; were the lag another, the throttle would be, too.

Convention: lag_slope is the change of log lift per second of lag at the trial's command, 1/s;
lag_left_s > 0 where motors lag more than was allowed for.

Size: time constants are 20 to 100 ms; 10 ms are 0.6 % of lift where the climb changes by 1 m/s.

Confounded with climb_inflow, since commands change as climbs do. A lag shows while the command
moves, an inflow while the vehicle does.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, lag_slope: Any, lag_left_s: Any) -> Any:
    """Lift behind that lag. Shapes broadcast."""
    return lift * np.exp(lag_left_s * lag_slope)


EFFECT = Effect(
    name="motor_lag",
    title="Lag of the motors",
    formula=r"L \to L \, e^{\Delta\tau \, s}",
    evaluate=evaluate,
    acts_on="force",
    belongs_to="flight",
    mechanism="the motors follow their command by another lag than was allowed for",
    varies_with="lag_slope",
    separated_by="steps of the height set-point with rest between them",
    log_next_time=("lag_slope",),
    error_of="lag",
    needs=("lag_slope",),
    parameters=(
        Parameter(
            name="lag_left_s",
            unit="s",
            value=0.0,
            bounds=(-0.1, 0.1),
            prior=normal(0.0, 0.02),
            meaning="lag beyond what was allowed for; positive where motors are slower",
        ),
    ),
    source=Source(
        citation=(
            "First-order lag of a motor with a propeller: Förster 2015, System Identification of"
            " the Crazyflie 2.0 Nano Quadrocopter, ETH Zurich"
        ),
        doubts=("Motors speed up faster than they slow down, since nothing brakes them.",),
    ),
    checks=(
        null(0.3, lag_slope=2.0),
        Check(
            x=0.3,
            expected=0.3060,
            arguments={"lag_slope": 2.0, "lag_left_s": 0.01},
            tolerance=1e-3,
            quoted_by="by hand: 2 % of 0.3",
        ),
    ),
    notes=__doc__ or "",
)
