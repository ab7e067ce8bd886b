"""Sidewall: lift lost, falling off as a power of the distance between wall and rotor axis.

    L / L_inf = 1 - a (1 + z_hat)^(-p)

Convention: z_hat is the gap between the wall and the nearest blade tip over rotor radius, so 1 +
z_hat is the distance of the rotor axis. a > 0 loses lift, and is the loss at contact; p > 0.

Approximation: empirical, the rival of `sidewall_decay` with a longer reach; finite at contact.

Traps: a and p are strongly correlated where the stations do not go beyond one radius.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, LiftModel, Parameter, Prior, Source, normal
from nearlift.models.inflow import clear_of_boundary


def evaluate(z_hat: Any, /, *, a: Any, p: Any) -> Any:
    """L / L_inf; nan with the rotor axis in the wall. Shapes broadcast."""
    return 1.0 - a * clear_of_boundary(1.0 + z_hat) ** -p


MODEL = LiftModel(
    name="sidewall_power_law",
    title="Power law",
    formula=r"\frac{L}{L_\infty} = 1 - a \, (1 + \hat{z})^{-p}",
    evaluate=evaluate,
    boundary="sidewall",
    parameters=(
        Parameter(
            name="a",
            unit="1",
            value=0.05,
            bounds=(-0.5, 0.9),
            prior=normal(0.05, 0.15),
            meaning="relative lift lost with the blade tip at the wall",
        ),
        Parameter(
            name="p",
            unit="1",
            value=3.5,
            bounds=(0.1, 20.0),
            prior=Prior(distribution="lognorm", shape=(1.0,), scale=3.5),
            meaning="power with which the loss falls off with the axis' distance",
        ),
    ),
    source=Source(
        citation="Own rival form; values from two statements of Carter, Bouchard and Quinn 2021",
        bibtex=("carter2021",),
        doubts=("Not published; it is here to ask whether the data insist on an exponential.",),
    ),
    checks=(
        Check(x=0.3, expected=0.98, tolerance=5e-4, quoted_by="Carter et al.: 2 % at z_hat = 0.3"),
        Check(x=0.0, expected=0.95, quoted_by="Carter et al.: less than 5 %"),
    ),
    notes=__doc__ or "",
)
