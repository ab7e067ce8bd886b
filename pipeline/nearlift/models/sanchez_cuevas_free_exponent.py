"""Ground, quadrotor: Sanchez-Cuevas raised to a free power.

    L / L_inf = (1 / (1 - s))^n,   s as in `sanchez_cuevas`

Convention: K_b as in `sanchez_cuevas`; n says what a trial holds constant. n = 1 is the paper's
convention (v_i unchanged by the image), 2/3 constant power with momentum conserved, about 0.6 to
0.8 constant rpm (falling as the gain grows). The paper's models "scaled by powers of 0.6 ... 1.4"
are this family.

Approximation: n is a constant, which only the first two cases are.

Refusal: nan where nothing of the inflow is left.

Traps: thrust alone cannot tell K_b from n (correlation -0.99 to -1.00); record rpm and power, or
believe the product only.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, LiftModel, Parameter, Source, normal
from nearlift.models import sanchez_cuevas
from nearlift.models.inflow import clear_of_boundary, image


def evaluate(z_hat: Any, /, *, spacing_hat: Any, diagonal_hat: Any, K_b: Any, n: Any) -> Any:
    """L / L_inf; nan where nothing of the inflow is left. Shapes broadcast."""
    return (
        sanchez_cuevas.evaluate(z_hat, spacing_hat=spacing_hat, diagonal_hat=diagonal_hat, K_b=K_b)
        ** n
    )


def gradient(
    z_hat: Any, /, *, spacing_hat: Any, diagonal_hat: Any, K_b: Any, n: Any
) -> tuple[Any, ...]:
    """Derivatives of `evaluate` with respect to K_b and n."""
    plain = sanchez_cuevas.evaluate(
        z_hat, spacing_hat=spacing_hat, diagonal_hat=diagonal_hat, K_b=K_b
    )
    raised = plain**n
    fountain = 4.0 * image(2.0 * clear_of_boundary(z_hat), diagonal_hat)
    return n * raised * plain * fountain, raised * np.log(plain)


def downwash(
    z_hat: Any, /, *, spacing_hat: Any, diagonal_hat: Any, K_b: Any, n: Any
) -> Any:  # same signature as `evaluate`, as the contract wants
    """Induced velocity at the disk over its value far away, at the same thrust: 1 - s,
    whatever n.
    """
    return sanchez_cuevas.downwash(
        z_hat, spacing_hat=spacing_hat, diagonal_hat=diagonal_hat, K_b=K_b
    ) * np.ones_like(n)


EXPONENT = Parameter(
    name="n",
    unit="1",
    value=1.0,
    bounds=(0.1, 2.0),
    prior=normal(0.8, 0.4),
    meaning=(
        "exponent of the ratio: 1 the paper's convention, 2/3 constant power, 0.6 to 0.8"
        " constant rpm"
    ),
)

_CRAZYFLIE = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}

MODEL = LiftModel(
    name="sanchez_cuevas_free_exponent",
    title="Sanchez-Cuevas, free exponent",
    formula=r"\frac{L}{L_\infty} = \left(1 - s(\hat{z}; \hat{d}, \hat{b}, K_b)\right)^{-n}",
    evaluate=evaluate,
    gradient=gradient,
    downwash=downwash,
    boundary="ground",
    rotors="several",
    parameters=(sanchez_cuevas.FOUNTAIN, EXPONENT),
    needs=("spacing_hat", "diagonal_hat"),
    valid_z_hat=(0.25, float("inf")),
    source=Source(
        citation="Own unification of what published ratios hold constant, over "
        + sanchez_cuevas.SOURCE.citation,
        doi=sanchez_cuevas.SOURCE.doi,
        doubts=(
            (
                "The range of n at constant rpm comes from an own blade-element closure with"
                " solidity times lift slope 0.75 to 1.14."
            ),
        ),
    ),
    checks=(
        Check(
            x=1.0,
            expected=1.1586,
            arguments=_CRAZYFLIE,
            tolerance=5e-5,
            quoted_by="sanchez_cuevas at n = 1",
        ),
        Check(
            x=1.0,
            expected=1.1586 ** (2 / 3),
            arguments={**_CRAZYFLIE, "n": 2 / 3},
            tolerance=5e-5,
            quoted_by="the same to the 2/3, own arithmetic",
        ),
    ),
    notes=__doc__ or "",
)
