"""Ceiling: the empirical form of Sanchez-Cuevas and Jimenez-Cano, both constants free.

    L / L_inf = 1 / (1 - c / (z_hat + e)^2)

published with c = 1 / K_1 and e = K_2 / R.

Convention: c > 0 gains lift. e > 0 moves the pole behind the ceiling, so that the lift stays finite
at contact while sqrt(c) < e. z_hat is rotor plane to ceiling over rotor radius.

Approximation: empirical, after the image of a ground; any number of rotors. The strength is c
rather than K_1 because K_1 runs to infinity where there is no effect.

Refusal: nan at and below the pole z_hat = sqrt(c) - e, and where z_hat is not positive.

Traps: e is not distinguishable from a zero error of the distance.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, LiftModel, Parameter, Prior, Source, normal
from nearlift.models.inflow import clear_of_boundary, gain


def cancelled(z_hat: Any, c: Any, e: Any) -> Any:
    """Fraction of inflow that the form takes as cancelled by an image."""
    # beyond the pole, where the shifted height is not positive, the square would come back finite
    return c / np.square(clear_of_boundary(clear_of_boundary(z_hat) + e))


def evaluate(z_hat: Any, /, *, c: Any, e: Any) -> Any:
    """L / L_inf; nan at and below the pole. Shapes broadcast."""
    return gain(cancelled(z_hat, c, e))


MODEL = LiftModel(
    name="ceiling_empirical",
    title="Empirical ceiling",
    formula=r"\frac{L}{L_\infty} = \frac{1}{1 - c / (\hat{z} + e)^2}",
    evaluate=evaluate,
    boundary="ceiling",
    parameters=(
        Parameter(
            name="c",
            unit="1",
            value=0.04,
            bounds=(-0.5, 2.0),
            prior=normal(0.04, 0.25),
            meaning="strength, 1 / K_1; positive gains lift",
        ),
        Parameter(
            name="e",
            unit="1",
            value=0.25,
            bounds=(0.0, 2.0),
            prior=Prior(distribution="expon", scale=0.5),
            meaning=(
                "shift of the pole behind the ceiling in rotor radii, K_2 / R; at least sqrt(c)"
                " where lift is finite at contact"
            ),
        ),
    ),
    source=Source(
        citation=(
            "Jimenez-Cano, A. E., Sanchez-Cuevas, P. J., et al., Contact-Based Bridge Inspection"
            " Multirotors, IEEE RA-L 4(4), 2019; Sanchez-Cuevas et al., ICUAS 2017"
        ),
        doi="10.1109/LRA.2019.2928206",
        bibtex=("jimenezcano2019",),
        doubts=(
            "The form is from memory and was not verified against the original.",
            (
                "K_1 and K_2 are unknown. The values here are no published numbers: they are a"
                " start for a fit, in the middle of the range predicted by the theory of gamma."
            ),
        ),
    ),
    checks=(
        Check(x=0.15, expected=4 / 3, quoted_by="own arithmetic: 1 / (1 - 0.04 / 0.16)"),
        Check(
            x=1.0,
            expected=1.333333,
            arguments={"c": 0.25, "e": 0.0},
            quoted_by="own arithmetic: a bare image of strength 1/4",
        ),
    ),
    notes=__doc__ or "",
)
