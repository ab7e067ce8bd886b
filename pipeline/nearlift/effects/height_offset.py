"""Height: the traverse's zero is not the rotor plane.

    z_hat -> z_hat + offset_m / r

Mechanism: the distance was set to zero at the duct, the guard, the feet or a feeler gauge, or the
blades cone. Every recorded distance is wrong by the same length.

Convention: offset_m > 0 where the rotor plane is farther from the boundary than recorded. In free
air nothing changes. A distance carried to or behind the boundary is handed on as it is: the model
then refuses it.

Size on a Crazyflie: 0.43 % of L_inf per mm at z_hat = 1.14 above ground, 0.26 at 1.5, 0.19 at 2.
Under a ceiling 7.4 % per 0.1 mm at z_hat = 0.1, 1.7 at 0.2, 0.65 at 0.3, 0.18 at 0.5.

Confounded with K_b (correlation 0.98 to 0.997), alpha, the exponent n, near_wall_saturation (0.97
under a ceiling); absorbed exactly by the amplitude of an exponential sidewall. More trials at the
same stations do not separate them.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(z_hat: Any, /, *, radius_m: Any, offset_m: Any) -> Any:
    """True z_hat from the recorded one. Shapes broadcast."""
    return z_hat + offset_m / radius_m


EFFECT = Effect(
    name="height_offset",
    title="Height offset",
    formula=r"\hat{z} \to \hat{z} + \delta / r",
    evaluate=evaluate,
    acts_on="height",
    error_of="height",
    mechanism="the traverse's zero is not the rotor plane",
    varies_with="z_hat",
    separated_by="a touch-off with a gauge, or stations beyond z_hat = 3",
    needs=("radius_m",),
    parameters=(
        Parameter(
            name="offset_m",
            unit="m",
            value=0.0,
            bounds=(-5e-3, 5e-3),
            prior=normal(0.0, 0.5e-3),
            meaning=(
                "rotor plane to boundary, true minus recorded; positive where the vehicle is"
                " farther away than recorded"
            ),
        ),
    ),
    source=Source(
        citation="Physics of the bench; the sensitivities follow from the models",
        doubts=(
            (
                "The bounds suit a datum at a duct or guard; published code carries offsets of 27"
                " and 30 mm, taken at markers and feet."
            ),
        ),
    ),
    checks=(
        null(1.0, radius_m=0.023),
        Check(
            x=1.0,
            expected=1.1,
            arguments={"radius_m": 0.023, "offset_m": 2.3e-3},
            quoted_by="by hand: 2.3 mm of 23 mm",
        ),
    ),
    notes=__doc__ or "",
)
