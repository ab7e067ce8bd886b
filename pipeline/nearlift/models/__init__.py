"""Lift models, one file each: prose, function, and one frozen `MODEL` that says everything else.

To add a model, write its file and name it here; a model of another package is found by its entry
point instead (`catalogue`).
"""

from nearlift.declare import LiftModel
from nearlift.models import (
    ceiling_empirical,
    ceiling_exponential,
    ceiling_power_law,
    cheeseman_bennett,
    cheeseman_bennett_constant_power,
    cheeseman_bennett_fixed,
    exponential,
    hayden,
    hsiao_chirarattananon,
    hsiao_chirarattananon_constant_power,
    hsiao_chirarattananon_free_exponent,
    images,
    power_law,
    sanchez_cuevas,
    sanchez_cuevas_as_printed,
    sanchez_cuevas_free_exponent,
    sanchez_cuevas_published,
    sidewall_decay,
    sidewall_none,
    sidewall_power_law,
)

MODELS: tuple[LiftModel, ...] = (
    sanchez_cuevas.MODEL,
    sanchez_cuevas_published.MODEL,
    sanchez_cuevas_free_exponent.MODEL,
    sanchez_cuevas_as_printed.MODEL,
    images.MODEL,
    cheeseman_bennett.MODEL,
    cheeseman_bennett_constant_power.MODEL,
    cheeseman_bennett_fixed.MODEL,
    hayden.MODEL,
    exponential.MODEL,
    power_law.MODEL,
    hsiao_chirarattananon.MODEL,
    hsiao_chirarattananon_constant_power.MODEL,
    hsiao_chirarattananon_free_exponent.MODEL,
    ceiling_empirical.MODEL,
    ceiling_exponential.MODEL,
    ceiling_power_law.MODEL,
    sidewall_decay.MODEL,
    sidewall_power_law.MODEL,
    sidewall_none.MODEL,
)
