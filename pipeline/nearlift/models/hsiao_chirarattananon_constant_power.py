"""Ceiling: Hsiao and Chirarattananon's gamma as a thrust at constant power.

    L / L_inf = gamma^(2/3),   gamma = 1/2 + 1/2 sqrt(1 + alpha / z_hat^2)

Convention: as `hsiao_chirarattananon`. gamma is P_inf / P at the same thrust; thrust grows as power
to the 2/3.

Approximation: all power is induced power. The ratio is the consistent one for a rig that holds
power.

Refusal: nan where z_hat is not positive.

Traps: alpha fitted here is not alpha fitted with the power 1; far away alpha_here = 1.5 alpha_there
fits the same data.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, LiftModel
from nearlift.models import hsiao_chirarattananon
from nearlift.models.hsiao_chirarattananon import COEFFICIENT, SOURCE, gamma, slope


def evaluate(z_hat: Any, /, *, alpha: Any) -> Any:
    """L / L_inf at constant power. Shapes broadcast."""
    return gamma(z_hat, alpha) ** (2.0 / 3.0)


def gradient(z_hat: Any, /, *, alpha: Any) -> tuple[Any, ...]:
    """Derivative of `evaluate` with respect to alpha."""
    return (2.0 / 3.0 * gamma(z_hat, alpha) ** (-1.0 / 3.0) * slope(z_hat, alpha),)


MODEL = LiftModel(
    name="hsiao_chirarattananon_constant_power",
    title="Hsiao-Chirarattananon, constant power",
    formula=(
        r"\frac{L}{L_\infty} = \left(\frac{1}{2} + \frac{1}{2} \sqrt{1 + \alpha /"
        r" \hat{z}^2}\right)^{2/3}"
    ),
    evaluate=evaluate,
    gradient=gradient,
    downwash=hsiao_chirarattananon.downwash,
    boundary="ceiling",
    parameters=(COEFFICIENT,),
    source=SOURCE,
    checks=(
        Check(x=0.1, expected=1.761, tolerance=5e-4, quoted_by="own table of gamma^(2/3)"),
        Check(x=0.5, expected=1.074, tolerance=5e-4, quoted_by="the same table"),
        Check(x=1.0, expected=1.020, tolerance=5e-4, quoted_by="the same table"),
    ),
    notes=__doc__ or "",
)
