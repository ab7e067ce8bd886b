"""Ceiling: an exponential gain.

    L / L_inf = 1 + a exp(-b z_hat)

Convention: a > 0 gains lift; b > 0 is the decay per rotor radius. z_hat is rotor plane to ceiling
over rotor radius.

Approximation: empirical; finite at contact, unlike gamma. Its default values pass through gamma at
z_hat = 0.3 and 0.7.

Traps: as the ground's `exponential`.
"""

from __future__ import annotations

from nearlift.declare import Check, LiftModel, Parameter, Prior, Source, normal
from nearlift.models.exponential import evaluate, gradient

MODEL = LiftModel(
    name="ceiling_exponential",
    title="Exponential",
    formula=r"\frac{L}{L_\infty} = 1 + a \, e^{-b \hat{z}}",
    evaluate=evaluate,
    gradient=gradient,
    boundary="ceiling",
    parameters=(
        Parameter(
            name="a",
            unit="1",
            value=0.85,
            bounds=(-1.0, 10.0),
            prior=normal(0.85, 2.0),
            meaning="relative lift gained if the form held to contact",
        ),
        Parameter(
            name="b",
            unit="1",
            value=3.8,
            bounds=(0.05, 30.0),
            prior=Prior(distribution="lognorm", shape=(1.0,), scale=3.8),
            meaning="decay of the gain per rotor radius of distance",
        ),
    ),
    source=Source(
        citation=(
            "Form after Del Cont Bernard et al. 2017-18 (ground and ceiling); values set to pass"
            " through Hsiao and Chirarattananon's gamma"
        ),
        doubts=(
            (
                "The form is known from abstracts only; no published constants for a ceiling were"
                " seen."
            ),
        ),
    ),
    checks=(
        Check(x=0.3, expected=1.273, tolerance=2e-3, quoted_by="gamma at z_hat = 0.3, own table"),
        Check(x=0.7, expected=1.060, tolerance=2e-3, quoted_by="gamma at z_hat = 0.7, own table"),
    ),
    notes=__doc__ or "",
)
