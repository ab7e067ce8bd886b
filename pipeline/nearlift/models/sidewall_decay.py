"""Sidewall: lift lost, decaying exponentially with the gap.

    L / L_inf = 1 - a exp(-z_hat / lambda_)

Convention: z_hat is the gap between the wall and the nearest blade *tip* over rotor radius (from
the rotor axis it would be larger by 1). a > 0 loses lift, and is the loss of the whole vehicle at
contact; lambda_ > 0 in rotor radii.

Approximation: empirical. No verified closed form of a sidewall's effect exists. Potential images
predict none at first order (`sidewall_none`), so the loss comes from wake, entrainment or
recirculation.

Traps: a absorbs a zero error of the distance exactly (a exp(-dz / lambda_)). With a near 0,
lambda_ is not identifiable.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, LiftModel, Parameter, Prior, Source, normal


def evaluate(z_hat: Any, /, *, a: Any, lambda_: Any) -> Any:
    """L / L_inf; shapes broadcast."""
    return 1.0 - a * np.exp(-np.asarray(z_hat, dtype=float) / lambda_)


MODEL = LiftModel(
    name="sidewall_decay",
    title="Exponential decay",
    formula=r"\frac{L}{L_\infty} = 1 - a \, e^{-\hat{z} / \lambda}",
    evaluate=evaluate,
    boundary="sidewall",
    parameters=(
        Parameter(
            name="a",
            unit="1",
            value=0.05,
            bounds=(-0.5, 0.9),
            prior=normal(0.05, 0.15),
            meaning="relative lift lost with the blade tip at the wall; negative would be a gain",
        ),
        Parameter(
            name="lambda_",
            unit="1",
            value=0.33,
            bounds=(0.02, 10.0),
            prior=Prior(distribution="lognorm", shape=(1.0,), scale=0.33),
            meaning="gap, in rotor radii, over which the loss falls to 1/e",
        ),
    ),
    source=Source(
        citation=(
            "Form common to wall-effect studies; values from two statements of Carter, Bouchard and"
            " Quinn 2021"
        ),
        bibtex=("carter2021",),
        doubts=(
            (
                "The paper fits no sidewall model. a and lambda_ follow from 'less than 5 %', read"
                " as 5 % at contact, and from '|dL| > 2 % for z_hat < 0.3'."
            ),
            (
                "The paper measures from 'the rotor nearest to the wall'; z_hat < 0.3 can only be"
                " the gap at the blade tip."
            ),
            (
                "One reading of the load cell is good to 1.5 gf, more than the whole effect at"
                " every throttle."
            ),
        ),
    ),
    checks=(
        Check(x=0.3, expected=0.98, tolerance=5e-4, quoted_by="Carter et al.: 2 % at z_hat = 0.3"),
        Check(x=0.0, expected=0.95, quoted_by="Carter et al.: less than 5 %"),
    ),
    notes=__doc__ or "",
)
