"""A fit's entry in fit.json: estimates, goodness of fit, profiles, and what would halve each
uncertainty.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import height_error, information, inputs
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.fit.profiles import Profile
from nearlift.likelihood import noise
from nearlift.likelihood.level_curve import held_out_rms
from nearlift.results import Estimate, IntArray
from nearlift.results.fit import LevelFit, ModelFit, ParameterCovariance

#: Degrees of freedom below which an uncertainty is flagged. Ours: u is then known to 30 %.
FEW_DOF = 5.0
#: Range of z_hat, ends excluded, of the trials in `r2_near`. It is that of
#: Carter, Bouchard and Quinn 2021.
NEAR_GROUND = (1.0, 3.0)


def summary(fit: LeastSquaresFit, profiles: Iterable[Profile]) -> ModelFit:
    """One model's entry, without its posterior."""
    data = fit.problem.data
    unknown = len(fit.theta) + data.unknown_levels
    rmse, r2, r2_near = closeness(fit)
    return ModelFit(
        title=fit.model.title,
        parameters={
            name: replace(e, dof=float(dof), warning=_warning(float(dof)))
            for (name, e), dof in zip(fit.estimates.items(), fit.effective, strict=True)
        },
        covariance=ParameterCovariance.named(fit.names, fit.covariance),
        chi2=fit.chi2,
        dof=fit.dof,
        n_trials=data.n,
        rmse=rmse,
        r2=r2,
        r2_near=r2_near,
        r2_near_range=None if r2_near is None else NEAR_GROUND,
        log_likelihood=fit.log_likelihood,
        aic=2 * unknown - 2 * fit.log_likelihood,
        bic=unknown * float(np.log(data.n)) - 2 * fit.log_likelihood,
        L_inf_N=fit.levels,
        levels=_levels(fit),
        degeneracies=information.degeneracies(fit),
        excluded=fit.excluded,
        profiles={p.parameter: p.ends for p in profiles},
        would_halve=information.halvings(fit),
        undeclared=inputs.undeclared(
            fit.problem,
            fit.theta,
            fit.gain,
            fit.parts,
            fit.slope,
        ),
        height_error=_height_error(fit),
    )


def _height_error(fit: LeastSquaresFit) -> Estimate | None:
    """Height error where the fit is linearised about one."""
    if not fit.problem.offset_m:
        return None
    standard = height_error.standard_m(height_error.common(fit.parts, fit.problem.data))
    u = height_error.u_m(fit.problem, fit.theta, fit.slope, standard)
    return Estimate(value=fit.problem.offset_m, u=u, unit="m")


def closeness(fit: LeastSquaresFit) -> tuple[float, float, float | None]:
    """Root mean square of residuals of log lift over trials; R² of cell means of Delta L.

    At the ground also R² of the cells in `NEAR_GROUND`, nan where these are too few.
    """
    data = fit.problem.data
    log_ratio = replace(fit.problem, shift=0.0).log_ratio(fit.theta)
    log_lift = np.log(data.lift_N) - data.of_trials(fit.level_coefficients)
    measured, predicted, cell = np.exp(log_lift) - 1, np.exp(log_ratio) - 1, noise.cells(data)
    near = (data.z_hat > NEAR_GROUND[0]) & (data.z_hat < NEAR_GROUND[1])
    rmse = float(np.sqrt(np.mean((log_lift - log_ratio) ** 2)))
    close = None
    if data.boundary == "ground":
        close = _r2(measured[near], predicted[near], cell[near]) if near.any() else float("nan")
    return rmse, _r2(measured, predicted, cell), close


def _r2(measured: FloatArray, predicted: FloatArray, cell: IntArray) -> float:
    """Coefficient of determination of cell means, as papers quote it."""
    _, label = np.unique(cell, return_inverse=True)
    count = np.bincount(label)
    means, model = np.bincount(label, measured) / count, np.bincount(label, predicted) / count
    total = float(((means - means.mean()) ** 2).sum())
    return 1.0 - float(((means - model) ** 2).sum()) / total if total > 0 else float("nan")


def _levels(fit: LeastSquaresFit) -> LevelFit | None:
    """The fitted curve of L_inf; None where L_inf is free per throttle."""
    data = fit.problem.data
    if data.curve is None:
        return None
    return LevelFit(
        curve=data.curve,
        coefficients=tuple(fit.level_coefficients.tolist()),
        covariance=tuple(tuple(row) for row in fit.level_covariance.tolist()),
        held_out=held_out_rms(data),
    )


def _warning(dof: float) -> str | None:
    """Warning for a coefficient whose uncertainty is itself hardly known."""
    if dof >= FEW_DOF:
        return None
    return (
        f"the uncertainty itself is known with {dof:.1f} degrees of freedom only: measure more"
        " visits"
    )
