"""Force: gain drifts over the campaign.

    lift -> lift (1 + drift elapsed_hat)

Mechanism: brushes, bearings and blades wear, the amplifier ages or follows the day, a supply
settles: lift changes slowly and in one direction.

Convention: elapsed_hat runs from -1 at the first trial to +1 at the last. drift > 0 reads more lift
later, and is half the change over the campaign.

Size on a Crazyflie: 0 to 2 % over a day of runs; brushed motors lose several percent in ten hours.

Confounded with distance or throttle where they were run in order, with session_gain (of which a
trend over sessions is part), air_density and supply_sag.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, elapsed_hat: Any, drift: Any) -> Any:
    """Lift as read at that time of the campaign. Shapes broadcast."""
    return lift * (1.0 + drift * elapsed_hat)


EFFECT = Effect(
    name="gain_drift",
    title="Gain drift",
    formula=r"L \to L \, (1 + d \, \hat{t}), \quad \hat{t} \in [-1, 1]",
    evaluate=evaluate,
    acts_on="force",
    mechanism="wear of motors and blades, or the amplifier's gain, moves slowly in one direction",
    varies_with="start_s",
    contains_line=True,
    separated_by="random order, and lift in free air every few trials",
    log_next_time=("start",),
    needs=("elapsed_hat",),
    parameters=(
        Parameter(
            name="drift",
            unit="1",
            value=0.0,
            bounds=(-0.15, 0.15),
            prior=normal(0.0, 0.01),
            meaning="half the relative change over the campaign; positive reads more lift later",
        ),
    ),
    source=Source(
        citation="Physics of the bench",
        doubts=("A straight line approximates any slow monotone change.",),
    ),
    checks=(
        null(0.3, elapsed_hat=1.0),
        Check(
            x=0.3,
            expected=0.297,
            arguments={"elapsed_hat": -1.0, "drift": 0.01},
            quoted_by="by hand: 1 % less at the first trial",
        ),
    ),
    notes=__doc__ or "",
)
