"""Force: the vehicle weighs something else than was declared.

    lift -> lift (1 + mass_error)

Mechanism: in flight a vehicle weighs itself, and its lift is its mass times what its accelerometer
feels. A wrong mass is wrong in all lift alike.

Convention: mass_error > 0 where lift reads too much: the vehicle is lighter than declared.

Size: a battery, a deck or a guard that nobody weighed is 1 to 10 %.

Confounded with L_inf, always: no flight tells the two apart, and no gain or decay length hangs on
it. A mass that differs from log to log is a session_gain.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, flight: Any, mass_error: Any) -> Any:
    """Lift as that mass has it, in whichever flight. Shapes broadcast."""
    return lift * (1.0 + mass_error)


EFFECT = Effect(
    name="vehicle_mass",
    title="Mass of the vehicle",
    formula=r"L \to L \, (1 + e_m)",
    evaluate=evaluate,
    acts_on="force",
    belongs_to="flight",
    mechanism="in flight lift is the declared mass times the acceleration that is felt",
    varies_with="flight",
    separated_by="a scale",
    log_next_time=("flight",),
    error_of="mass",
    needs=("flight",),
    parameters=(
        Parameter(
            name="mass_error",
            unit="1",
            value=0.0,
            bounds=(-0.3, 0.3),
            prior=normal(0.0, 0.03),
            meaning="relative error of the mass; positive reads more lift",
        ),
    ),
    source=Source(
        citation="Newton's second law",
        doubts=("A battery that is changed, or a deck that is taken off, changes it by flight.",),
    ),
    checks=(
        null(0.3, flight=1.0),
        Check(
            x=0.3,
            expected=0.309,
            arguments={"flight": 2.0, "mass_error": 0.03},
            quoted_by="by hand: 3 % of 0.3",
        ),
    ),
    notes=__doc__ or "",
)
