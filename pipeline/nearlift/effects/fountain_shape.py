"""Ratio: a fountain with a length of its own.

    ratio -> ratio + fountain exp(-(ln(z_hat / (fountain_height spacing_hat)))^2 / (2 w^2)),   w =
    0.5

Mechanism: the wall jets of neighbouring rotors collide and rise between them. The fountain reaches
the body, or is drawn in again by the rotors, over a range of heights. The spacing of the axes sets
that range; the models' fountain term has one fixed shape.

Convention: fountain > 0 gains lift at its peak (it pushes on the body), < 0 loses it (drawn in
again), as a share of L_inf. None at contact, where no room is left for it, and none far away. An
isolated rotor has no fountain and no `spacing_hat`.

Size on a Crazyflie: 2 to 4 % of lift between z_hat = 1 and 3, of which K_b takes what has its own
shape.

Approximation: empirical, a bump in the logarithm of height with fixed width.

Confounded with K_b, with plate_edge and height_scale where the nearest station is beyond z_hat = 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Prior, Source, normal, null

#: Standard width of the bump in ln z_hat: half its height is left at 0.55 and 1.8 times the height
#: of its peak.
WIDTH = 0.5


def evaluate(
    ratio: Any, /, *, z_hat: Any, spacing_hat: Any, fountain: Any, fountain_height: Any
) -> Any:
    """L / L_inf with the fountain's own bump. Shapes broadcast."""
    off_peak = np.log(np.maximum(z_hat, 1e-6) / (fountain_height * spacing_hat))
    return ratio + fountain * np.exp(-0.5 * np.square(off_peak / WIDTH))


EFFECT = Effect(
    name="fountain_shape",
    title="Fountain length",
    formula=(
        r"\frac{L}{L_\infty} \to \frac{L}{L_\infty} + c \, \exp\left[-\frac{1}{2 w^2} \ln^2"
        r" \frac{\hat{z}}{\eta \hat{d}}\right]"
    ),
    evaluate=evaluate,
    acts_on="ratio",
    belongs_to="vehicle",
    mechanism=(
        "the fountain between rotors reaches body or disks over a range of heights of its own"
    ),
    varies_with="z_hat",
    separated_by=(
        "stations every half radius between 1 and 4, a pair of rotors instead of four,"
        " or the body removed"
    ),
    needs=("z_hat", "spacing_hat"),
    parameters=(
        Parameter(
            name="fountain",
            unit="1",
            value=0.0,
            bounds=(-0.2, 0.2),
            prior=normal(0.0, 0.03),
            meaning=(
                "lift from the fountain at its strongest, beyond the model's, as a share of L_inf;"
                " positive gains lift"
            ),
        ),
        Parameter(
            name="fountain_height",
            unit="1",
            value=0.55,
            bounds=(0.15, 2.0),
            prior=Prior(distribution="lognorm", shape=(0.5,), scale=0.55),
            meaning="height where it is strongest, over the distance of adjacent rotor axes",
            grid=(0.35, 0.55, 0.85, 1.3),
        ),
    ),
    boundaries=("ground",),
    source=Source(
        citation=(
            "Dekker et al., AIAA J. 60(7), 2022: wall jets of neighbouring rotors collide, rise and"
            " may be drawn in again"
        ),
        doubts=(
            "That work shows the flow; the bump's form and width are own choices.",
            "The fountain switches sides at some 5 Hz; a record of 10 s averages that out.",
        ),
    ),
    checks=(
        null(1.1, z_hat=1.5, spacing_hat=65 / 23),
        Check(
            x=1.1,
            expected=1.12,
            arguments={"z_hat": 1.5, "spacing_hat": 3.0, "fountain": 0.02, "fountain_height": 0.5},
            quoted_by="by hand: at the peak",
        ),
        Check(
            x=1.0,
            expected=1.0121306,
            arguments={
                "z_hat": 1.5 * 1.6487213,
                "spacing_hat": 3.0,
                "fountain": 0.02,
                "fountain_height": 0.5,
            },
            quoted_by="by hand: 0.02 exp(-1/2) one width above",
        ),
    ),
    notes=__doc__ or "",
)
