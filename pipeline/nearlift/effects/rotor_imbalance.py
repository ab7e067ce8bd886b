"""Force: a rotor gives less than the others at the same command.

    lift -> lift exp(-imbalance_power imbalance),   imbalance = -log min_i(s_i / s_i0)

Mechanism: rotors have to balance each other. One that gives less is told more, so that at the same
mean command the others are told less, and lift is theirs: it falls by the power of the command with
which lift goes. s_i is a rotor's command over the mean of all, s_i0 its median over the campaign.

Convention: imbalance is 0 where no rotor is told less than usual, and positive elsewhere;
imbalance_power is that of the command, 1.5 to 2.2, or 0 for no effect.

Size: where lift goes with the power 1.7, a rotor of four that gives 4 % less is told 1.8 % more
than the mean, the others 0.6 % less, and lift falls by 1 %.

Confounded with weight_at_rotor, always, and with session_gain, where a rotor is worse for whole
flights.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, imbalance: Any, imbalance_power: Any) -> Any:
    """Lift with such rotors. Shapes broadcast."""
    return lift * np.exp(-imbalance_power * imbalance)


EFFECT = Effect(
    name="rotor_imbalance",
    title="Rotors that differ",
    formula=r"L \to L \, \min_i (s_i / s_{i0})^{q}",
    evaluate=evaluate,
    acts_on="force",
    belongs_to="flight",
    mechanism="a rotor that gives less is told more, and at the same mean command the others less",
    varies_with="imbalance",
    separated_by="a scale, and the same flights with propellers exchanged",
    log_next_time=("command_share_1",),
    needs=("imbalance",),
    parameters=(
        Parameter(
            name="imbalance_power",
            unit="1",
            value=0.0,
            bounds=(0.0, 3.0),
            prior=normal(0.0, 1.0),
            meaning="power of the command with which lift goes, as far as commands differ",
        ),
    ),
    source=Source(
        citation="Balance of moments about the vehicle's centre, and thrust as a power of command",
        doubts=(
            "Commands of single rotors also answer gusts and turns, which change no lift.",
            "One rotor at a time is meant: two worse ones on a diagonal look alike in yaw alone.",
        ),
    ),
    checks=(
        null(0.3, imbalance=0.02),
        Check(
            x=0.3,
            expected=0.2969,
            arguments={"imbalance": 0.00607, "imbalance_power": 1.7},
            tolerance=1e-3,
            quoted_by="by hand: one of four rotors gives 4 % less, and lift is 1 % less",
        ),
    ),
    notes=__doc__ or "",
)
