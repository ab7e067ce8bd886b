"""Force: a tare error common to all trials.

    lift -> lift + zero_N

Mechanism: the tare is taken with rotors at rest, the lift with rotors turning. Forces that turn on
with them (current in the leads, vibration rectified by the cell, thrust on the wiring) are not in
the tare. They are the same at every trial.

Convention: zero_N > 0 reads too much lift. The larger the lift, the less it matters in proportion;
L_inf of a throttle takes up the part that does not vary with distance.

Size on a Crazyflie: 0 to 0.5 gf (5 mN), 1.9 % of the weight.

Confounded with K_b (it pushes every gain towards 1 in proportion), reynolds and cell_nonlinearity.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, zero_N: Any) -> Any:
    """Lift as read, in N. Shapes broadcast."""
    return lift + zero_N


EFFECT = Effect(
    name="zero_offset",
    title="Zero offset",
    formula=r"L \to L + F_0",
    evaluate=evaluate,
    acts_on="force",
    additive=True,
    mechanism="a force that turns on with the rotors is not in the tare",
    varies_with="throttle",
    separated_by="a tare after the trial, low throttle, and check masses with the motors powered",
    log_next_time=("tare_after",),
    parameters=(
        Parameter(
            name="zero_N",
            unit="N",
            value=0.0,
            bounds=(-0.05, 0.05),
            prior=normal(0.0, 0.005),
            meaning=(
                "force left after the tare, the same at every trial; positive reads too much lift"
            ),
        ),
    ),
    source=Source(
        citation="Physics of the bench", doubts=("0.5 gf is the estimate for a cell of 1 kgf.",)
    ),
    checks=(
        null(0.265),
        Check(
            x=0.265,
            expected=0.265 * 1.0185,
            arguments={"zero_N": 4.903325e-3},
            tolerance=5e-5,
            quoted_by="0.5 gf is 1.9 % of 265 mN",
        ),
    ),
    notes=__doc__ or "",
)
