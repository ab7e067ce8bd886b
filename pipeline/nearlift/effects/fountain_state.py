"""Ratio: the fountain has two states.

    ratio = 1 / (1 - s)  ->  1 / (1 - s - 2 state_gap fountain_side z / (b^2 + 4 z^2)^(3/2))

with z = z_hat and b = diagonal_hat: K_b is larger by state_gap in one state, and smaller by as much
in the other.

Mechanism: the wall jets of neighbouring rotors collide. The fountain between them leans to one side
and stays there, or is drawn in again by one rotor and then by the other.

Convention: fountain_side is +1 in one state and -1 in the other, as tufts, smoke, a picture or the
sign of a moment show. It is 0 where neither is meant. state_gap > 0 lifts more at +1.

Size on a Crazyflie: 0 to 3 % of lift between the states, a state_gap of 0 to 1. Switching at some 5
Hz averages out within a trial; a state that holds for a trial or a visit does not.

Confounded with nothing else where the states change in turns; unseen, two states are scatter of
visits that grows near the ground.

Refusal: nan where nothing of the inflow would be left.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(
    ratio: Any, /, *, z_hat: Any, diagonal_hat: Any, fountain_side: Any, state_gap: Any
) -> Any:
    """L / L_inf in that state. Shapes broadcast."""
    state = np.where(np.isinf(z_hat), 0.0, fountain_side)
    # in 1 / z_hat, so that a height of infinity has no fountain
    slant = np.sqrt(np.square(diagonal_hat / np.maximum(z_hat, 1e-6)) + 4.0)
    more = 2.0 * state_gap * state / (np.square(np.maximum(z_hat, 1e-6)) * slant**3)
    left = 1.0 - ratio * more
    return ratio / np.where(left > 0, left, np.nan)


EFFECT = Effect(
    name="fountain_state",
    title="Fountain state",
    formula=(
        r"\frac{1}{1 - s} \to \left[1 - s - \frac{2 k \sigma \hat{z}}{(\hat{b}^2 + 4"
        r" \hat{z}^2)^{3/2}}\right]^{-1}"
    ),
    evaluate=evaluate,
    acts_on="ratio",
    boundaries=("ground",),
    by_experiment=True,
    mechanism="colliding wall jets make a fountain that leans to one side or the other",
    varies_with="fountain_side",
    log_next_time=("fountain",),
    needs=("z_hat", "diagonal_hat", "fountain_side"),
    parameters=(
        Parameter(
            name="state_gap",
            unit="1",
            value=0.0,
            bounds=(-3.0, 3.0),
            prior=normal(0.0, 0.7),
            meaning="half the difference of K_b between the two states; positive lifts more at +1",
        ),
    ),
    source=Source(
        citation=(
            "Dekker et al., AIAA J. 60(7), 2022: two rotors near the ground, whose fountain"
            " switches between them; the form is this package's own"
        ),
        doubts=(
            "Read in abstracts. That the states differ in K_b alone is an own choice.",
            "The rate of switching, 5 Hz, is scaled from larger rotors.",
        ),
    ),
    checks=(
        null(1.1586, z_hat=1.0, diagonal_hat=4.0, fountain_side=1.0),
        Check(
            x=1.1,
            expected=1 / (1 / 1.1 - 2.0 / 20.0**1.5),
            arguments={
                "z_hat": 1.0,
                "diagonal_hat": 4.0,
                "fountain_side": 1.0,
                "state_gap": 1.0,
            },
            quoted_by="by hand: the fountain of K_b = 1 at z_hat = 1, b = 4",
        ),
        Check(
            x=1.1,
            expected=1 / (1 / 1.1 + 2.0 / 20.0**1.5),
            arguments={
                "z_hat": 1.0,
                "diagonal_hat": 4.0,
                "fountain_side": -1.0,
                "state_gap": 1.0,
            },
            quoted_by="by hand, the other state",
        ),
    ),
    notes=__doc__ or "",
)
