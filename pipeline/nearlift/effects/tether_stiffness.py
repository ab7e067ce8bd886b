"""Force: the wiring pulls in proportion to height.

    lift -> lift + stiffness_N_per_m z_hat r

Mechanism: leads and tether bend as the vehicle is moved. The tare does not remove all of their pull
(it stiffens under current and in the jet). The rest varies with the distance from the boundary.

Convention: stiffness_N_per_m > 0 reads too much lift far from the boundary. Counted from contact;
in free air, where no distance is on record, nothing is added. A pull that is the same at all
distances is `zero_offset`.

Size on a Crazyflie: 0 to 20 mN/m, so 0 to 1 mN (0.4 % of the weight) over 50 mm. 5 mN at the
farthest station of 265 mm.

Confounded with K_b (a long tail), room_recirculation, plate_edge; at a single throttle with
anything slow in distance.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, z_hat: Any, radius_m: Any, stiffness_N_per_m: Any) -> Any:
    """Lift as read, in N. Shapes broadcast."""
    return lift + stiffness_N_per_m * np.where(np.isinf(z_hat), 0.0, z_hat) * radius_m


EFFECT = Effect(
    name="tether_stiffness",
    title="Tether stiffness",
    formula=r"L \to L + k_c \, r \hat{z}",
    evaluate=evaluate,
    acts_on="force",
    additive=True,
    mechanism="bent wiring pulls in proportion to height",
    varies_with="z_hat",
    contains_line=True,
    separated_by=(
        "a sweep of heights with motors off, and low throttle, where it is largest in proportion"
    ),
    log_next_time=("motors-off sweep of heights",),
    needs=("z_hat", "radius_m"),
    parameters=(
        Parameter(
            name="stiffness_N_per_m",
            unit="N/m",
            value=0.0,
            bounds=(-0.2, 0.2),
            prior=normal(0.0, 0.02),
            meaning=(
                "pull of the wiring per metre from the boundary; positive reads too much lift far"
                " away"
            ),
        ),
    ),
    source=Source(
        citation="Physics of the bench",
        doubts=("0 to 20 mN/m is an estimate for thin leads; it depends on their routing.",),
    ),
    checks=(
        null(0.265, z_hat=5.0, radius_m=0.023),
        Check(
            x=0.265,
            expected=0.266,
            arguments={"z_hat": 50 / 23, "radius_m": 0.023, "stiffness_N_per_m": 0.02},
            quoted_by="20 mN/m over 50 mm: 1 mN",
        ),
    ),
    notes=__doc__ or "",
)
