"""Force: the cell reads some of a moment as lift.

    lift -> lift (1 + crosstalk_along cos(turn_rad) + crosstalk_across sin(turn_rad))

Mechanism: a vehicle whose thrust does not pass through the cell's axis loads it with a moment. A
single-axis cell reads a part of it as force. Turned about its own axis on the cell, the vehicle
takes its arm along, and the part changes sign.

Convention: turn_rad is the vehicle's angle about its thrust on the cell. crosstalk_along is the
excess reading at 0, crosstalk_across at a quarter of a turn, as shares of lift.

Size on a Crazyflie: an arm of 1 mm at the 5 % for each millimetre of a cheap cell is 5 %. The 0.2 N
mm near a wall up to 1 gf, as much as the whole loss of lift there.

Confounded with L_inf, wholly, where the vehicle was never turned; with session_gain where it was
turned between sessions only. A measured moment does not separate them: the same flow causes it and
lift, and a fit along it would explain away the boundary.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, turn_rad: Any, crosstalk_along: Any, crosstalk_across: Any) -> Any:
    """Lift as read at that angle on the cell. Shapes broadcast."""
    return lift * (1.0 + crosstalk_along * np.cos(turn_rad) + crosstalk_across * np.sin(turn_rad))


EFFECT = Effect(
    name="cell_crosstalk",
    title="Cell cross-talk",
    formula=r"L \to L \, (1 + c_1 \cos \psi + c_2 \sin \psi)",
    evaluate=evaluate,
    acts_on="force",
    by_experiment=True,
    mechanism="thrust off the cell's axis makes a moment, part of which the cell reads",
    varies_with="turn_rad",
    separated_by="repeats at 90 and 180 degrees",
    log_next_time=("turn",),
    needs=("turn_rad",),
    parameters=tuple(
        Parameter(
            name=f"crosstalk_{name}",
            unit="1",
            value=0.0,
            bounds=(-0.15, 0.15),
            prior=normal(0.0, 0.02),
            meaning=f"share of lift that is read too much {where}",
        )
        for name, where in (
            ("along", "where the vehicle is not turned"),
            ("across", "a quarter of a turn from there"),
        )
    ),
    source=Source(
        citation="Balance of forces and moments on a single-axis cell",
        doubts=(
            "Near a wall the moment grows as the gap closes; this form has that of free air.",
            "Sizes are estimates for cheap cells.",
        ),
    ),
    checks=(
        null(0.3, turn_rad=1.0),
        Check(
            x=0.3,
            expected=0.303,
            arguments={"turn_rad": 0.0, "crosstalk_along": 0.01, "crosstalk_across": 0.05},
            quoted_by="by hand: 1 % of 0.3",
        ),
        Check(
            x=0.3,
            expected=0.297,
            arguments={"turn_rad": math.pi, "crosstalk_along": 0.01},
            quoted_by="by hand: the other way round",
        ),
    ),
    notes=__doc__ or "",
)
