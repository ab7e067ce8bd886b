"""Ground: an exponential gain, the form without a pole.

    L / L_inf = 1 + a exp(-b z_hat)

Convention: a > 0 gains lift; b > 0 is the decay per rotor radius. z_hat is rotor plane to ground
over rotor radius.

Approximation: empirical. It decays faster than any sum of images (which falls as 1 / z_hat^2), so
it fits near stations well and far ones badly. It is finite at contact, where the images are not.

Traps: published fits have a constant other than 1 (1.028 in a flight fit). It is an error of zero
or of the lift far away. Here L_inf takes that part. Amplitude and decay are strongly correlated
where no station lies below z_hat = 1 / b.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from nearlift.declare import Check, LiftModel, Parameter, Prior, Source, normal


def evaluate(z_hat: Any, /, *, a: Any, b: Any) -> Any:
    """L / L_inf; shapes broadcast."""
    return 1.0 + a * np.exp(-b * np.asarray(z_hat, dtype=float))


MODEL = LiftModel(
    name="exponential",
    title="Exponential",
    formula=r"\frac{L}{L_\infty} = 1 + a \, e^{-b \hat{z}}",
    evaluate=evaluate,
    boundary="ground",
    parameters=(
        Parameter(
            name="a",
            unit="1",
            value=0.383,
            bounds=(-1.0, 10.0),
            prior=normal(0.4, 1.0),
            meaning="relative lift gained if the form held down to contact",
        ),
        Parameter(
            name="b",
            unit="1",
            value=1.487,
            bounds=(0.05, 20.0),
            prior=Prior(distribution="lognorm", shape=(1.0,), scale=1.5),
            meaning="decay of the gain per rotor radius of height",
        ),
    ),
    source=Source(
        citation=(
            "Form after Del Cont Bernard et al. 2017-18, He and Leang 2020 and Appius 2022; values"
            " fitted here to the coplanar pair of Garofano-Soldado et al."
        ),
        doubts=(
            (
                "The default values are an own fit to open data of a rotor pair, R = 165 mm, with"
                " the lift far away left free. The data reject that fit (chi2 150 on 7)."
            ),
            (
                "The form of Del Cont Bernard et al. is known from abstracts only; that of He and"
                " Leang, 1 / (1 - C_a exp(-C_b z_hat)), is from memory and not this one."
            ),
        ),
    ),
    checks=(
        Check(
            x=1.0,
            expected=1.087,
            tolerance=1e-3,
            quoted_by="Garofano-Soldado et al., measured at z/R = 1 over z/R = 5",
        ),
        Check(
            x=1.0,
            expected=1 + 0.114 * float(np.exp(-5.388 * 0.12)),
            arguments={"a": 0.114, "b": 5.388 * 0.12},
            quoted_by="Appius 2022, flight fit with R = 0.12 m, its constant 1.028 put at 1",
        ),
    ),
    notes=__doc__ or "",
)


CEILING = replace(
    MODEL,
    name="ceiling_exponential",
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
        bibtex=("hsiao2019",),
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
    notes="""\
Ceiling: an exponential gain.

    L / L_inf = 1 + a exp(-b z_hat)

Convention: a > 0 gains lift; b > 0 is the decay per rotor radius. z_hat is rotor plane to ceiling
over rotor radius.

Approximation: empirical; finite at contact, unlike gamma. Its default values pass through gamma at
z_hat = 0.3 and 0.7.

Traps: as the ground's `exponential`.
""",
)
