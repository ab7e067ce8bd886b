"""Height: the traverse's lead is wrong.

    z_hat -> z_hat (1 + z_scale)

Mechanism: the lead of the screw, the microsteps of the driver or the belt's pitch differ from the
counter's assumption. Distances are wrong in proportion. A wrong rotor radius does the same.

Convention: z_scale > 0 where the vehicle is farther away than recorded.

Size on a Crazyflie: 2 % at most, which is 0.2 % of lift at z_hat = 1.14 and 0.14 % at 3 with K_b
fixed, below 0.1 % with K_b free.

Confounded with whatever scales a length: under a ceiling with alpha exactly (alpha / z_hat^2),
above ground with the spacing and nearly with K_b. Near a sidewall with the decay length exactly. No
measurement of lift under a ceiling separates them.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(z_hat: Any, /, *, z_scale: Any) -> Any:
    """True z_hat from the recorded one. Shapes broadcast."""
    return z_hat * (1.0 + z_scale)


EFFECT = Effect(
    name="height_scale",
    title="Height scale",
    formula=r"\hat{z} \to \hat{z} (1 + \epsilon)",
    evaluate=evaluate,
    acts_on="height",
    mechanism="the lead of the traverse differs from what its counter assumes",
    varies_with="z_hat",
    separated_by="an independent gauge at two heights",
    parameters=(
        Parameter(
            name="z_scale",
            unit="1",
            value=0.0,
            bounds=(-0.1, 0.1),
            prior=normal(0.0, 0.02),
            meaning=(
                "relative error of recorded distances; positive where the vehicle is farther away"
                " than recorded"
            ),
        ),
    ),
    source=Source(
        citation="Physics of the bench",
        doubts=(
            (
                "2 % is a generous error of a lead screw, and an ordinary one of a belt or of a"
                " rotor radius."
            ),
        ),
    ),
    checks=(
        null(3.0),
        Check(x=2.5, expected=2.55, arguments={"z_scale": 0.02}, quoted_by="by hand: 2 % of 2.5"),
    ),
    notes=__doc__ or "",
)
