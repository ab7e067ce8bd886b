"""Force: motors warm up within a session.

    lift -> lift (1 + warming exp(-since_start_s / warming_s))

Mechanism: at the start of a sitting windings, bearings and grease are cold. Warm copper (+0.39 %/K)
takes current away, warm grease gives speed; over the first minutes lift settles.

Convention: warming is the excess of lift at the session's first trial over the settled state. It is
> 0 where lift sinks as motors warm (copper), < 0 where it rises (grease). since_start_s is the time
since the first trial of the session.

Size on a Crazyflie: 0 to 8 % with 5 to 120 s for the winding alone, slower for motor and arm
together. Cooling in a rest between trials is not included.

Confounded with zero_drift (same time, additive), supply_sag of a battery, and distance where every
session begins at the same station. A warm-up run before the first trial avoids it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Prior, Source, normal, null


def evaluate(
    lift: Any, /, *, session: Any, since_start_s: Any, warming: Any, warming_s: Any
) -> Any:
    """Lift so long after the start of the session. Shapes broadcast."""
    return lift * (1.0 + warming * np.exp(-since_start_s / warming_s))


EFFECT = Effect(
    name="warm_up",
    title="Warm-up",
    formula=r"L \to L \left(1 + w \, e^{-t_\mathrm{session} / \tau_w}\right)",
    evaluate=evaluate,
    acts_on="force",
    mechanism="motors warm up over the first minutes of a session",
    varies_with="since_start_s",
    contains_line=True,
    separated_by="random order and cold repeats",
    log_next_time=("session", "start"),
    needs=("session", "since_start_s"),
    parameters=(
        Parameter(
            name="warming",
            unit="1",
            value=0.0,
            bounds=(-0.15, 0.15),
            prior=normal(0.0, 0.02),
            meaning=(
                "relative excess of lift at the start of a session; positive where lift sinks as"
                " motors warm"
            ),
        ),
        Parameter(
            name="warming_s",
            unit="s",
            value=300.0,
            bounds=(20.0, 4000.0),
            prior=Prior(distribution="lognorm", shape=(1.0,), scale=300.0),
            meaning="time over which the excess falls to 1/e",
            grid=(80.0, 300.0, 1200.0),
        ),
    ),
    source=Source(
        citation="Physics of the bench; temperature coefficient of copper",
        doubts=(
            "The sign depends on what warms first.",
            "Times of a motor in its arm are estimates.",
        ),
    ),
    checks=(
        null(0.3, session=0, since_start_s=0.0),
        Check(
            x=0.3,
            expected=0.306,
            arguments={"session": 0, "since_start_s": 0.0, "warming": 0.02},
            quoted_by="by hand: 2 % at the start",
        ),
        Check(
            x=1.0,
            expected=1.0073576,
            arguments={"session": 0, "since_start_s": 300.0, "warming": 0.02, "warming_s": 300.0},
            quoted_by="by hand: 0.02 / e",
        ),
    ),
    notes=__doc__ or "",
)
