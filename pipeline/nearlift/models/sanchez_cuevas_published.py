"""Ground, quadrotor: Sanchez-Cuevas, Heredia and Ollero with the fountain's strength that they
published, nothing free.

The formula is that of `sanchez_cuevas` with K_b = 2 and the vehicle's own geometry: spacing d
between ADJACENT axes, b across the diagonal. Convention, approximation, refusal and traps are those
of `sanchez_cuevas`.

What it is for: the fit of K_b has to beat it by more than the trials' errors, or the fit says no
more than that K_b = 2 will do.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, LiftModel
from nearlift.models import sanchez_cuevas

PUBLISHED = 2.0


def evaluate(z_hat: Any, /, *, spacing_hat: Any, diagonal_hat: Any) -> Any:
    """L / L_inf; nan where nothing of the inflow is left. Shapes broadcast."""
    return sanchez_cuevas.evaluate(
        z_hat, spacing_hat=spacing_hat, diagonal_hat=diagonal_hat, K_b=PUBLISHED
    )


def downwash(z_hat: Any, /, *, spacing_hat: Any, diagonal_hat: Any) -> Any:
    """Induced velocity at the disk over its value far away."""
    return sanchez_cuevas.downwash(
        z_hat, spacing_hat=spacing_hat, diagonal_hat=diagonal_hat, K_b=PUBLISHED
    )


MODEL = LiftModel(
    name="sanchez_cuevas_published",
    title="Sanchez-Cuevas, K_b = 2",
    formula=sanchez_cuevas.MODEL.formula.replace("2 K_b", "4"),
    evaluate=evaluate,
    downwash=downwash,
    boundary="ground",
    rotors="several",
    needs=("spacing_hat", "diagonal_hat"),
    valid_z_hat=(0.25, float("inf")),
    source=sanchez_cuevas.SOURCE,
    checks=(
        Check(
            x=1.0,
            expected=1.1586,
            arguments={"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23},
            tolerance=5e-5,
            quoted_by="table of sanchez_cuevas",
        ),
        Check(
            x=5.0,
            expected=1.0256,
            arguments={"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23},
            tolerance=5e-5,
            quoted_by="the same table",
        ),
    ),
    notes=__doc__ or "",
)
