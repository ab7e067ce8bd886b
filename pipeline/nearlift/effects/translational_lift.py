"""Force: a rotor that moves sideways meets more air.

    lift -> lift [1 + level_gain (1 - l)],   l = sqrt(sqrt(1 + m^4 / 4) - m^2 / 2),
    m = level_speed_hat

Mechanism: air that passes sideways adds to the mass flow through the disk, so that the same thrust
needs less induced inflow, and the blades keep their angle of attack. l is Glauert's inflow over
that of hover at the same thrust.

Convention: level_speed_hat is the level speed over the induced velocity of hover; level_gain > 0
gains lift. Blade-element theory has level_gain = 2 k / (1 + k), k as in climb_inflow. Speed over
ground stands for airspeed indoors; wind is not in it.

Size: at half the induced velocity the inflow falls by 6 %, and lift rises by 2 % at a
level_gain of 0.4.

Confounded with tilt, which a vehicle needs to move sideways and to stop again.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, level_speed_hat: Any, level_gain: Any) -> Any:
    """Lift at that level speed. Shapes broadcast."""
    square = level_speed_hat**2
    inflow = np.sqrt(np.sqrt(1 + square**2 / 4) - square / 2)
    return lift * (1.0 + level_gain * (1.0 - inflow))


EFFECT = Effect(
    name="translational_lift",
    title="Translational lift",
    formula=(
        r"L \to L \left[1 + c_u \left(1 - \sqrt{\sqrt{1 + \tfrac{u^4}{4}} - \tfrac{u^2}{2}}"
        r"\right)\right]"
    ),
    evaluate=evaluate,
    acts_on="force",
    belongs_to="flight",
    mechanism="air that passes sideways adds to the mass flow, and the inflow falls",
    varies_with="level_speed_hat",
    separated_by="speed at no tilt, as in coasting",
    log_next_time=("level_speed_m_s",),
    needs=("level_speed_hat",),
    parameters=(
        Parameter(
            name="level_gain",
            unit="1",
            value=0.0,
            bounds=(0.0, 2.0),
            prior=normal(0.0, 0.5),
            meaning="gain of lift per fall of the inflow, both relative; positive gains",
        ),
    ),
    source=Source(
        citation="Glauert 1926, A General Theory of the Autogyro, ARC R&M 1111",
        doubts=(
            "Neighbouring rotors, and a boundary, turn the wake that Glauert takes for free.",
            "Blades gain from the speed itself, too: 1.5 times the square of the advance ratio.",
        ),
    ),
    checks=(
        null(0.3, level_speed_hat=0.5),
        Check(
            x=1.0,
            expected=1.0 + 0.5 * (1 - 0.7862),
            arguments={"level_speed_hat": 1.0, "level_gain": 0.5},
            tolerance=1e-4,
            quoted_by="by hand: the root of half the golden ratio's excess, sqrt(1.118 - 0.5)",
        ),
    ),
    notes=__doc__ or "",
)
