"""Ratio: the quantity that a trial holds constant.

    ratio -> ratio^held_exponent

Mechanism: every published ratio is at constant something. Near a boundary a rotor's load changes,
and with it rpm, current and the voltage at the motor. A trial at constant throttle holds none of
them.

Convention: 1 leaves the model as it is; 2/3 turns a ratio of powers into one of thrusts at constant
power. About 0.60 to 0.82 is a small rotor at constant rpm (blade-element momentum theory), falling
further as the gain grows. Below 1, gains and losses shrink.

Size on a Crazyflie: under a ceiling at z_hat = 0.2 gamma is 1.516, against 1.28 to 1.33 at constant
rpm.

Confounded with K_b (correlation 0.99 to 1.00), alpha (0.997 with the datum), height_offset,
near_wall_saturation, image_strength. Lift alone cannot separate them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(ratio: Any, /, *, held_exponent: Any) -> Any:
    """L / L_inf to the power of the held quantity; nan where the ratio is not positive. Shapes
    broadcast.
    """
    return np.power(np.where(np.asarray(ratio) > 0, ratio, np.nan), held_exponent)


EFFECT = Effect(
    name="held_quantity",
    title="Held quantity",
    formula=r"\frac{L}{L_\infty} \to \left(\frac{L}{L_\infty}\right)^{n}",
    evaluate=evaluate,
    acts_on="ratio",
    belongs_to="vehicle",
    mechanism="the trial holds throttle constant, the model power, rpm or thrust",
    varies_with="z_hat",
    separated_by="logged rpm and power",
    log_next_time=("rpm", "power"),
    parameters=(
        Parameter(
            name="held_exponent",
            unit="1",
            value=1.0,
            bounds=(0.3, 1.7),
            prior=normal(1.0, 0.25),
            meaning=(
                "exponent of the ratio; 1 the model as it is, 2/3 constant power, below 1 gains"
                " shrink"
            ),
        ),
    ),
    source=Source(
        citation=(
            "Blade-element momentum theory; Carter, Bouchard and Quinn 2021 scale their models by"
            " the powers 0.6 to 1.4"
        ),
        bibtex=("carter2021",),
        doubts=(
            (
                "The exponent at constant throttle is known only between limits, and falls as the"
                " gain grows."
            ),
        ),
    ),
    checks=(
        null(2.337117),
        Check(
            x=2.337117,
            expected=1.761,
            arguments={"held_exponent": 2 / 3},
            tolerance=5e-4,
            quoted_by="gamma^(2/3) at z_hat = 0.1",
        ),
        Check(
            x=1.112372,
            expected=1.074,
            arguments={"held_exponent": 2 / 3},
            tolerance=5e-4,
            quoted_by="gamma^(2/3) at z_hat = 0.5",
        ),
    ),
    notes=__doc__ or "",
)
