"""Force: a weight that nobody declared hangs beside one rotor.

    lift -> lift exp(-weight_power imbalance),   imbalance as in rotor_imbalance

Mechanism: the rotor beside the weight is told more, the others less than the mean; and the vehicle
weighs more than was declared, so that lift, its mass times what it feels, reads too little.

Convention: weight_power is that of the command with which lift goes, or 0 for no effect.

Size: a weight of 1 % of the vehicle at a rotor's axis is worth 1 % of lift, and an imbalance of 1 %
over the command's power.

Confounded with rotor_imbalance, always: in hover both ask for the same commands and read the same
lift. Also with session_gain, where the weight is there for whole flights.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, imbalance: Any, weight_power: Any) -> Any:
    """Lift with such a weight, as it is read. Shapes broadcast."""
    return lift * np.exp(-weight_power * imbalance)


EFFECT = Effect(
    name="weight_at_rotor",
    title="Weight beside a rotor",
    formula=r"L \to L \, \min_i (s_i / s_{i0})^{q_w}",
    evaluate=evaluate,
    acts_on="force",
    belongs_to="flight",
    mechanism="a weight beside a rotor asks for more of it, and is not in the declared mass",
    varies_with="imbalance",
    separated_by="a scale",
    log_next_time=("command_share_1",),
    needs=("imbalance",),
    parameters=(
        Parameter(
            name="weight_power",
            unit="1",
            value=0.0,
            bounds=(0.0, 3.0),
            prior=normal(0.0, 1.0),
            meaning="power of the command with which lift goes, as far as a weight lies aside",
        ),
    ),
    source=Source(
        citation="Balance of moments about the vehicle's centre, and thrust as a power of command",
        doubts=("A weight between two rotors is told by both, and counts for half.",),
    ),
    checks=(
        null(0.3, imbalance=0.02),
        Check(
            x=0.3,
            expected=0.297,
            arguments={"imbalance": 0.01 / 1.7, "weight_power": 1.7},
            tolerance=1e-3,
            quoted_by="by hand: a weight of 1 % at a rotor reads 1 % less lift",
        ),
    ),
    notes=__doc__ or "",
)
