"""Goodness of fit: root mean square of the residuals, and R² of cell means."""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood import noise
from nearlift.likelihood.problem import Problem
from nearlift.results import IntArray

#: Range of z_hat, ends excluded, of the trials in `r2_near`.
NEAR_GROUND = (1.0, 3.0)


def closeness(
    problem: Problem, theta: FloatArray, coefficients: FloatArray, offset_m: float = 0.0
) -> tuple[float, float, float | None]:
    """`rmse`, `r2`, and near the ground `r2_near`, of a fit with heights shifted by `offset_m`."""
    data = problem.data
    log_ratio = problem.log_ratio(theta, offset_m)
    log_lift = np.log(data.lift_N) - data.of_trials(coefficients)
    measured, predicted, cell = np.exp(log_lift) - 1, np.exp(log_ratio) - 1, noise.cells(data)
    near = (data.z_hat > NEAR_GROUND[0]) & (data.z_hat < NEAR_GROUND[1])
    rmse = float(np.sqrt(np.mean((log_lift - log_ratio) ** 2)))
    close = (
        _r2(measured[near], predicted[near], cell[near])
        if data.boundary == "ground" and near.any()
        else None
    )
    return rmse, _r2(measured, predicted, cell), close


def _r2(measured: FloatArray, predicted: FloatArray, cell: IntArray) -> float:
    """Coefficient of determination of cell means, as papers quote it."""
    _, label = np.unique(cell, return_inverse=True)
    count = np.bincount(label)
    means, model = np.bincount(label, measured) / count, np.bincount(label, predicted) / count
    total = float(((means - means.mean()) ** 2).sum())
    return 1.0 - float(((means - model) ** 2).sum()) / total if total > 0 else float("nan")
