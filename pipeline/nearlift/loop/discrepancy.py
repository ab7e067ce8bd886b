"""Model discrepancy: unexplained structure as random effects in the coefficients' uncertainty.

Residual structure is not noise: intervals with noise alone cover a coefficient half as often as
they state. The random effects are every family along a covariate in which structure was found, and
coefficients that differ by throttle. Where the order of the trials is known, curves of distance
that change with time are added.

The coefficients of a family share one variance s^2, by the method of moments, ``E |W'r|^2 = |W|^2 +
s^2 |W'W|^2`` (Frobenius norms). W are its whitened columns with L_inf and model coefficients
projected out, r is the whitened residual. A family of few directions shows its variance poorly: its
standard error, ``s^2 (2 |W'W|^2)^(1/2) / |W|^2``, is added. A negative estimate counts as zero.
Families overlap, and each is sized as if alone.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.families import MOVING, families, indicators, moving, times
from nearlift.loop.search_problem import SearchProblem
from nearlift.loop.structure import Structure


def columns(problem: SearchProblem, flagged: Collection[str]) -> FloatArray:
    """Discrepancy columns (n, t) of log lift with unit-variance unknowns; `flagged` are the
    covariates in which structure was found.
    """
    data = problem.data
    carried = [f.columns for f in families(data) if f.name != MOVING and f.covariate in flagged]
    if data.ordered:
        carried.append(moving(data).columns)
    # a curve bent at one throttle moves the coefficients that all share
    by_throttle = times(problem.candidate().jacobian(problem.start), indicators(data.throttle))
    return np.hstack([_sized(problem, shape) for shape in (*carried, by_throttle)])


def covariates(structure: Structure) -> list[str]:
    """Covariates with significant structure, the most significant first."""
    return [
        covariate
        for covariate, (log10_p, _) in structure.foremost().items()
        if log10_p < structure.threshold
    ]


def _sized(problem: SearchProblem, family: FloatArray) -> FloatArray:
    """A family's columns times the standard deviation of its coefficients; none where it is 0."""
    jacobian = orthonormal(problem.base_fit.jacobian)
    white = problem.space.project(family.T).T
    variance, error = _variance(white - jacobian @ (jacobian.T @ white), problem.base_fit.residual)
    return family * np.sqrt(variance + error) if variance > 0 else family[:, :0]


def _variance(white: FloatArray, residual: FloatArray) -> tuple[float, float]:
    """Variance by moments, from whitened columns (n, k) and residual (n,), and its standard error;
    the variance may be negative.
    """
    product = white.T @ white
    energy, trace = float(np.sum(product**2)), float(np.trace(product))
    if energy == 0:
        return 0.0, 0.0
    variance = (float(np.sum((white.T @ residual) ** 2)) - trace) / energy
    return variance, variance * float(np.sqrt(2 * energy)) / trace
