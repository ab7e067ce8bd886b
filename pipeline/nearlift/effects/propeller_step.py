"""Force: another propeller, or a damaged one, lifts otherwise.

    lift -> lift (1 + propeller_gain other_propeller)

Mechanism: a blade that is nicked, bent or exchanged has another lift at the same throttle, suddenly
and permanently.

Convention: other_propeller is 0 with the propellers of the first trial, by their names in the
column `propeller`, and 1 with any others. propeller_gain > 0 lifts more with those. A blade damaged
in the course of a campaign is given a name of its own.

Size on a Crazyflie: 1 to 5 %, for a nick or from one propeller to the next.

Confounded with session_gain and gain_drift where propellers were exchanged once, between sessions.
A step without a name in the schedule stays a step in time, and structure.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, other_propeller: Any, propeller_gain: Any) -> Any:
    """Lift with those propellers. Shapes broadcast."""
    return lift * (1.0 + propeller_gain * other_propeller)


EFFECT = Effect(
    name="propeller_step",
    title="Propeller change",
    formula=r"L \to L \, (1 + g \cdot \mathrm{other})",
    evaluate=evaluate,
    acts_on="force",
    by_experiment=True,
    mechanism="a nicked, bent or exchanged blade has another lift at the same throttle",
    varies_with="other_propeller",
    contains_line=True,
    separated_by="going back to the first propellers",
    log_next_time=("propeller",),
    needs=("other_propeller",),
    parameters=(
        Parameter(
            name="propeller_gain",
            unit="1",
            value=0.0,
            bounds=(-0.2, 0.2),
            prior=normal(0.0, 0.02),
            meaning="relative lift of the other propellers over the first, less one",
        ),
    ),
    source=Source(
        citation="Physics of the bench",
        doubts=(
            "Sizes are estimates.",
            (
                "All but the first propellers are taken to be alike; several differ, and"
                " session_gain with a session for each says by how much."
            ),
        ),
    ),
    checks=(
        null(0.3, other_propeller=1.0),
        Check(
            x=0.3,
            expected=0.294,
            arguments={"other_propeller": 1.0, "propeller_gain": -0.02},
            quoted_by="by hand: 2 % less",
        ),
    ),
    notes=__doc__ or "",
)
