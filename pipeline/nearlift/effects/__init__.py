"""Candidate effects: what a model may lack. See `nearlift.declare.Effect`.

An effect is one block in the module of its kind: a function and its declaration. The function's
docstring states mechanism, convention, size and what the effect is confounded with. The declaration
has a row for each parameter. An effect enters only with a physical mechanism and a form; steps,
ripples and periodic disturbances without one stay structure without a name. To add an effect, write
its block; an effect of another package is found by its entry point (`catalogue`). Every name
competes with the others: add one only if its covariate or its shape is its own. (Download on an
airframe, for one, is `airframe_stagnation` with another sign: its constant part is in L_inf.)
"""

from collections.abc import Mapping
from types import MappingProxyType

from nearlift.declare import Effect
from nearlift.effects import experiment, force, gain, height, ratio

EFFECTS: tuple[Effect, ...] = (
    *height.EFFECTS,
    *ratio.EFFECTS,
    *gain.EFFECTS,
    *force.EFFECTS,
    *experiment.EFFECTS,
)

#: Needs that an effect can do without, and the neutral value of each where it is not recorded.
STAND_INS: Mapping[str, float] = MappingProxyType({**gain.STANDARD, "rest_s": 0.0})
