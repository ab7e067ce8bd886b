"""Force: a climbing rotor draws its air from above.

    lift -> lift [1 - climb_loss (l - 1)],   l = c / 2 + sqrt(1 + c^2 / 4),   c = climb_hat

Mechanism: climb adds to the inflow, which takes angle of attack from the blades at the same speed.
l is the inflow over that of hover at the same thrust (momentum theory).

Convention: climb_hat is the climb over the induced velocity of hover, positive upwards; climb_loss
> 0 loses lift in climb and gains it in descent. Blade-element theory has climb_loss = 2 k / (1 + k)
with k = solidity x lift slope / (16 hover inflow ratio): 0 to 2, and 0.2 to 1.1 for propellers.

Size: a Crazyflie, whose induced velocity is 4.5 m/s, lost 4.4 % of lift per m/s of climb.

Confounded with motor_lag, which acts as climb changes: 0.6 % per m/s for every 10 ms.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, climb_hat: Any, climb_loss: Any) -> Any:
    """Lift at that climb. Shapes broadcast."""
    inflow = climb_hat / 2 + np.sqrt(1 + climb_hat**2 / 4)
    return lift * (1.0 - climb_loss * (inflow - 1.0))


EFFECT = Effect(
    name="climb_inflow",
    title="Inflow of climb",
    formula=(
        r"L \to L \left[1 - c_w \left(\tfrac{w}{2} + \sqrt{1 + \tfrac{w^2}{4}} - 1\right)\right]"
    ),
    evaluate=evaluate,
    acts_on="force",
    belongs_to="flight",
    mechanism="air that a climb adds to the inflow takes angle of attack from the blades",
    varies_with="climb_hat",
    separated_by="climbs at several rates that last longer than the motors lag",
    log_next_time=("climb_m_s",),
    needs=("climb_hat",),
    parameters=(
        Parameter(
            name="climb_loss",
            unit="1",
            value=0.0,
            bounds=(0.0, 2.0),
            prior=normal(0.0, 0.5),
            meaning="loss of lift per rise of the inflow, both relative; positive loses in climb",
        ),
    ),
    source=Source(
        citation=(
            "Momentum and blade-element theory of axial climb: Leishman, Principles of Helicopter"
            " Aerodynamics, 2nd ed. 2006, ch. 2 and 3"
        ),
        doubts=(
            "Momentum theory ends where descent is faster than a quarter of the induced velocity.",
            "The motors slow down under more torque, so that a held command loses more.",
        ),
    ),
    checks=(
        null(0.3, climb_hat=0.2),
        Check(
            x=1.0,
            expected=0.958005,
            arguments={"climb_hat": 0.2, "climb_loss": 0.4},
            tolerance=1e-6,
            quoted_by="by hand: inflow 0.1 + 1.0049876",
        ),
        Check(
            x=1.0,
            expected=1.0 - 0.044,
            arguments={"climb_hat": 1 / 4.45, "climb_loss": 0.37},
            tolerance=1e-3,
            quoted_by="a measured flight: 4.4 % per m/s at 4.45 m/s of induced velocity",
        ),
    ),
    notes=__doc__ or "",
)
