"""Ratio: the boundary ends.

    ratio -> 1 + (ratio - 1) (1 - edge_share exp(-edge_width_hat^2 / z_hat^2))

Mechanism: a plate of half-width W mirrors only the part of the wake that it catches. The wake
widens with the distance that it has travelled. Beyond z = W / c, with c between 0.5 and 3, it flows
past the edge, and the effect fades sooner than above a plane without end.

Convention: edge_width_hat = W / (c r) is the distance, in rotor radii, at which 1/e of the loss is
reached. edge_share is the share of the gain (a sidewall's loss) that is lost far beyond it: 1 where
nothing lies behind the plate, less where a floor goes on below its edge, 0 for a plane without end.
The range goes beyond 1 because the form is approximate. A plate narrower than the vehicle is no
ground: edge_width_hat is at least 2.

Size on a Crazyflie: a plate beyond four diagonals (W = 8 r, c = 2) loses 0.4 % of the gain at z_hat
= 1.7, 17 % at 3, where 6 % of gain are left.

Confounded with K_b, height_offset, image_strength above ground; with fountain_shape where stations
begin at z_hat = 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Prior, Source, null


def evaluate(ratio: Any, /, *, z_hat: Any, edge_share: Any, edge_width_hat: Any) -> Any:
    """L / L_inf near a boundary that ends. Shapes broadcast."""
    # at contact the plate is all that the rotor sees, in free air (z_hat infinite) there is none
    return ratio - (ratio - 1.0) * edge_share * np.exp(
        -np.square(edge_width_hat / np.maximum(z_hat, 1e-6))
    )


EFFECT = Effect(
    name="plate_edge",
    title="Plate edge",
    formula=(
        r"\frac{L}{L_\infty} \to 1 + \left(\frac{L}{L_\infty} - 1\right) \left(1 - s \,"
        r" e^{-\hat{W}^2 / \hat{z}^2}\right)"
    ),
    evaluate=evaluate,
    acts_on="ratio",
    mechanism="the plate ends, and mirrors only what it catches of the wake",
    varies_with="z_hat",
    separated_by="the plate moved sideways, a larger one, or stations between 3 and 10",
    needs=("z_hat",),
    parameters=(
        Parameter(
            name="edge_share",
            unit="1",
            value=0.0,
            bounds=(0.0, 1.5),
            prior=Prior(distribution="halfnorm", scale=0.25),
            meaning=(
                "share of the gain lost far beyond the edge; 1 where nothing lies behind the plate,"
                " 0 is a plane without end"
            ),
        ),
        Parameter(
            name="edge_width_hat",
            unit="1",
            value=4.5,
            bounds=(2.0, 30.0),
            prior=Prior(distribution="lognorm", shape=(0.7,), scale=5.0),
            meaning=(
                "distance, in rotor radii, at which the wake has outgrown the plate: its half-width"
                " over the wake's spread"
            ),
            grid=(2.5, 4.5, 8.0),
        ),
    ),
    source=Source(
        citation=(
            "Finite plates under a rotor: University of Dayton MSc thesis, 2020; physics of the"
            " bench, E22"
        ),
        doubts=(
            "The wake's spread c is known to a factor of six; only W / c can be found.",
            (
                "The view factor of a coaxial disk, 1 / (1 + (z / W)^2), falls more slowly; form"
                " uncertainty covers it."
            ),
        ),
    ),
    checks=(
        null(1.1, z_hat=2.0),
        Check(
            x=1.1,
            expected=1.0632121,
            arguments={"z_hat": 5.0, "edge_share": 1.0, "edge_width_hat": 5.0},
            quoted_by="by hand: 1/e of the gain lost at W",
        ),
        Check(
            x=1.05,
            expected=1.0495421,
            arguments={"z_hat": 2.5, "edge_share": 0.5, "edge_width_hat": 5.0},
            quoted_by="by hand: half of e^-4 of it at W / 2",
        ),
    ),
    notes=__doc__ or "",
)
