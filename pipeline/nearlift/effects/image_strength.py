"""Ratio: a free coefficient on the images.

    ratio = 1 / (1 - s)  ->  1 / (1 - strength s),   s = 1 - 1 / ratio the share of inflow that is
    cancelled

Mechanism: a rotor is no point source of uniform inflow and the ground no perfect mirror (roughness,
boundary layer, load distribution). The images cancel more or less of the inflow than in theory.

Convention: strength > 1 gains more, 1 is the model. Where a model has a free fountain K_b and
images, K_b takes up the fountain's part of the scaling. The remainder is a coefficient on the
images alone. Above ground only: models of a ceiling and a sidewall have no images.

Refusal: nan where nothing of the inflow would be left.

Size: on the same open data a coefficient of 1.1 with the datum fixed and 2.9 with it free. It
is within 0.2 of 1 on a bench with known zero and exponent.

Confounded with airframe_stagnation (0.999 above ground), height_offset, held_quantity, plate_edge;
absorbed exactly by the coefficient of a model that has one on its only image.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(ratio: Any, /, *, strength: Any) -> Any:
    """L / L_inf with the images scaled. Shapes broadcast."""
    # the same as 1 / (1 - strength (1 - 1 / ratio)), and exact at strength 1
    left = 1.0 - (strength - 1.0) * (ratio - 1.0)
    return ratio / np.where(left > 0, left, np.nan)


EFFECT = Effect(
    name="image_strength",
    title="Image strength",
    formula=r"\frac{1}{1 - s} \to \frac{1}{1 - \kappa s}",
    evaluate=evaluate,
    acts_on="ratio",
    belongs_to="vehicle",
    mechanism="images cancel more or less of the inflow than point sources in potential flow do",
    varies_with="z_hat",
    separated_by="stations below z_hat = 1 and beyond 5",
    parameters=(
        Parameter(
            name="strength",
            unit="1",
            value=1.0,
            bounds=(0.3, 1.7),
            prior=normal(1.0, 0.2),
            meaning=(
                "share of inflow cancelled over the model's; above 1 gains more lift near the"
                " boundary"
            ),
        ),
    ),
    boundaries=("ground",),
    source=Source(
        citation=(
            "Coefficient on Cheeseman and Bennett's image as in Danjun and Li 2015, and as fitted"
            " to open data"
        ),
        bibtex=("cheeseman1955",),
        doubts=(
            "The role is confirmed by secondary sources; their values were not.",
            "A rough ground gives more lift than a smooth one (10.1177/17568293251350056).",
        ),
    ),
    checks=(
        null(1.1586),
        Check(
            x=16 / 15,
            expected=1 / (1 - 1.5 / 16),
            arguments={"strength": 1.5},
            quoted_by="by hand: Cheeseman and Bennett at z_hat = 1 with 1.5 images",
        ),
        Check(
            x=0.8,
            expected=1 / (1 + 0.5 * 0.25),
            arguments={"strength": 0.5},
            quoted_by="by hand: a loss, s = -1/4",
        ),
    ),
    notes=__doc__ or "",
)
