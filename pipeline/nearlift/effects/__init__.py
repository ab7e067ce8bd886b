"""Candidate effects, one file each: what a model may lack. See `nearlift.declare.Effect`.

An effect enters only with a physical mechanism and a form; steps, ripples and periodic disturbances
without one stay structure without a name. To add an effect, write its file and name it here; an
effect of another package is found by its entry point (`catalogue`). Every name competes with the
others: add one only if its covariate or its shape is its own. (Download on an airframe, for one, is
`airframe_stagnation` with another sign: its constant part is in L_inf.)
"""

from collections.abc import Mapping
from types import MappingProxyType

from nearlift.declare import Effect
from nearlift.effects import (
    air_density,
    airframe_stagnation,
    approach_backlash,
    cell_creep,
    cell_crosstalk,
    cell_nonlinearity,
    climb_inflow,
    fountain_shape,
    fountain_state,
    gain_drift,
    height_offset,
    height_scale,
    held_quantity,
    image_strength,
    motor_heating,
    motor_lag,
    mount_blockage,
    near_wall_saturation,
    plate_edge,
    propeller_step,
    reynolds,
    room_recirculation,
    rotor_imbalance,
    rotor_speed,
    session_gain,
    supply_sag,
    tether_stiffness,
    tilt,
    translational_lift,
    vehicle_mass,
    warm_up,
    weight_at_rotor,
    zero_drift,
    zero_offset,
    zero_temperature,
)

EFFECTS: tuple[Effect, ...] = (
    height_offset.EFFECT,
    height_scale.EFFECT,
    approach_backlash.EFFECT,
    near_wall_saturation.EFFECT,
    held_quantity.EFFECT,
    airframe_stagnation.EFFECT,
    fountain_shape.EFFECT,
    image_strength.EFFECT,
    plate_edge.EFFECT,
    tilt.EFFECT,
    reynolds.EFFECT,
    room_recirculation.EFFECT,
    session_gain.EFFECT,
    gain_drift.EFFECT,
    warm_up.EFFECT,
    rotor_speed.EFFECT,
    supply_sag.EFFECT,
    air_density.EFFECT,
    zero_offset.EFFECT,
    zero_drift.EFFECT,
    zero_temperature.EFFECT,
    cell_nonlinearity.EFFECT,
    cell_creep.EFFECT,
    tether_stiffness.EFFECT,
    motor_heating.EFFECT,
    climb_inflow.EFFECT,
    translational_lift.EFFECT,
    motor_lag.EFFECT,
    rotor_imbalance.EFFECT,
    weight_at_rotor.EFFECT,
    vehicle_mass.EFFECT,
    mount_blockage.EFFECT,
    cell_crosstalk.EFFECT,
    propeller_step.EFFECT,
    fountain_state.EFFECT,
)

#: Needs that an effect can do without, and the neutral value that stands in where nobody recorded
#: them.
STAND_INS: Mapping[str, float] = MappingProxyType({**air_density.STANDARD, "rest_s": 0.0})
