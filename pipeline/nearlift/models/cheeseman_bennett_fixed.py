"""Ground: Cheeseman and Bennett as they published it, nothing free.

    L / L_inf = 1 / (1 - 1 / (16 z_hat^2))

The theory curve: what a fit of `cheeseman_bennett` has to beat, and what the paper calls "classic
helicopter theory". Convention, approximation and refusal are those of `cheeseman_bennett` with k =
1; the pole stands at z_hat = 0.25, and below z_hat = 0.5 the theory is not to be trusted.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, LiftModel, Source
from nearlift.models import cheeseman_bennett


def evaluate(z_hat: Any, /) -> Any:
    """L / L_inf; nan at and below z_hat = 0.25."""
    return cheeseman_bennett.evaluate(z_hat, k=1.0)


def downwash(z_hat: Any, /) -> Any:
    """Induced velocity at the disk over its value far away."""
    return cheeseman_bennett.downwash(z_hat, k=1.0)


MODEL = LiftModel(
    name="cheeseman_bennett_fixed",
    title="Cheeseman-Bennett, theory",
    formula=r"\frac{L}{L_\infty} = \frac{1}{1 - 1 / (16 \hat{z}^2)}",
    evaluate=evaluate,
    downwash=downwash,
    boundary="ground",
    valid_z_hat=(0.25, float("inf")),
    source=Source(
        citation=(
            "Cheeseman, I. C., and Bennett, W. E., The Effect of the Ground on a Helicopter Rotor"
            " in Forward Flight, ARC R&M 3021, written 1955, issued 1957"
        ),
        equation="hover limit; Eq. 1 of Carter, Bouchard and Quinn 2021",
        doubts=("Carter et al. print 1/16z^2 where 1/(16 z_hat^2) is meant.",),
    ),
    checks=(
        Check(x=1.0, expected=1.066667, quoted_by="golden value, exact from the formula"),
        Check(x=3.0, expected=1.0070, tolerance=5e-5, quoted_by="own table of the formula"),
    ),
    notes=__doc__ or "",
)
