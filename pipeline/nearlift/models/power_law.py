"""Ground: a power law of height.

    L / L_inf = 1 + a z_hat^(-p)

Convention: a > 0 gains lift, p > 0. z_hat is rotor plane to ground over rotor radius.

Approximation: empirical. p = 2 and a = 1/16 is Cheeseman and Bennett to first order. A quadrotor's
images add up to a = 1/4 with p = 2 far away and less near by. A single power fits either range and
not both. No pole above contact.

Refusal: nan where z_hat is not positive.

Traps: a and p are strongly correlated; a is the gain at z_hat = 1, even without stations there. The
ground term of a widely used simulator is this form with p = 2 and a = 11.36859 / 16. That is some
3.5 times the gain that the paper measures.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from nearlift.declare import Check, LiftModel, Parameter, Prior, Source, normal
from nearlift.models.inflow import clear_of_boundary


def evaluate(z_hat: Any, /, *, a: Any, p: Any) -> Any:
    """L / L_inf; nan where z_hat is not positive. Shapes broadcast."""
    return 1.0 + a * clear_of_boundary(z_hat) ** -p


AMPLITUDE = Parameter(
    name="a",
    unit="1",
    value=0.0625,
    bounds=(-1.0, 5.0),
    prior=normal(0.0625, 0.5),
    meaning="relative lift gained at z_hat = 1",
)
POWER = Parameter(
    name="p",
    unit="1",
    value=2.0,
    bounds=(0.1, 8.0),
    prior=Prior(distribution="lognorm", shape=(0.75,), scale=2.0),
    meaning="power with which the gain falls off with height",
)
_SIMULATOR = {"a": 11.36859 / 16, "p": 2.0}

MODEL = LiftModel(
    name="power_law",
    title="Power law",
    formula=r"\frac{L}{L_\infty} = 1 + a \, \hat{z}^{-p}",
    evaluate=evaluate,
    boundary="ground",
    parameters=(AMPLITUDE, POWER),
    source=Source(
        citation=(
            "Carter, Bouchard and Quinn 2021 ('power law dependencies between lift and ground"
            " proximity'); defaults: Cheeseman and Bennett to first order"
        ),
        bibtex=("carter2021", "cheeseman1955"),
        doubts=(
            "The paper states no power and no amplitude.",
            (
                "The simulator's coefficient 11.36859 (gym-pybullet-drones) is stated to be"
                " inspired by a published model. Its height is clipped, and a fork disables it for"
                " lack of data."
            ),
        ),
    ),
    checks=(
        Check(x=2.0, expected=1.015625, quoted_by="1 + 1/64, Cheeseman and Bennett to first order"),
        Check(
            x=1.0,
            expected=1.71,
            arguments=_SIMULATOR,
            tolerance=1e-3,
            quoted_by="gym-pybullet-drones' ground term",
        ),
        Check(x=2.0, expected=1.178, arguments=_SIMULATOR, tolerance=5e-4, quoted_by="the same"),
        Check(x=3.0, expected=1.079, arguments=_SIMULATOR, tolerance=5e-4, quoted_by="the same"),
    ),
    notes=__doc__ or "",
)


CEILING = replace(
    MODEL,
    name="ceiling_power_law",
    boundary="ceiling",
    parameters=(
        replace(AMPLITUDE, value=0.03125, bounds=(-1.0, 2.0), prior=normal(0.03125, 0.25)),
        replace(POWER, meaning="power with which the gain falls off with distance"),
    ),
    source=Source(
        citation="Hsiao and Chirarattananon's gamma to first order far away (own expansion)",
        doi="10.1109/TMECH.2019.2929589",
        bibtex=("hsiao2019",),
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
    notes="""\
Ceiling: a power law of distance.

    L / L_inf = 1 + a z_hat^(-p)

Convention: a > 0 gains lift, p > 0. z_hat is rotor plane to ceiling over rotor radius.

Approximation: empirical. gamma goes from p = 2, a = alpha / 4 far away to p = 1, a = sqrt(alpha) /
2 close to the ceiling. One power fits either range and not both.

Refusal: nan where z_hat is not positive.

Traps: those of the ground's `power_law`.
""",
)
