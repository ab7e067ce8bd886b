"""Force: the mount is in the wake of one of two ways up.

    lift -> lift (1 - blockage inverted)

Mechanism: upright, the vehicle draws its inflow past sting and cell; inverted, it blows its jets at
them. The push of the jet on what carries the cell is read as lift, or taken from it.

Convention: inverted is 1 where the vehicle hung upside down and 0 where it was upright;
blockage > 0 reads less lift inverted.

Size on a Crazyflie: 0 to 8 %, by the sting's breadth and its distance from the disks.

Confounded with L_inf, wholly, where a boundary and free air were run one way up; with session_gain
where each session was. An arrangement that runs the ground upright and the ceiling inverted is
tested by lift far away, both ways up.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def evaluate(lift: Any, /, *, inverted: Any, blockage: Any) -> Any:
    """Lift as read that way up. Shapes broadcast."""
    return lift * (1.0 - blockage * inverted)


EFFECT = Effect(
    name="mount_blockage",
    title="Mount blockage",
    formula=r"L \to L \, (1 - k \cdot \mathrm{inverted})",
    evaluate=evaluate,
    acts_on="force",
    by_experiment=True,
    mechanism="upright the inflow passes sting and cell, inverted the jets blow at them",
    varies_with="inverted",
    contains_line=True,
    separated_by="lift far away, both ways up and in turns",
    log_next_time=("orientation",),
    needs=("inverted",),
    parameters=(
        Parameter(
            name="blockage",
            unit="1",
            value=0.0,
            bounds=(-0.2, 0.2),
            prior=normal(0.0, 0.03),
            meaning="share of lift that is not read inverted; negative reads more",
        ),
    ),
    source=Source(
        citation="Physics of the bench; arrangement of Carter, Bouchard and Quinn 2021",
        bibtex=("carter2021",),
        doubts=(
            "Sizes are estimates.",
            "Close to a boundary wakes turn, and a mount may be met by less or more of them.",
        ),
    ),
    checks=(
        null(0.3, inverted=1.0),
        Check(
            x=0.3,
            expected=0.3,
            arguments={"inverted": 0.0, "blockage": 0.05},
            quoted_by="nothing upright",
        ),
        Check(
            x=0.3,
            expected=0.285,
            arguments={"inverted": 1.0, "blockage": 0.05},
            quoted_by="by hand: 5 % less",
        ),
    ),
    notes=__doc__ or "",
)
