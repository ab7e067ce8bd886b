"""Force: gain differs by session.

    lift -> lift (1 + gain[session])

Mechanism: between sittings a propeller is changed, the vehicle is mounted again, the cell's
excitation or range is set again, or the density differs. All lift of the sitting is larger or
smaller in proportion.

Convention: gain > 0 reads more lift. One number for each session; L_inf takes up their mean.

Size on a Crazyflie: span 0.5 %, mounting and propellers 1 to 5 %.

Confounded with distance where a session ran at few distances: it can take the whole effect of the
boundary. Also with gain_drift and air_density, of which it is the coarse version.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, session: Any, gain: Any) -> Any:
    """Lift as the session reads it; `gain` is already spread over the trials. Shapes broadcast."""
    return lift * (1.0 + gain)


EFFECT = Effect(
    name="session_gain",
    title="Session gain",
    formula=r"L \to L \, (1 + g_\mathrm{session})",
    evaluate=evaluate,
    acts_on="force",
    mechanism="propellers, mounting, excitation or density differ from one sitting to the next",
    varies_with="session",
    separated_by=(
        "check masses, lift in free air in every session, and distances spread over sessions"
    ),
    log_next_time=("session",),
    needs=("session",),
    parameters=(
        Parameter(
            name="gain",
            unit="1",
            value=0.0,
            bounds=(-0.3, 0.3),
            prior=normal(0.0, 0.02),
            meaning="relative gain of a session; positive reads more lift",
            per="session",
        ),
    ),
    source=Source(
        citation="Physics of the bench",
        doubts=(
            "Sizes are estimates; a cell's span alone is good to 0.5 %.",
            "With one number for each session it explains any slow change a little.",
        ),
    ),
    checks=(
        null(0.3, session=2),
        Check(
            x=0.3,
            expected=0.303,
            arguments={"session": 2, "gain": 0.01},
            quoted_by="by hand: 1 % of 0.3",
        ),
    ),
    notes=__doc__ or "",
)
