"""Ground, one rotor: Hayden's correlation of helicopter flight tests.

    P / P_inf = 1 / (A + B (D/z)^2) at constant thrust,   A = 0.9926, B = 0.0379, D = 2 R
    L / L_inf = (A + B (2 / z_hat)^2)^(2/3)               at constant power

Convention: z_hat is rotor plane to ground over rotor radius; the ratio is a thrust at constant
power.

Approximation: a regression, not a theory, and not an extension of the images; helicopters, one
rotor, hover. Nothing is free.

Traps: it does not tend to 1 far away but to A^(2/3) = 0.9951, so a free L_inf absorbs half a
percent. The ratio crosses 1 near z_hat = 4.5. B multiplies the square of *diameter* over height.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, LiftModel, Source
from nearlift.models.inflow import clear_of_boundary

A, B = 0.9926, 0.0379


def evaluate(z_hat: Any, /) -> Any:
    """Thrust over thrust far away, at constant power; tends to A^(2/3). Shapes broadcast."""
    return (A + B * np.square(2.0 / clear_of_boundary(z_hat))) ** (2.0 / 3.0)


MODEL = LiftModel(
    name="hayden",
    title="Hayden",
    formula=r"\frac{L}{L_\infty} = \left(0.9926 + 0.0379 \, (2 / \hat{z})^2\right)^{2/3}",
    evaluate=evaluate,
    boundary="ground",
    rotors="one",
    tends_to_one=False,
    source=Source(
        citation=(
            "Hayden, J. S., The Effect of the Ground on Helicopter Hovering Power Required, Proc."
            " AHS 32nd Annual Forum, 1976"
        ),
        bibtex=("hayden1976",),
        doubts=(
            (
                "Read in a secondary transcription (code); the thesis that goes with it prints D/z"
                " inverted, taken as a misprint."
            ),
            "B is transcribed as 0.0379 and as 0.03794.",
            (
                "Carter et al. say that Hayden 'later added power to the model'; it is an"
                " independent correlation."
            ),
        ),
    ),
    checks=(
        Check(x=1.0, expected=1.094, tolerance=5e-4, quoted_by="own table of the formula"),
        Check(x=2.0, expected=1.0202, tolerance=5e-5, quoted_by="own table of the formula"),
        Check(x=3.0, expected=1.0063, tolerance=5e-5, quoted_by="own table of the formula"),
        Check(x=5.0, expected=0.9991, tolerance=5e-5, quoted_by="own table of the formula"),
    ),
    notes=__doc__ or "",
)
