"""Declarations of models, effects and parameters: frozen values, checked when they are made.

A declaration is one immutable value at the end of its own file. Evaluation, fitting, sampling,
documentation and tests all read it; nothing about it is written twice. The keyword-only names of
`evaluate` are the table of its needs, so a declaration whose function and table disagree cannot be
imported.

Broadcasting is part of the contract: with parameters of shape (m, 1) and x of shape (n,),
`evaluate` returns (m, n).
"""

from nearlift.declare.composition import compose
from nearlift.declare.declaration import (
    BOUNDARIES,
    BoolArray,
    Boundary,
    Declaration,
    Effect,
    Evaluate,
    FloatArray,
    IntArray,
    LiftModel,
    keywords,
)
from nearlift.declare.parameter import Check, Parameter, Prior, Source, normal, null, uniform
from nearlift.declare.variants import variant

__all__ = [
    "BOUNDARIES",
    "BoolArray",
    "Boundary",
    "Check",
    "Declaration",
    "Effect",
    "Evaluate",
    "FloatArray",
    "IntArray",
    "LiftModel",
    "Parameter",
    "Prior",
    "Source",
    "compose",
    "keywords",
    "normal",
    "null",
    "uniform",
    "variant",
]
