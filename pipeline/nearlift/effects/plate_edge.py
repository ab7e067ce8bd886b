"""Ratio: the boundary ends.

    ratio -> 1 + (ratio - 1) / (1 + edge_curvature z_hat^2)

Mechanism: a plate of half-width W mirrors only the part of the wake that it catches. Seen from a height z it fills the share
W^2 / (W^2 + z^2) of a half space (view factor of a coaxial disk), so the effect fades sooner than above a plane without end.

Convention: edge_curvature = (r / W)^2 >= 0; 0 is a plane without end. The gain, or a sidewall's loss, shrinks with distance.

Size on a Crazyflie: a plate beyond four diagonals (W = 8 r) has edge_curvature below 0.016: 2 % of the gain at z_hat = 1.14, 13 %
at 3, where 6 % of gain are left.

Confounded with K_b, height_offset, image_strength above ground; with fountain_shape where stations begin at z_hat = 2. Moving
the plate sideways, a larger one, or stations between 3 and 10 separate them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Prior, Source


def evaluate(ratio: Any, /, *, z_hat: Any, edge_curvature: Any) -> Any:
    """L / L_inf beside a boundary that ends. Shapes broadcast."""
    # in free air there is no plate
    seen = edge_curvature * np.square(np.where(np.isinf(z_hat), 0.0, z_hat))
    return ratio - (ratio - 1.0) * seen / (1.0 + seen)


EFFECT = Effect(
    name="plate_edge",
    title="Edge of the plate",
    formula=r"\frac{L}{L_\infty} \to 1 + \left(\frac{L}{L_\infty} - 1\right) \frac{1}{1 + (\hat{z} / \hat{W})^2}",
    evaluate=evaluate,
    acts_on="ratio",
    mechanism="the plate ends, and mirrors only what it catches of the wake",
    varies_with="z_hat",
    needs=("z_hat",),
    parameters=(
        Parameter(
            name="edge_curvature",
            unit="1",
            value=0.0,
            bounds=(0.0, 1.0),
            prior=Prior(distribution="halfnorm", scale=0.05),
            meaning="inverse square of the plate's half-width in rotor radii; larger fades sooner, 0 is a plane without end",
        ),
    ),
    source=Source(
        citation="View factor of a coaxial disk; finite plates under a rotor: University of Dayton MSc thesis, 2020",
        doubts=(
            "The view factor stands in for diffraction at the edge, for which no form is known.",
            "1 - exp(-(W / c z)^2) is as good; it has no slope at the null.",
        ),
    ),
    checks=(
        Check(x=1.1, expected=1.1, arguments={"z_hat": 2.0}, quoted_by="null"),
        Check(x=1.1, expected=1.05, arguments={"z_hat": 2.0, "edge_curvature": 0.25}, quoted_by="by hand: half the gain at z = W"),
        Check(x=1.05, expected=1.04, arguments={"z_hat": 5.0, "edge_curvature": 0.01}, quoted_by="by hand: a fifth of the gain lost at z = W / 2"),
    ),
    notes=__doc__ or "",
)
