"""Lift models, a formula a file: prose, functions, and a frozen `LiftModel` for each use of it.

To add a model, write its file and name it here; a model of another package is found by its entry
point instead (`catalogue`).
"""

from nearlift.declare import LiftModel
from nearlift.models import (
    ceiling_empirical,
    cheeseman_bennett,
    corridor,
    exponential,
    hayden,
    hsiao_chirarattananon,
    images,
    power_law,
    sanchez_cuevas,
    sanchez_cuevas_as_printed,
    sidewall_decay,
    sidewall_none,
    sidewall_power_law,
)

MODELS: tuple[LiftModel, ...] = (
    sanchez_cuevas.MODEL,
    sanchez_cuevas.PUBLISHED,
    sanchez_cuevas.FREE_EXPONENT,
    sanchez_cuevas_as_printed.MODEL,
    images.MODEL,
    images.TILTED,
    images.EDGE,
    corridor.MODEL,
    cheeseman_bennett.MODEL,
    cheeseman_bennett.CONSTANT_POWER,
    cheeseman_bennett.THEORY,
    hayden.MODEL,
    exponential.MODEL,
    power_law.MODEL,
    hsiao_chirarattananon.MODEL,
    hsiao_chirarattananon.CONSTANT_POWER,
    hsiao_chirarattananon.FREE_EXPONENT,
    ceiling_empirical.MODEL,
    exponential.CEILING,
    power_law.CEILING,
    sidewall_decay.MODEL,
    sidewall_power_law.MODEL,
    sidewall_none.MODEL,
)
