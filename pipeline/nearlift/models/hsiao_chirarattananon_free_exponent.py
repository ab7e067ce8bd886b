"""Ceiling: Hsiao and Chirarattananon's gamma raised to a free power.

    L / L_inf = gamma^n,   gamma = 1/2 + 1/2 sqrt(1 + alpha / z_hat^2)

Convention: alpha as `hsiao_chirarattananon`; n says what a trial holds constant: 1 the paper's
convention, 2/3 constant power, less than 0.8 and falling towards the ceiling at constant rpm.

Approximation: n is a constant. At constant rpm it is not: the ratio saturates near 2.1 to 2.4 as
gamma grows without bound, without any viscosity.

Refusal: nan where z_hat is not positive.

Traps: far away only the product n alpha is seen; n needs stations below z_hat = 0.3, where a datum
error looks the same (correlation 0.997).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, LiftModel, Parameter, normal
from nearlift.models.hsiao_chirarattananon import COEFFICIENT, SOURCE, gamma, slope


def evaluate(z_hat: Any, /, *, alpha: Any, n: Any) -> Any:
    """L / L_inf. Shapes broadcast."""
    return gamma(z_hat, alpha) ** n


def gradient(z_hat: Any, /, *, alpha: Any, n: Any) -> tuple[Any, ...]:
    """Derivatives of `evaluate` with respect to alpha and n."""
    plain = gamma(z_hat, alpha)
    raised = plain**n
    return n * raised / plain * slope(z_hat, alpha), raised * np.log(plain)


def downwash(
    z_hat: Any, /, *, alpha: Any, n: Any
) -> Any:  # same signature as `evaluate`, as the contract wants
    """Induced velocity at the disk over its value far away, at the same thrust: 1 / gamma, whatever
    n.
    """
    return 1.0 / gamma(z_hat, alpha) * np.ones_like(n)


MODEL = LiftModel(
    name="hsiao_chirarattananon_free_exponent",
    title="Hsiao-Chirarattananon, free exponent",
    formula=(
        r"\frac{L}{L_\infty} = \left(\frac{1}{2} + \frac{1}{2} \sqrt{1 + \alpha /"
        r" \hat{z}^2}\right)^{n}"
    ),
    evaluate=evaluate,
    gradient=gradient,
    downwash=downwash,
    boundary="ceiling",
    parameters=(
        COEFFICIENT,
        Parameter(
            name="n",
            unit="1",
            value=1.0,
            bounds=(0.1, 2.0),
            prior=normal(0.8, 0.4),
            meaning=(
                "exponent of gamma: 1 the paper's convention, 2/3 constant power, 0.6 to 0.8"
                " constant rpm"
            ),
        ),
    ),
    source=SOURCE,
    checks=(
        Check(x=0.1, expected=2.337117, quoted_by="golden value of gamma, n = 1"),
        Check(
            x=0.1,
            expected=1.761,
            arguments={"n": 2 / 3},
            tolerance=5e-4,
            quoted_by="own table of gamma^(2/3)",
        ),
    ),
    notes=__doc__ or "",
)
