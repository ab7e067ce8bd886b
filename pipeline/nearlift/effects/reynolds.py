"""Ratio: the relative effect depends on throttle.

    ratio -> 1 + (ratio - 1) (1 + reynolds_slope ln(throttle / throttle_ref))

Mechanism: blades of 6 mm chord work at a Reynolds number near 13 000, where lift slope and losses
change with speed. So do the viscous losses in the gap. The gain then differs by throttle.

Convention: reynolds_slope > 0 where the gain grows with throttle; throttle_ref is the median of the
campaign's throttles, at which the base model's coefficients hold. L_inf at each throttle is free,
so lift far away is unaffected.

Size on a Crazyflie: C_L rises by 10 % from 25 to 92 % throttle. In the *ratio* that is second
order, 0 to 1 % of lift, so a slope of 0.05.

Confounded with zero_offset, cell_nonlinearity and supply_sag, which also act differently at each
throttle.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(ratio: Any, /, *, throttle: Any, throttle_ref: Any, reynolds_slope: Any) -> Any:
    """L / L_inf with a gain that depends on throttle (> 0). Shapes broadcast."""
    return ratio + (ratio - 1.0) * reynolds_slope * np.log(throttle / throttle_ref)


EFFECT = Effect(
    name="reynolds",
    title="Reynolds number",
    formula=(
        r"\frac{L}{L_\infty} \to 1 + \left(\frac{L}{L_\infty} - 1\right) \left(1 + m \ln"
        r" \frac{\tau}{\tau_0}\right)"
    ),
    evaluate=evaluate,
    acts_on="ratio",
    mechanism="the blades' Reynolds number, and with it the gain, changes with throttle",
    varies_with="throttle",
    separated_by=(
        "logged rpm and supply, a motors-off sweep,"
        " and repeats at equal throttle from another supply"
    ),
    log_next_time=("rpm",),
    needs=("throttle", "throttle_ref"),
    parameters=(
        Parameter(
            name="reynolds_slope",
            unit="1",
            value=0.0,
            bounds=(-1.0, 1.0),
            prior=normal(0.0, 0.1),
            meaning=(
                "relative change of the gain per unit of ln throttle; positive where the gain grows"
                " with throttle"
            ),
        ),
    ),
    source=Source(
        citation=(
            "Deters, Ananda and Selig 2014 (small propellers); Bitcraze's table of lift against"
            " throttle"
        ),
        doubts=(
            "Both speak of lift far away; that the ratio follows is an estimate.",
            "Throttle replaces rotor speed.",
        ),
    ),
    checks=(
        null(1.15, throttle=0.25, throttle_ref=0.625),
        Check(
            x=1.15,
            expected=1.165,
            arguments={"throttle": 0.2718281828, "throttle_ref": 0.1, "reynolds_slope": 0.1},
            quoted_by="by hand: a tenth more gain at e times the throttle",
        ),
    ),
    notes=__doc__ or "",
)
