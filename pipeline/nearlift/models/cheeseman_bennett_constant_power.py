"""Ground, one rotor: Cheeseman and Bennett's image at constant power, with momentum conserved.

    L / L_inf = (1 - k / (16 z_hat^2))^(-2/3)

Convention: as in `cheeseman_bennett`. The image takes the fraction s = k / (16 z_hat^2) from the
inflow, so the power ratio at constant thrust is 1 - s; thrust grows as power to the 2/3, hence the
exponent. Cheeseman and Bennett instead leave v_i as it was, which gives the exponent 1.

Approximation: momentum theory; all power is induced power. At constant rpm the exponent lies near
0.6 to 0.8 and falls as the gain grows; at constant throttle it is neither. The exponent is all but
indistinguishable from k in a fit of thrust alone.

Refusal: nan at and below the pole, z_hat = sqrt(k) / 4.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, LiftModel, Source
from nearlift.models import cheeseman_bennett


def evaluate(z_hat: Any, /, *, k: Any) -> Any:
    """L / L_inf at constant power; nan at and below the pole sqrt(k) / 4. Shapes broadcast."""
    return cheeseman_bennett.evaluate(z_hat, k=k) ** (2.0 / 3.0)


def gradient(z_hat: Any, /, *, k: Any) -> tuple[Any, ...]:
    """Derivative of `evaluate` with respect to k."""
    (plain,) = cheeseman_bennett.gradient(z_hat, k=k)
    return (2.0 / 3.0 * cheeseman_bennett.evaluate(z_hat, k=k) ** (-1.0 / 3.0) * plain,)


def downwash(z_hat: Any, /, *, k: Any) -> Any:
    """Induced velocity at the disk over its value far away, at the same thrust: 1 - s."""
    return cheeseman_bennett.downwash(z_hat, k=k)


MODEL = LiftModel(
    name="cheeseman_bennett_constant_power",
    title="Cheeseman-Bennett, constant power",
    formula=r"\frac{L}{L_\infty} = \left(1 - \frac{k}{16 \hat{z}^2}\right)^{-2/3}",
    evaluate=evaluate,
    gradient=gradient,
    downwash=downwash,
    boundary="ground",
    rotors="one",
    parameters=(cheeseman_bennett.COEFFICIENT,),
    valid_z_hat=(0.25, float("inf")),
    source=Source(
        citation=(
            "Own derivation from momentum theory and the image of Cheeseman and Bennett (ARC R&M"
            " 3021)"
        ),
        doubts=("Not published in this form; derived here.",),
    ),
    checks=(Check(x=0.5, expected=1.211414, quoted_by="(4/3)^(2/3), own arithmetic"),),
    notes=__doc__ or "",
)
