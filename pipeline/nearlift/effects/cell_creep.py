"""Force: the cell still recovers from the trial before.

    lift -> lift + creep previous_lift_N exp(-rest_s / creep_s)

Mechanism: a loaded cell creeps, and recovers after the load is gone. A record that begins before it
has recovered has a wrong tare, in proportion to the load of the trial before.

Convention: creep > 0 reads too much lift after a heavy trial. A tare that is taken during recovery
gives creep < 0, so both signs are admitted. previous_lift_N is 0 at the start of a session, rest_s
the pause since the end of the trial before. Without recorded times rest_s is 0, and creep takes up
the pause's part.

Size on a Crazyflie: 0 to 0.05 % of the load, 10 to 1000 s. It is below 0.02 gf on a cell of 1 kgf,
ten times that on a cheap one.

Confounded with the previous throttle's other traces: warm motors, a battery that recovers.
Throttles in ascending order make it part of L_inf.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Prior, Source, normal, null


def evaluate(lift: Any, /, *, previous_lift_N: Any, rest_s: Any, creep: Any, creep_s: Any) -> Any:
    """Lift as read, in N, so long after the trial before. Shapes broadcast."""
    return lift + creep * previous_lift_N * np.exp(-np.maximum(rest_s, 0.0) / creep_s)


EFFECT = Effect(
    name="cell_creep",
    title="Cell creep",
    formula=r"L \to L + c \, L_\mathrm{previous} \, e^{-t_\mathrm{rest} / \tau_c}",
    evaluate=evaluate,
    acts_on="force",
    additive=True,
    loaded=True,
    mechanism="the load cell still recovers from the load of the trial before",
    varies_with="previous_lift_N",
    contains_line=True,
    separated_by="throttles in random order, longer pauses, and a tare after each trial",
    log_next_time=("start", "tare_after"),
    needs=("previous_lift_N", "rest_s"),
    parameters=(
        Parameter(
            name="creep",
            unit="1",
            value=0.0,
            bounds=(-0.1, 0.1),
            prior=normal(0.0, 0.005),
            meaning=(
                "share of the previous load that is still read right after it; positive reads too"
                " much lift after a heavy trial"
            ),
        ),
        Parameter(
            name="creep_s",
            unit="s",
            value=60.0,
            bounds=(5.0, 2000.0),
            prior=Prior(distribution="lognorm", shape=(1.2,), scale=60.0),
            meaning="time over which the cell recovers to 1/e",
            grid=(15.0, 60.0, 400.0),
        ),
    ),
    source=Source(
        citation="Data sheets of strain-gauge cells; public reports on creep of cheap ones",
        doubts=("The sign depends on when the tare is taken.",),
    ),
    checks=(
        null(0.3, previous_lift_N=0.5, rest_s=5.0),
        Check(
            x=0.3,
            expected=0.3025,
            arguments={"previous_lift_N": 0.5, "rest_s": 0.0, "creep": 0.005},
            quoted_by="by hand: 0.5 % of 0.5 N",
        ),
        Check(
            x=0.3,
            expected=0.3 + 0.0025 * 0.36787944,
            arguments={"previous_lift_N": 0.5, "rest_s": 60.0, "creep": 0.005},
            quoted_by="by hand: 1/e after one time constant",
        ),
    ),
    notes=__doc__ or "",
)
