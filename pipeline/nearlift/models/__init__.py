"""Lift models by theory: images, momentum, empirical forms, and sidewalls.

A model is one block in the module of its theory: a function and its declaration. The function's
docstring states convention, approximation, refusal and traps. The declaration has a row for each
parameter. To add a model, write its block; a model of another package is found by its entry point
instead (`catalogue`).
"""

from nearlift.declare import LiftModel
from nearlift.models import empirical, images, momentum, sidewall

MODELS: tuple[LiftModel, ...] = (
    *images.MODELS,
    *empirical.GROUND,
    *momentum.MODELS,
    *empirical.CEILING,
    *sidewall.MODELS,
)
