"""Joint fit of lift and downwash with common coefficients.

The likelihood of the trials is multiplied by that of measured downwash near the boundary over its
value far away, in the logarithm: ``log(V / V_control) = log downwash(z_hat; theta) + error``. All
cases share the control's error, so their errors are correlated. The model's `downwash` is the
inflow at the disk: give only cuts that represent it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.fit.least_squares import LeastSquaresFit, assemble, interval90, parameter_covariance
from nearlift.fit.minimum import minimise
from nearlift.likelihood import budget
from nearlift.likelihood.finite import where_finite
from nearlift.likelihood.problem import Problem, usable
from nearlift.results import Observations
from nearlift.results.fit import ParameterCovariance
from nearlift.results.joint import BoundaryJointFit, LeftOutCase


@dataclass(frozen=True, slots=True, kw_only=True)
class DownwashRatio:
    """Measured downwash of some cases over that of one control.

    Attributes
    ----------
    z_hat : (n,)
    ratio : (n,)
        Downwash over the control's; positive.
    u_own : (n,)
        Relative standard uncertainty of each case's own downwash.
    u_control : float
        Relative standard uncertainty of the control's, common to all.
    used, left_out : tuple
        The cases, and those that take no part.
    """

    z_hat: FloatArray
    ratio: FloatArray
    u_own: FloatArray
    u_control: float
    used: tuple[str, ...] = ()
    left_out: tuple[LeftOutCase, ...] = ()

    def whitener(self) -> FloatArray:
        """W (n, n) with W C W' = 1 for the covariance C of the logarithms."""
        covariance = np.diag(self.u_own**2) + self.u_control**2
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class JointProblem(Problem):
    """A `Problem` with the residuals of the downwash appended."""

    downwash: DownwashRatio

    @cached_property
    def _whitener(self) -> FloatArray:
        return self.downwash.whitener()

    def downwash_residuals(self, theta: FloatArray) -> FloatArray:
        """Whitened residuals of the downwash alone, (..., n)."""
        assert self.model.downwash is not None
        z_hat, measured = self.downwash.z_hat, np.log(self.downwash.ratio)
        columns = {name: np.asarray(theta)[..., i, None] for i, name in enumerate(self.names)}
        value = np.asarray(self.model.downwash(z_hat, **columns, **self.known), dtype=float)
        with np.errstate(invalid="ignore", divide="ignore"):
            log: FloatArray = np.log(np.where(value > 0, value, np.nan))
        modelled = np.broadcast_to(log, (*np.shape(theta)[:-1], len(z_hat)))
        return where_finite(lambda x: x @ self._whitener.T, measured - modelled)

    def residuals(self, theta: FloatArray, offset_m: FloatArray | float = 0.0) -> FloatArray:
        """Whitened residuals of lift, then of downwash; `offset_m` moves the former only."""
        return np.concatenate(
            [super().residuals(theta, offset_m), self.downwash_residuals(theta)], axis=-1
        )

    def derivatives(self, theta: FloatArray, offset_m: FloatArray | float = 0.0) -> FloatArray:
        """Derivatives of `residuals` with respect to each parameter, (..., p, n)."""
        return np.concatenate(
            [super().derivatives(theta, offset_m), self._downwash_derivatives(theta)], axis=-1
        )

    def _downwash_derivatives(self, theta: FloatArray) -> FloatArray:
        """Derivatives of `downwash_residuals` by central differences within the bounds."""
        rows = []
        for i, p in enumerate(self.model.parameters):
            step = 1e-4 * np.maximum(np.abs(theta[..., i]), 1e-2 * (p.bounds[1] - p.bounds[0]))
            up, down = theta.copy(), theta.copy()
            up[..., i], down[..., i] = (
                np.minimum(theta[..., i] + step, p.bounds[1]),
                np.maximum(theta[..., i] - step, p.bounds[0]),
            )
            width = (up[..., i] - down[..., i])[..., None]
            rows.append((self.downwash_residuals(up) - self.downwash_residuals(down)) / width)
        return np.stack(rows, axis=-2)


def fit_joint(
    lift: LeastSquaresFit,
    data: Observations,
    downwash: DownwashRatio,
    parts: tuple[budget.Component, ...] = (),
) -> BoundaryJointFit:
    """Fit the model of a lift fit again, to the same trials with the same noise, and to the
    downwash.

    The parts of chi2 are those at the common optimum; `p_value` is that of the rise of chi2 over
    its minimum for lift alone when the downwash is added.

    Raises
    ------
    InputRefused
        The model declares no downwash or has no free parameter, needs what the geometry does not
        have, or there is no downwash.
    NotConverged
        The optimiser failed.
    """
    from scipy.stats import chi2

    model, where = lift.model, f"joint fit of {lift.model.name}"
    if model.downwash is None or not model.parameters:
        lack = "declares no downwash" if model.downwash is None else "has no free coefficient"
        raise InputRefused(where, lack, "choose another `base`, or leave downwash = true out")
    lacking = [n for n in model.needs if n not in data.geometry]
    if lacking:
        needs = f"its downwash needs {', '.join(lacking)}"
        raise InputRefused(where, needs, "add it to [vehicle]")
    if not len(downwash.z_hat):
        raise InputRefused(
            where,
            "no case of [piv] stands for the inflow at the disk",
            "measure farther from the boundary",
        )
    kept = data.take(usable(model, data))
    alone = assemble(model, kept, parts, lift.noise, lift.theta)
    both = JointProblem(
        model=model,
        data=kept,
        covariance=alone.covariance,
        downwash=downwash,
    )
    theta = minimise(both, lift.theta)
    covariance, determined = parameter_covariance(both.derivatives(theta))
    sd = np.where(determined, np.sqrt(np.diag(covariance)), np.inf)
    r_downwash = both.downwash_residuals(theta)
    chi2_lift, chi2_downwash = float(alone.chi2(theta)), float(r_downwash @ r_downwash)
    rise = max(chi2_lift + chi2_downwash - float(alone.chi2(minimise(alone, lift.theta))), 0.0)
    return BoundaryJointFit(
        model=model.name,
        title=model.title,
        parameters=interval90(model, theta, sd, lift.effective),
        lift_alone=lift.estimates,
        covariance=ParameterCovariance.named(lift.names, covariance),
        chi2_lift=chi2_lift,
        chi2_downwash=chi2_downwash,
        n_downwash=len(r_downwash),
        p_value=float(chi2.sf(rise, len(r_downwash))),
        used=downwash.used,
        left_out=downwash.left_out,
    )
