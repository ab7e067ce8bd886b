"""Ceiling: a power law of distance.

    L / L_inf = 1 + a z_hat^(-p)

Convention: a > 0 gains lift, p > 0. z_hat is rotor plane to ceiling over rotor radius.

Approximation: empirical. gamma goes from p = 2, a = alpha / 4 far away to p = 1, a = sqrt(alpha) /
2 close to the ceiling; one power fits either range and not both.

Refusal: nan where z_hat is not positive.

Traps: as the ground's `power_law`.
"""

from __future__ import annotations

from nearlift.declare import Check, LiftModel, Parameter, Prior, Source, normal
from nearlift.models.power_law import evaluate, gradient

MODEL = LiftModel(
    name="ceiling_power_law",
    title="Power law",
    formula=r"\frac{L}{L_\infty} = 1 + a \, \hat{z}^{-p}",
    evaluate=evaluate,
    gradient=gradient,
    boundary="ceiling",
    parameters=(
        Parameter(
            name="a",
            unit="1",
            value=0.03125,
            bounds=(-1.0, 2.0),
            prior=normal(0.03125, 0.25),
            meaning="relative lift gained at z_hat = 1",
        ),
        Parameter(
            name="p",
            unit="1",
            value=2.0,
            bounds=(0.1, 8.0),
            prior=Prior(distribution="lognorm", shape=(0.75,), scale=2.0),
            meaning="power with which the gain falls off with distance",
        ),
    ),
    source=Source(
        citation="Hsiao and Chirarattananon's gamma to first order far away (own expansion)",
        doi="10.1109/TMECH.2019.2929589",
        doubts=("Not published in this form.",),
    ),
    checks=(
        Check(x=2.0, expected=1.008, tolerance=5e-4, quoted_by="gamma at z_hat = 2, own table"),
        Check(
            x=0.1,
            expected=1 + 0.5 * 0.125**0.5 / 0.1,
            arguments={"a": 0.5 * 0.125**0.5, "p": 1.0},
            quoted_by="gamma's limit near the ceiling less 1/2, own expansion",
        ),
    ),
    notes=__doc__ or "",
)
