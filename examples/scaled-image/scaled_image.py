"""Ground: Cheeseman and Bennett's image, its strength free, for a vehicle of several rotors.

    L / L_inf = 1 / (1 - k / (4 z_hat)^2)

Convention: k > 0 gains lift. z_hat is rotor plane to ground over rotor radius. k = 1 is an isolated
rotor.

Approximation: one image stands for all rotors and for the body, so k absorbs both and means
neither.

Refusal: nan where the image cancels the whole inflow, at and below z_hat = sqrt(k) / 4.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, LiftModel, Parameter, Source, normal


def evaluate(z_hat: Any, /, *, k: Any) -> Any:
    """L / L_inf; nan at and below the pole. Shapes broadcast."""
    above = np.where(np.asarray(z_hat) > 0, z_hat, np.nan)
    inflow = 1.0 - k / np.square(4.0 * above)
    return 1.0 / np.where(inflow > 0, inflow, np.nan)


MODEL = LiftModel(
    name="scaled_image",
    title="Cheeseman-Bennett, scaled",
    formula=r"\frac{L}{L_\infty} = \left[1 - \frac{k}{16 \hat{z}^2}\right]^{-1}",
    evaluate=evaluate,
    boundary="ground",
    rotors="several",
    parameters=(
        Parameter(
            name="k",
            unit="1",
            value=1.0,
            bounds=(-2.0, 12.0),
            prior=normal(1.0, 4.0),
            meaning="strength of the image; 1 alone",
        ),
    ),
    valid_z_hat=(0.25, np.inf),
    source=Source(
        citation=(
            "Cheeseman, I. C., and Bennett, W. E., The Effect of the Ground on a Helicopter Rotor"
            " in Forward Flight, ARC R&M 3021, 1957"
        ),
        doubts=(
            "Derived for one rotor; for several, k is a number to be fitted and nothing more.",
        ),
    ),
    checks=(
        Check(
            x=1.0,
            expected=16 / 15,
            quoted_by="Cheeseman and Bennett's formula at one radius, k = 1",
        ),
    ),
    notes=__doc__ or "",
)
