"""A fit's entry in fit.json: estimates, profiles, and what would halve each uncertainty."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict

from nearlift.fit import inputs, remedies
from nearlift.fit.closeness import NEAR_GROUND
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.fit.profiles import Profile
from nearlift.likelihood.level_curve import held_out_rms
from nearlift.results.fit import (
    CoefficientEstimate,
    ExcludedTrial,
    HeightError,
    ModelFit,
    ParameterCovariance,
)
from nearlift.results.levels import LevelFit

#: Degrees of freedom below which an uncertainty is flagged.
FEW_DOF = 5.0


def summary(fit: LeastSquaresFit, profiles: Iterable[Profile]) -> ModelFit:
    """One model's entry, without its posterior."""
    ground = fit.problem.data.boundary == "ground"
    near = float("nan") if fit.r2_near is None else fit.r2_near
    return ModelFit(
        model=fit.model.name,
        title=fit.model.title,
        parameters={
            name: CoefficientEstimate(**asdict(e), dof=float(dof), warning=_warning(float(dof)))
            for (name, e), dof in zip(fit.estimates.items(), fit.effective, strict=True)
        },
        covariance=ParameterCovariance.named(fit.names, fit.covariance),
        chi2=fit.chi2,
        dof=fit.dof,
        n_trials=fit.n,
        rmse=fit.rmse,
        r2=fit.r2,
        r2_near=near if ground else None,
        r2_near_range=NEAR_GROUND if ground else None,
        log_likelihood=fit.log_likelihood,
        aic=fit.aic,
        bic=fit.bic,
        L_inf_N=fit.levels,
        levels=_levels(fit),
        degeneracies=fit.degeneracies,
        excluded=tuple(ExcludedTrial(trial=t, reason=why) for t, why in fit.excluded),
        profiles={p.parameter: p.ends for p in profiles},
        would_halve=remedies.halvings(fit),
        undeclared=inputs.undeclared(fit),
        heights=fit.plan.measures,
        height_error=(HeightError(*fit.marginal.offset()) if fit.marginal else None),
    )


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
