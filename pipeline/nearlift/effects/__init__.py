"""Candidate effects, one file each: what a model may lack. See `nearlift.declare.Effect`.

An effect enters only with a physical mechanism and a form; steps, ripples and periodic disturbances
without one stay structure without a name. To add an effect, write its file and name it here; an
effect of another package is found by its entry point (`catalogue`). Every name competes with the
others: add one only if its covariate or its shape is its own. (Download on an airframe, for one, is
`airframe_stagnation` with another sign: its constant part is in L_inf.)
"""

import importlib
from collections.abc import Mapping
from types import MappingProxyType

from nearlift.declare import Effect
from nearlift.effects.air_density import STANDARD

ORDER = (
    "height_offset",
    "height_scale",
    "approach_backlash",
    "near_wall_saturation",
    "held_quantity",
    "airframe_stagnation",
    "fountain_shape",
    "image_strength",
    "plate_edge",
    "tilt",
    "reynolds",
    "room_recirculation",
    "session_gain",
    "gain_drift",
    "warm_up",
    "rotor_speed",
    "supply_sag",
    "air_density",
    "zero_offset",
    "zero_drift",
    "zero_temperature",
    "cell_nonlinearity",
    "cell_creep",
    "tether_stiffness",
    "motor_heating",
    "mount_blockage",
    "cell_crosstalk",
    "propeller_step",
    "fountain_state",
)
EFFECTS: tuple[Effect, ...] = tuple(
    importlib.import_module(f"{__name__}.{name}").EFFECT for name in ORDER
)

#: Needs that an effect can do without, and the neutral value that stands in where nobody recorded
#: them.
STAND_INS: Mapping[str, float] = MappingProxyType({**STANDARD, "rest_s": 0.0})
