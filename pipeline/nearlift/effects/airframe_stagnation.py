"""Ratio: pressure on the underside of the airframe.

    ratio -> ratio + stagnation z_hat^(-stagnation_power)

Mechanism: close to the ground the wakes cannot leave freely. Air dammed up beneath body, battery
and arms presses on them, or the wall jets' speed sucks them down.

Convention: stagnation > 0 gains lift (dammed up), < 0 loses it (suckdown); it is the share of L_inf
one radius above the ground. It is the same at every throttle, since pressure and lift both scale as
the square of the jet's speed.

Size on a Crazyflie: 9e-4 m^2 of body at the disk loading of 40 Pa bound it by 36 mN, 14 % of the
weight. Realistic are 0 to 3 % where trials begin. Published suckdown forms are powers z_hat^-1 to
z_hat^-3; closer than 0.2 radii none was measured, and the form is held there.

Confounded with image_strength (0.999 above ground), height_offset, plate_edge and K_b.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null, uniform

#: Height, in rotor radii, below which the power law is held: the damming must end somewhere.
HELD_BELOW = 0.2


def evaluate(ratio: Any, /, *, z_hat: Any, stagnation: Any, stagnation_power: Any) -> Any:
    """L / L_inf with the airframe's share. Shapes broadcast."""
    return ratio + stagnation * np.maximum(z_hat, HELD_BELOW) ** -np.asarray(
        stagnation_power, dtype=float
    )


EFFECT = Effect(
    name="airframe_stagnation",
    title="Airframe pressure",
    formula=r"\frac{L}{L_\infty} \to \frac{L}{L_\infty} + c \, \hat{z}^{-m}",
    # the larger of z and HELD_BELOW, in functions that C has in `float` too
    evaluate=evaluate,
    acts_on="ratio",
    belongs_to="vehicle",
    mechanism=(
        "air dammed up between ground and airframe presses on its underside, or wall jets suck it"
        " down"
    ),
    varies_with="z_hat",
    separated_by="a bare frame against one with deck and battery, and stations below z_hat = 1",
    needs=("z_hat",),
    parameters=(
        Parameter(
            name="stagnation",
            unit="1",
            value=0.0,
            bounds=(-0.15, 0.15),
            prior=normal(0.0, 0.02),
            meaning=(
                "lift from the airframe's underside one radius up, as a share of L_inf; positive"
                " gains lift, negative is suckdown"
            ),
        ),
        Parameter(
            name="stagnation_power",
            unit="1",
            value=2.0,
            bounds=(1.0, 4.0),
            prior=uniform(1.0, 3.0),
            meaning="how fast that pressure falls with height: the power of z_hat, negated",
            grid=(1.0, 2.0, 3.0),
        ),
    ),
    boundaries=("ground",),
    source=Source(
        citation=(
            "Physics of the bench; arXiv 2309.10919 distinguishes ground, suckdown and fountain"
        ),
        doubts=(
            (
                "No closed form for a small quadrotor is known; the bound is disk loading times"
                " planform."
            ),
        ),
    ),
    checks=(
        null(1.1586, z_hat=1.0),
        Check(
            x=1.0,
            expected=1.0125,
            arguments={"z_hat": 2.0, "stagnation": 0.05},
            quoted_by="by hand: 0.05 / 2^2",
        ),
        Check(
            x=1.0,
            expected=0.97,
            arguments={"z_hat": 1.0, "stagnation": -0.03, "stagnation_power": 3.0},
            quoted_by="by hand: at z = r its size",
        ),
    ),
    notes=__doc__ or "",
)
