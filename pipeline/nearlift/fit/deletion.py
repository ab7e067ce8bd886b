"""Deletion diagnostics of a generalised least-squares fit, for each trial or visit.

They are the prediction from all other trials, and the coefficients without it. No refit is needed
for a model that is linear near its optimum. P is the inverse covariance after projecting out
coefficients and L_inf. y is the log lift less the model's, and G the estimator, ``theta = G y``.
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
from nearlift.fit.information import joint_information
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.likelihood.problem import Likelihood
from nearlift.results import IntArray
from nearlift.results.fit import ModelScore

#: Fraction of its information that a block must keep, after projecting out L_inf and coefficients,
#: to be predictable from the rest: the square root of the floating-point precision, 1.5e-8.
MIN_INFORMATION = 1e-8


@dataclass(frozen=True, slots=True, kw_only=True)
class DeletionDiagnostics:
    """Effect of leaving out one trial or one visit, and its prediction from all others.

    Quantities that the others do not determine are nan, such as those of the only visit at some
    throttle. The shifts of a coefficient that is not free are nan too.

    Attributes
    ----------
    of_trial : (n, p)
        Change of each coefficient, in its unit.
    residual : (n,)
        Error of predicting the trial's log lift from all others, over its standard deviation.
    visit : (v,) int array
        Labels, ascending.
    of_visit : (v, p)
        As `of_trial`.
    count : (v,) int array
        Trials of the visit.
    chi2 : (v,)
        Squared Mahalanobis length of the error of predicting the visit from all others.
    log_density : (v,)
        Log predictive density of the visit's log lifts, jointly.
    squares : (v,)
        Sum of squared errors of the predicted log lifts.
    """

    of_trial: FloatArray
    residual: FloatArray
    visit: IntArray
    of_visit: FloatArray
    count: IntArray
    chi2: FloatArray
    log_density: FloatArray
    squares: FloatArray

    @property
    def predicted(self) -> NDArray[np.bool_]:
        """The visits that the others determine, (v,)."""
        return np.isfinite(self.log_density)


def influence(fit: LeastSquaresFit) -> DeletionDiagnostics:
    """Deletion diagnostics of a fit; its coefficients with a finite uncertainty that are not at a
    bound are free.
    """
    estimates = fit.estimates.values()
    free = [i for i, e in enumerate(estimates) if not e.at_bound and np.isfinite(e.u)]
    return influence_on(fit.problem, fit.theta, free)


def influence_on(
    problem: Likelihood, theta: FloatArray, free: Sequence[int]
) -> DeletionDiagnostics:
    """Deletion diagnostics of any likelihood at its optimum `theta` (p,), in closed form.

    Time and memory grow with the trials, not with their square. Shared unknowns are estimated from
    the other trials as far as those determine them.
    """
    data, covariance, p = problem.data, problem.covariance, len(theta)
    joint = joint_information(problem, problem.jacobian(theta)[:, list(free)])
    y = np.log(data.lift_N) - problem.log_ratio(theta)
    solved = covariance.solve_own(np.column_stack([joint.design, y]).T).T
    weighed, weighed_y = solved[:, :-1], solved[:, -1]
    rest = weighed_y - weighed @ (joint.covariance @ (weighed.T @ y))
    gains = np.zeros((data.n, p))
    gains[:, list(free)] = joint.gain.T
    of_trial, residual = np.full((data.n, p), np.nan), np.full(data.n, np.nan)
    visit, label = np.unique(data.visit, return_inverse=True)
    of_visit = np.full((len(visit), p), np.nan)
    chi2, log_density, squares = np.full((3, len(visit)), np.nan)
    # P_BB, (P y)_B and G_B of all visits B of one size at once
    for index, precision in covariance.precision_blocks():
        whole = np.linalg.eigvalsh(precision).max(axis=1)
        columns, error, gain = weighed[index], rest[index], gains[index].swapaxes(-1, -2)
        information = precision - columns @ joint.covariance @ columns.swapaxes(-1, -2)
        diagonal = np.diagonal(information, axis1=1, axis2=2)
        safe = np.where(diagonal > MIN_INFORMATION * whole[:, None], diagonal, np.nan)
        residual[index] = error / np.sqrt(safe)
        of_trial[index] = -(gain * (error / safe)[:, None]).swapaxes(-1, -2)
        value, vector = np.linalg.eigh(information)
        value = np.where((value.min(axis=1) > MIN_INFORMATION * whole)[:, None], value, np.nan)
        turned = np.einsum("mij,mi->mj", vector, error)
        predicted = np.einsum("mij,mj->mi", vector, turned / value)
        constant = np.log(value).sum(axis=1) - index.shape[1] * np.log(2 * np.pi)
        v = label[index[:, 0]]
        of_visit[v] = -np.einsum("mpi,mi->mp", gain, predicted)
        chi2[v] = (turned**2 / value).sum(axis=1)
        log_density[v] = 0.5 * (constant - chi2[v])
        squares[v] = (predicted**2).sum(axis=1)
    fixed = [i for i in range(p) if i not in free]
    of_trial[:, fixed] = of_visit[:, fixed] = np.nan
    return DeletionDiagnostics(
        of_trial=of_trial,
        residual=residual,
        visit=visit,
        of_visit=of_visit,
        count=np.bincount(label),
        chi2=chi2,
        log_density=log_density,
        squares=squares,
    )


def score(held: DeletionDiagnostics, reference: DeletionDiagnostics) -> ModelScore:
    """Predictive scores of a model relative to a reference, over visits in which both predict the
    same trials.

    Shared unknowns are estimated from the other visits as far as those determine them. A model is
    therefore not scored on the errors alone.
    """
    _, rows, other = np.intersect1d(
        held.visit, reference.visit, assume_unique=True, return_indices=True
    )
    same = (
        held.predicted[rows]
        & reference.predicted[other]
        & (held.count[rows] == reference.count[other])
    )
    rows, other = rows[same], other[same]
    v = len(rows)
    excess = held.log_density[rows] - reference.log_density[other]
    n, a, b = held.count[rows], held.squares[rows], reference.squares[other]
    rmse, reference_rmse = (_rmse(squares.sum(), n.sum()) for squares in (a, b))
    without = [_rmse(squares.sum() - squares, n.sum() - n) for squares in (a, b)]
    apart = without[0] - without[1]
    spread = np.sqrt((v - 1) / v * ((apart - apart.mean()) ** 2).sum()) if v > 1 else np.nan
    return ModelScore(
        visits=v,
        skipped=int((~held.predicted).sum()),
        elpd=float(held.log_density[rows].sum()),
        d_elpd=float(excess.sum()),
        u_d_elpd=float(np.sqrt(v) * excess.std(ddof=1)) if v > 1 else float("nan"),
        rmse=float(rmse) if v else float("nan"),
        d_rmse=float(rmse - reference_rmse) if v else float("nan"),
        u_d_rmse=float(spread),
    )


def _rmse(squares: Any, count: Any) -> Any:
    return np.sqrt(squares / np.maximum(count, 1))
