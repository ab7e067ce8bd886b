"""Structure without a name, carried as a random discrepancy: what it may do to the coefficients.

Where no declared effect may take the credit, what is left is no noise either, and an interval that
knows of noise alone holds the coefficient half as often as it says. Random effects stand for it:
every family of curves along a covariate in which structure was found, curves of distance that
change with time where the order of the trials is known, and coefficients that differ by throttle.
Each has independent sizes of one variance s^2, by moments: with W its columns, whitened and freed
of L_inf and coefficients, and r the whitened residual, ``E |W'r|^2 = |W|^2 + s^2 |W'W|^2``
(Frobenius norms). A variance that comes out negative is nothing. Families overlap, and each is
sized as if alone, which errs on the wide side.
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.families import MOVING, families, indicators, moving, times
from nearlift.loop.search_problem import SearchProblem
from nearlift.loop.structure import Structure
from nearlift.nomenclature import SCHEDULE_WORDS


def columns(stage: SearchProblem, flagged: list[str]) -> FloatArray:
    """The discrepancy as columns (n, t) of log lift with unknowns of unit variance; `flagged` are
    the covariates in which structure was found.
    """
    data = stage.data
    carried = [
        f.columns
        for f in families(data)
        if f.name != MOVING and SCHEDULE_WORDS.get(f.covariate, f.covariate) in flagged
    ]
    if data.ordered:
        carried.append(moving(data).columns)
    shapes = [*carried, _by_throttle(stage)]
    return np.hstack([np.zeros((stage.data.n, 0)), *(_sized(stage, columns) for columns in shapes)])


def covariates(structure: Structure) -> list[str]:
    """The covariates along which something is significant, the most significant first."""
    return [
        covariate
        for covariate, log10_p in structure.by_covariate().items()
        if log10_p < structure.threshold
    ]


def _by_throttle(stage: SearchProblem) -> FloatArray:
    """Coefficients of its own for every throttle: what bends one throttle's curve moves the
    coefficient that all share.
    """
    return times(stage.candidate().jacobian(stage.theta), indicators(stage.data.throttle))


def _sized(stage: SearchProblem, family: FloatArray) -> FloatArray:
    """A family's columns times the standard deviation of its coefficients; without columns where
    that is nothing.
    """
    jacobian = orthonormal(stage.base_fit.jacobian)
    white = stage.space.project(family.T).T
    variance = _variance(white - jacobian @ (jacobian.T @ white), stage.base_fit.residual)
    return family * np.sqrt(variance) if variance > 0 else family[:, :0]


def _variance(white: FloatArray, residual: FloatArray) -> float:
    """Variance of a family's coefficients by moments, from its freed columns (n, k) and the
    residual (n,), both whitened; may be negative.
    """
    product = white.T @ white
    energy = float(np.sum(product**2))
    return (
        (float(np.sum((white.T @ residual) ** 2)) - float(np.trace(product))) / energy
        if energy > 0
        else 0.0
    )
