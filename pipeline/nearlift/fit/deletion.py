"""Deletion diagnostics of a generalised least-squares fit, for each trial or visit.

They are the prediction from all other trials, and the coefficients without it. No refit is needed
for a model that is linear near its optimum. P is the inverse covariance after projecting out
coefficients and L_inf, y the log lift less the model's and G the estimator, ``theta = G y``.
Deleting block B moves the coefficients by ``-G_B (P_BB)^-1 (P y)_B``. The error of predicting B
from the rest is ``(P_BB)^-1 (P y)_B``, and its covariance ``(P_BB)^-1``. That is exact for a given
covariance: the scatter is held fixed. Source: Martin 1992, J. Am. Stat. Assoc. 87, 1033 (leverage,
influence and residuals in generalised least squares).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.likelihood.problem import Problem
from nearlift.results import IntArray

#: Fraction of its information that a block must keep, after projecting out L_inf and coefficients,
#: to be predictable from the rest: the square root of the floating-point precision, 1.5e-8.
DETERMINED = 1e-8


@dataclass(frozen=True, slots=True, kw_only=True)
class Deletion:
    """Deletion quantities of m visits of b trials each.

    Attributes
    ----------
    index : (m, b) int array
        Indices of the trials.
    information : (m, b, b)
        P_BB.
    weighed : (m, b)
        (P y)_B.
    gain : (m, p, b)
        Change of each coefficient per unit change of a trial's log lift; 0 for a coefficient at its
        bound or without finite uncertainty.
    whole : (m,)
        Largest eigenvalue of the visit's information before anything is projected out.
    """

    index: IntArray
    information: FloatArray
    weighed: FloatArray
    gain: FloatArray
    whole: FloatArray


def visits(fit: LeastSquaresFit) -> tuple[Deletion, ...]:
    """Deletion quantities of every visit of a fit, grouped by visit size.

    Time and memory grow with the trials, not with their square. Shared unknowns are estimated from
    the other visits as far as those determine them.
    """
    return visits_of(fit.problem, fit.theta, _free(fit))


def _free(fit: LeastSquaresFit) -> list[int]:
    """Indices of the coefficients with a finite uncertainty that are not at a bound."""
    return [i for i, e in enumerate(fit.estimates.values()) if not e.at_bound and np.isfinite(e.u)]


def visits_of(problem: Problem, theta: FloatArray, free: Sequence[int]) -> tuple[Deletion, ...]:
    """`visits` of any likelihood at its optimum `theta` (p,), the coefficients `free` estimated."""
    data, covariance = problem.data, problem.covariance
    jacobian = problem.jacobian(theta)[:, list(free)]
    length = np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300)
    known = covariance.shared
    z = np.hstack([known, data.level_columns, jacobian / length])
    y = np.log(data.lift_N) - problem.log_ratio(theta)
    size = z.shape[1]
    curved = np.diag(np.r_[np.ones(known.shape[1]), np.zeros(size - known.shape[1])])
    solved = covariance.solve_own(np.column_stack([z, y]).T).T
    weighed, weighed_y = solved[:, :-1], solved[:, -1]
    curved += z.T @ weighed
    inverse = np.linalg.pinv(curved, rcond=1e-13, hermitian=True)
    rest = weighed_y - weighed @ (inverse @ (weighed.T @ y))
    gains = np.zeros((data.n, len(theta)))
    gains[:, free] = weighed @ inverse[:, size - len(free) :] / length
    result = []
    for index, precision in covariance.precision_blocks():
        columns = weighed[index]
        result.append(
            Deletion(
                index=index,
                information=precision - columns @ inverse @ columns.swapaxes(-1, -2),
                weighed=rest[index],
                gain=gains[index].swapaxes(-1, -2),
                whole=np.linalg.eigvalsh(precision).max(axis=1),
            )
        )
    return tuple(result)


@dataclass(frozen=True, slots=True, kw_only=True)
class DeletionDiagnostics:
    """Change of each coefficient, in its unit, on leaving out one trial or one visit.

    Attributes
    ----------
    names : tuple of str
        The p coefficients.
    trial : (n,) object array of str
        Ids, as in the observations.
    of_trial : (n, p)
        nan where the trial is not predictable from the others, or for a coefficient that is not
        free.
    residual : (n,)
        Error of predicting the trial's log lift from all others, over its standard deviation; nan
        where not predictable.
    visit : (v,) int array
        Labels, ascending.
    of_visit : (v, p)
        As `of_trial`.
    chi2 : (v,)
        Squared Mahalanobis length of the error of predicting the visit from all others; nan where
        not predictable.
    """

    names: tuple[str, ...]
    trial: NDArray[Any]
    of_trial: FloatArray
    residual: FloatArray
    visit: IntArray
    of_visit: FloatArray
    chi2: FloatArray


def influence(fit: LeastSquaresFit) -> DeletionDiagnostics:
    """Deletion diagnostics of a fit in closed form, its scatter held fixed."""
    return influence_on(fit.problem, fit.theta, _free(fit))


def influence_on(problem: Problem, theta: FloatArray, free: Sequence[int]) -> DeletionDiagnostics:
    """`influence` on any likelihood at its optimum, as `visits_of`."""
    data, names, p = problem.data, problem.names, len(theta)
    fixed = [i for i in range(p) if i not in free]
    of_trial, residual = np.full((data.n, p), np.nan), np.full(data.n, np.nan)
    labels, shifts, squares = [], [], []
    for block in visits_of(problem, theta, free):
        diagonal = np.diagonal(block.information, axis1=1, axis2=2)
        determined = diagonal > DETERMINED * block.whole[:, None]
        safe = np.where(determined, diagonal, np.nan)
        residual[block.index] = block.weighed / np.sqrt(safe)
        of_trial[block.index] = -(block.gain * (block.weighed / safe)[:, None]).swapaxes(-1, -2)
        value, vector = np.linalg.eigh(block.information)
        determined = value.min(axis=1) > DETERMINED * block.whole
        turned = np.einsum("mij,mi->mj", vector, block.weighed)
        value = np.where(determined[:, None], value, np.nan)
        shifts.append(-np.einsum("mpi,mij,mj->mp", block.gain, vector, turned / value))
        squares.append((turned**2 / value).sum(axis=1))
        labels.append(data.visit[block.index[:, 0]])
    order = np.argsort(np.concatenate(labels), kind="stable")
    of_visit = np.concatenate(shifts)[order]
    of_trial[:, fixed] = of_visit[:, fixed] = np.nan
    return DeletionDiagnostics(
        names=names,
        trial=data.trial,
        of_trial=of_trial,
        residual=residual,
        visit=np.concatenate(labels)[order],
        of_visit=of_visit,
        chi2=np.concatenate(squares)[order],
    )
