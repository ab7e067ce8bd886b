"""Effects that the means of an ordinary campaign cannot detect: they act within a record, or need
trials run in two ways on purpose.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from nearlift.declare import Check, Effect, Parameter, Source, normal, null


def motor_heating(lift: Any, /, *, drift_hat: Any, heating: Any) -> Any:
    """Force: lift sinks within a trial as the motors heat.

        lift -> lift (1 + heating drift_hat / 2)

    Mechanism: in ten seconds at full throttle a coreless motor's winding warms by tens of kelvin.
    Copper's resistance rises by 0.39 %/K; current, speed and lift sink. The mean of a record that
    falls linearly by the fraction drift_hat is less than the cold lift by half of that.

    Convention: drift_hat is the slope of the record times its length over its mean, < 0 where lift
    sinks. heating 1 is the whole effect on the mean, 0 none.

    Where it shows: within the records, early against late half. On the means of trials almost
    nothing is left, since L_inf of each throttle takes up what its trials have in common.

    Size on a Crazyflie: 0 to 8 % with 5 to 120 s; a few percent in ten seconds at 92 %.

    Confounded with supply_sag within the trial (a battery sinks likewise).
    """
    return lift * (1.0 + 0.5 * heating * drift_hat)


MOTOR_HEATING = Effect(
    "motor_heating", "Motor heating",
    r"L \to L \left(1 + \frac{h}{2} \frac{\dot{L} \, t_\mathrm{record}}{L}\right)", motor_heating,
    acts_on="force", within_trial=True, varies_with="throttle", needs=("drift_hat",),
    log_next_time=("raw records",),
    mechanism="the windings heat during a trial and lift sinks",
    separated_by="logged voltage and current, cold and warm repeats",
    parameters=(
        Parameter("heating", "1", 0.0, (-1.0, 3.0), normal(0.0, 1.0),
            "share of the linear fall within a record that is missing from its mean, 1 if it"
            " begins at the cold lift", size_unit="fraction of the fall within a record"),
    ),
    source=Source("Physics of the bench; temperature coefficient of copper",
        doubts=(
            ("A fall that levels off within the record takes more than half of itself from the"
             " mean."),
        ),
    ),
    checks=(
        null(0.5, drift_hat=-0.03),
        Check(0.5, 0.495, {"drift_hat": -0.02, "heating": 1.0},
            "by hand: a fall of 2 % takes 1 % from the mean"),
    ),
)  # fmt: skip


def mount_blockage(lift: Any, /, *, inverted: Any, blockage: Any) -> Any:
    """Force: the mount is in the wake of one of two ways up.

        lift -> lift (1 - blockage inverted)

    Mechanism: upright, the vehicle draws its inflow past sting and cell; inverted, it blows its
    jets at them. The push of the jet on what carries the cell is read as lift, or taken from it.

    Convention: inverted is 1 where the vehicle hung upside down and 0 where it was upright;
    blockage > 0 reads less lift inverted.

    Size on a Crazyflie: 0 to 8 %, by the sting's breadth and its distance from the disks.

    Confounded with L_inf, wholly, where a boundary and free air were run one way up; with
    session_gain where each session was. An arrangement that runs the ground upright and the ceiling
    inverted is tested by lift far away, both ways up.
    """
    return lift * (1.0 - blockage * inverted)


MOUNT_BLOCKAGE = Effect(
    "mount_blockage", "Mount blockage", r"L \to L \, (1 - k \cdot \mathrm{inverted})",
    mount_blockage, acts_on="force", by_experiment=True, varies_with="inverted",
    needs=("inverted",), log_next_time=("orientation",),
    mechanism="upright the inflow passes sting and cell, inverted the jets blow at them",
    separated_by="lift far away, both ways up and in turns",
    parameters=(
        Parameter("blockage", "1", 0.0, (-0.2, 0.2), normal(0.0, 0.03),
            "share of lift that is not read inverted; negative reads more",
            size_unit="fraction of lift"),
    ),
    source=Source("Physics of the bench; arrangement of Carter, Bouchard and Quinn 2021",
        bibtex=("carter2021",),
        doubts=(
            "Sizes are estimates.",
            "Close to a boundary wakes turn, and a mount may be met by less or more of them.",
        ),
    ),
    checks=(
        null(0.3, inverted=1.0),
        Check(0.3, 0.3, {"inverted": 0.0, "blockage": 0.05}, "nothing upright"),
        Check(0.3, 0.285, {"inverted": 1.0, "blockage": 0.05}, "by hand: 5 % less"),
    ),
)  # fmt: skip


def cell_crosstalk(
    lift: Any, /, *, turn_rad: Any, crosstalk_along: Any, crosstalk_across: Any
) -> Any:
    """Force: the cell reads some of a moment as lift.

        lift -> lift (1 + crosstalk_along cos(turn_rad) + crosstalk_across sin(turn_rad))

    Mechanism: a vehicle whose thrust does not pass through the cell's axis loads it with a moment.
    A single-axis cell reads a part of it as force. Turned about its own axis on the cell, the
    vehicle takes its arm along, and the part changes sign.

    Convention: turn_rad is the vehicle's angle about its thrust on the cell. crosstalk_along is the
    excess reading at 0, crosstalk_across at a quarter of a turn, as shares of lift.

    Size on a Crazyflie: an arm of 1 mm at the 5 % for each millimetre of a cheap cell is 5 %. The
    0.2 N mm near a wall up to 1 gf, as much as the whole loss of lift there.

    Confounded with L_inf, wholly, where the vehicle was never turned; with session_gain where it
    was turned between sessions only. A measured moment does not separate them: the same flow causes
    it and lift, and a fit along it would explain away the boundary.
    """
    return lift * (1.0 + crosstalk_along * np.cos(turn_rad) + crosstalk_across * np.sin(turn_rad))


CELL_CROSSTALK = Effect(
    "cell_crosstalk", "Cell cross-talk", r"L \to L \, (1 + c_1 \cos \psi + c_2 \sin \psi)",
    cell_crosstalk, acts_on="force", by_experiment=True, varies_with="turn_rad",
    needs=("turn_rad",), log_next_time=("turn",),
    mechanism="thrust off the cell's axis makes a moment, part of which the cell reads",
    separated_by="repeats at 90 and 180 degrees",
    parameters=(
        Parameter("crosstalk_along", "1", 0.0, (-0.15, 0.15), normal(0.0, 0.02),
            "share of lift that is read too much where the vehicle is not turned",
            size_unit="fraction of lift"),
        Parameter("crosstalk_across", "1", 0.0, (-0.15, 0.15), normal(0.0, 0.02),
            "share of lift that is read too much a quarter of a turn from there",
            size_unit="fraction of lift"),
    ),
    source=Source("Balance of forces and moments on a single-axis cell",
        doubts=(
            "Near a wall the moment grows as the gap closes; this form has that of free air.",
            "Sizes are estimates for cheap cells.",
        ),
    ),
    checks=(
        null(0.3, turn_rad=1.0),
        Check(0.3, 0.303, {"turn_rad": 0.0, "crosstalk_along": 0.01, "crosstalk_across": 0.05},
            "by hand: 1 % of 0.3"),
        Check(0.3, 0.297, {"turn_rad": math.pi, "crosstalk_along": 0.01},
            "by hand: the other way round"),
    ),
)  # fmt: skip


def propeller_step(lift: Any, /, *, other_propeller: Any, propeller_gain: Any) -> Any:
    """Force: another propeller, or a damaged one, lifts otherwise.

        lift -> lift (1 + propeller_gain other_propeller)

    Mechanism: a blade that is nicked, bent or exchanged has another lift at the same throttle,
    suddenly and permanently.

    Convention: other_propeller is 0 with the propellers of the first trial, by their names in the
    column `propeller`, and 1 with any others. propeller_gain > 0 lifts more with those. A blade
    damaged in the course of a campaign is given a name of its own.

    Size on a Crazyflie: 1 to 5 %, for a nick or from one propeller to the next.

    Confounded with session_gain and gain_drift where propellers were exchanged once, between
    sessions. A step without a name in the schedule stays a step in time, and structure.
    """
    return lift * (1.0 + propeller_gain * other_propeller)


PROPELLER_STEP = Effect(
    "propeller_step", "Propeller change", r"L \to L \, (1 + g \cdot \mathrm{other})",
    propeller_step, acts_on="force", by_experiment=True, varies_with="other_propeller",
    needs=("other_propeller",), log_next_time=("propeller",),
    mechanism="a nicked, bent or exchanged blade has another lift at the same throttle",
    separated_by="going back to the first propellers",
    parameters=(
        Parameter("propeller_gain", "1", 0.0, (-0.2, 0.2), normal(0.0, 0.02),
            "relative lift of the other propellers over the first, less one",
            size_unit="fraction of lift"),
    ),
    source=Source("Physics of the bench",
        doubts=(
            "Sizes are estimates.",
            ("All but the first propellers are taken to be alike; several differ, and"
             " session_gain with a session for each estimates by how much."),
        ),
    ),
    checks=(
        null(0.3, other_propeller=1.0),
        Check(0.3, 0.294, {"other_propeller": 1.0, "propeller_gain": -0.02}, "by hand: 2 % less"),
    ),
)  # fmt: skip


def fountain_state(
    ratio: Any, /, *, z_hat: Any, diagonal_hat: Any, fountain_side: Any, state_gap: Any
) -> Any:
    """Ratio: the fountain has two states.

        ratio = 1 / (1 - s)  ->  1 / (1 - s - 2 state_gap fountain_side z / (b^2 + 4 z^2)^(3/2))

    with z = z_hat and b = diagonal_hat: K_b is larger by state_gap in one state, and smaller by as
    much in the other.

    Mechanism: the wall jets of neighbouring rotors collide. The fountain between them leans to one
    side and stays there, or is drawn in again by one rotor and then by the other.

    Convention: fountain_side is +1 in one state and -1 in the other, as tufts, smoke, a picture or
    the sign of a moment show. It is 0 where neither is meant. state_gap > 0 lifts more at +1.

    Size on a Crazyflie: 0 to 3 % of lift between the states, a state_gap of 0 to 1. Switching at
    some 5 Hz averages out within a trial; a state that holds for a trial or a visit does not.

    Confounded with nothing else where the states change in turns; unseen, two states are scatter of
    visits that grows near the ground.

    Refusal: nan where nothing of the inflow would be left.
    """
    state = np.where(np.isinf(z_hat), 0.0, fountain_side)
    # in 1 / z_hat, so that a height of infinity has no fountain
    slant = np.sqrt(np.square(diagonal_hat / np.maximum(z_hat, 1e-6)) + 4.0)
    more = 2.0 * state_gap * state / (np.square(np.maximum(z_hat, 1e-6)) * slant**3)
    left = 1.0 - ratio * more
    return ratio / np.where(left > 0, left, np.nan)


FOUNTAIN_STATE = Effect(
    "fountain_state", "Fountain state",
    r"\frac{1}{1 - s} \to \left[1 - s - \frac{2 k \sigma \hat{z}}{(\hat{b}^2 + 4"
    r" \hat{z}^2)^{3/2}}\right]^{-1}",
    fountain_state, acts_on="ratio", by_experiment=True, varies_with="fountain_side",
    boundaries=("ground",), needs=("z_hat", "diagonal_hat", "fountain_side"),
    log_next_time=("fountain",),
    mechanism="colliding wall jets make a fountain that leans to one side or the other",
    parameters=(
        Parameter("state_gap", "1", 0.0, (-3.0, 3.0), normal(0.0, 0.7),
            "half the difference of K_b between the two states; positive lifts more at +1",
            size_unit="half the difference of K_b"),
    ),
    source=Source(
        "Dekker et al., AIAA J. 60(7), 2022: two rotors near the ground, whose fountain switches"
        " between them; the form is this package's own",
        doubts=(
            "Read in abstracts. That the states differ in K_b alone is an own choice.",
            "The rate of switching, 5 Hz, is scaled from larger rotors.",
        ),
    ),
    checks=(
        null(1.1586, z_hat=1.0, diagonal_hat=4.0, fountain_side=1.0),
        Check(1.1, 1 / (1 / 1.1 - 2.0 / 20.0**1.5),
            {"z_hat": 1.0, "diagonal_hat": 4.0, "fountain_side": 1.0, "state_gap": 1.0},
            "by hand: the fountain of K_b = 1 at z_hat = 1, b = 4"),
        Check(1.1, 1 / (1 / 1.1 + 2.0 / 20.0**1.5),
            {"z_hat": 1.0, "diagonal_hat": 4.0, "fountain_side": -1.0, "state_gap": 1.0},
            "by hand, the other state"),
    ),
)  # fmt: skip


EFFECTS = (MOTOR_HEATING, MOUNT_BLOCKAGE, CELL_CROSSTALK, PROPELLER_STEP, FOUNTAIN_STATE)
