"""Force: the room's air comes back.

    lift -> lift (1 - recirculation (throttle / throttle_ref) (1 - exp(-z_hat /
    recirculation_reach_hat)))

Mechanism: in a closed room the jet sets the air in motion. It comes back to the rotors as an axial
inflow V_c and takes away 0.35 V_c / v_i of the lift. A boundary close by spreads the jet along
itself and shields the rotors from it; far from it the inflow is complete. A record is shorter than
the room's turnover (40 to 125 s), so the inflow rises with the jet.

Convention: recirculation >= 0 loses lift; it is the loss in free air at the median throttle.

Size on a Crazyflie: 0.027 m^3/s into a cube of 1.5 m give V_c of 0.1 to 0.3 m/s, -0.9 to -2.6 %.

Confounded with tether_stiffness, zero_offset and whatever acts beyond z_hat = 3.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Prior, Source, null


def evaluate(
    lift: Any,
    /,
    *,
    z_hat: Any,
    throttle: Any,
    throttle_ref: Any,
    recirculation: Any,
    recirculation_reach_hat: Any,
) -> Any:
    """Lift under the room's inflow. Shapes broadcast."""
    inflow = (throttle / throttle_ref) * -np.expm1(
        -np.maximum(z_hat, 0.0) / recirculation_reach_hat
    )
    return lift * (1.0 - recirculation * inflow)


EFFECT = Effect(
    name="room_recirculation",
    title="Room recirculation",
    formula=(
        r"L \to L \left[1 - a \frac{\tau}{\tau_0} \left(1 - e^{-\hat{z} / \hat{h}}\right)\right]"
    ),
    evaluate=evaluate,
    acts_on="force",
    mechanism=(
        "air set in motion by the jet comes back to the rotors as inflow, the more the farther the"
        " boundary"
    ),
    varies_with="z_hat",
    separated_by="longer pauses, an open door, or one long run",
    needs=("z_hat", "throttle", "throttle_ref"),
    parameters=(
        Parameter(
            name="recirculation",
            unit="1",
            value=0.0,
            bounds=(0.0, 0.15),
            prior=Prior(distribution="halfnorm", scale=0.02),
            meaning="relative loss of lift in free air at the median throttle; larger loses more",
        ),
        Parameter(
            name="recirculation_reach_hat",
            unit="1",
            value=8.0,
            bounds=(2.0, 40.0),
            prior=Prior(distribution="lognorm", shape=(0.7,), scale=8.0),
            meaning=(
                "distance, in rotor radii, beyond which the boundary no longer shields the rotors"
            ),
            grid=(3.0, 8.0, 20.0),
        ),
    ),
    source=Source(
        citation=(
            "Physics of the bench: blade-element momentum theory for the inflow, room volume over"
            " jet flux for the time"
        ),
        doubts=(
            (
                "How a boundary shields the rotors is an own guess; the far wakes merge into one"
                " jet after 2.5 vehicle diameters."
            ),
        ),
    ),
    checks=(
        null(0.265, z_hat=5.0, throttle=0.9, throttle_ref=0.6),
        Check(
            x=1.0,
            expected=0.974,
            arguments={
                "z_hat": float("inf"),
                "throttle": 0.6,
                "throttle_ref": 0.6,
                "recirculation": 0.35 * 0.3 / 4.07,
            },
            tolerance=5e-4,
            quoted_by="V_c = 0.3 m/s and v_i = 4.07 m/s: -2.6 %",
        ),
        Check(
            x=1.0,
            expected=1 - 0.02 * 0.5 * 0.6321206,
            arguments={"z_hat": 8.0, "throttle": 0.3, "throttle_ref": 0.6, "recirculation": 0.02},
            quoted_by="by hand: half the throttle, 1 - 1/e at one reach",
        ),
    ),
    notes=__doc__ or "",
)
