"""Height: backlash of the traverse.

    z_hat -> z_hat + approach * backlash_m / (2 r)

Mechanism: play between nut and screw. The rotor plane is half the play to one side or the other of
the counter's position, by the direction of the last move.

Convention: approach is +1 when the last move was away from the boundary, -1 towards it, 0 where the
traverse did not move. backlash_m > 0 where the vehicle is farther than recorded after a move away
(it overshoots). A nut that trails the screw gives backlash_m < 0, so both signs are admitted. In
free air nothing changes, whatever the value of `approach`.

Size on a Crazyflie: play up to 0.3 mm. Above ground up to 0.1 %, under a ceiling up to 11 % of lift
at z_hat = 0.1.

Confounded with height_offset where every station was approached from one side, as the nearest and
the farthest always are; otherwise looks like scatter of repeats.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(z_hat: Any, /, *, radius_m: Any, approach: Any, backlash_m: Any) -> Any:
    """True z_hat from the recorded one. Shapes broadcast."""
    # in free air there is no distance to be wrong about, and no approach on record
    side = np.where(np.isinf(z_hat), 0.0, approach)
    return z_hat + side * backlash_m / (2.0 * radius_m)


EFFECT = Effect(
    name="approach_backlash",
    title="Backlash",
    formula=r"\hat{z} \to \hat{z} + \mathrm{approach} \cdot h / (2 r)",
    evaluate=evaluate,
    acts_on="height",
    mechanism="play of the traverse, taken up in the direction of its last move",
    varies_with="approach",
    separated_by="a sweep in both directions over the same stations",
    log_next_time=("approach",),
    needs=("radius_m", "approach"),
    parameters=(
        Parameter(
            name="backlash_m",
            unit="m",
            value=0.0,
            bounds=(-1e-3, 1e-3),
            prior=normal(0.0, 0.2e-3),
            meaning=(
                "play of the traverse; positive where the vehicle is too far after a move away"
                " from the boundary, negative where it trails"
            ),
        ),
    ),
    source=Source(
        citation="Physics of the bench",
        doubts=(
            (
                "Which way the play is taken up depends on what the counter reads, screw or"
                " carriage; hence both signs."
            ),
        ),
    ),
    checks=(
        null(0.5, radius_m=0.023, approach=-1.0),
        Check(
            x=1.0,
            expected=1.005,
            arguments={"radius_m": 0.023, "approach": 1.0, "backlash_m": 0.23e-3},
            quoted_by="by hand: 0.115 mm of 23 mm",
        ),
        Check(
            x=1.0,
            expected=0.995,
            arguments={"radius_m": 0.023, "approach": -1.0, "backlash_m": 0.23e-3},
            quoted_by="by hand, the other side",
        ),
    ),
    notes=__doc__ or "",
)
