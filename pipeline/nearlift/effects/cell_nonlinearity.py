"""Force: the load cell's quadratic term.

    lift -> lift (1 + nonlinearity_per_N lift)

Mechanism: the bridge's output is not quite proportional to force. The departure is larger under
side load, or with a cell that was calibrated at two points of a far larger range.

Convention: nonlinearity_per_N > 0 reads large forces too large. It works in newtons, hence
`additive`, although its share grows with lift. L_inf of each throttle takes up the part that does
not vary with distance; gains at high throttle are then read larger.

Size on a Crazyflie: 0.1 % of full scale, 1e-4 per N for a cell of 1 kgf, invisible. A cell of 1 N
loaded off its axis 0.01 per N and more.

Confounded with reynolds and zero_offset (gain against throttle), and with K_b at a single throttle.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, nonlinearity_per_N: Any) -> Any:
    """Lift as read, in N. Shapes broadcast."""
    return lift * (1.0 + nonlinearity_per_N * lift)


EFFECT = Effect(
    name="cell_nonlinearity",
    title="Cell nonlinearity",
    formula=r"L \to L + q L^2",
    evaluate=evaluate,
    acts_on="force",
    additive=True,
    loaded=True,
    mechanism="the load cell's output has a quadratic term",
    varies_with="throttle",
    separated_by="check masses up and down over the range used",
    log_next_time=("check masses",),
    parameters=(
        Parameter(
            name="nonlinearity_per_N",
            unit="1/N",
            value=0.0,
            bounds=(-0.3, 0.3),
            prior=normal(0.0, 0.03),
            meaning=(
                "relative excess of the reading per newton; positive reads large forces too large"
            ),
        ),
    ),
    source=Source(
        citation="Data sheets of strain-gauge cells",
        doubts=(
            (
                "A sound cell of 1 kgf has 1e-4 per N, which is below the detection limit; the"
                " prior is that of a small cell badly mounted."
            ),
        ),
    ),
    checks=(
        null(0.5),
        Check(
            x=0.5,
            expected=0.505,
            arguments={"nonlinearity_per_N": 0.02},
            quoted_by="by hand: 0.02 x 0.25",
        ),
    ),
    notes=__doc__ or "",
)
