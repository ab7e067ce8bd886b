"""Joint fit of lift and downwash with common coefficients.

The likelihood of the trials is multiplied by that of measured downwash near the boundary over its
value far away, in the logarithm: ``log(V / V_control) = log downwash(z_hat; theta) + error``. All
cases share the control's error, so their errors are correlated. The model's `downwash` is the
inflow at the disk: give only cuts that represent it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nearlift.declare import FloatArray, LiftModel
from nearlift.errors import InputRefused
from nearlift.fit.least_squares import LeastSquaresFit, assemble, interval90, parameter_covariance
from nearlift.fit.minimum import minimise
from nearlift.likelihood import budget
from nearlift.likelihood.finite import where_finite
from nearlift.likelihood.problem import Problem, usable
from nearlift.results import Estimate, Observations


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
    """

    z_hat: FloatArray
    ratio: FloatArray
    u_own: FloatArray
    u_control: float

    def whitener(self) -> FloatArray:
        """W (n, n) with W C W' = 1 for the covariance C of the logarithms."""
        covariance = np.diag(self.u_own**2) + self.u_control**2
        return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)), dtype=np.float64)


@dataclass(frozen=True, kw_only=True)
class JointProblem(Problem):
    """A `Problem` with the residuals of the downwash appended."""

    downwash: DownwashRatio
    geometry: Mapping[str, object]

    @cached_property
    def _whitener(self) -> FloatArray:
        return self.downwash.whitener()

    def log_downwash(self, theta: FloatArray) -> FloatArray:
        """Log downwash over its value far away at the measured distances, (..., n)."""
        assert self.model.downwash is not None
        columns = {name: np.asarray(theta)[..., i, None] for i, name in enumerate(self.names)}
        known = {name: self.geometry[name] for name in self.model.needs}
        value = np.asarray(
            self.model.downwash(self.downwash.z_hat, **columns, **known), dtype=float
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            log: FloatArray = np.log(np.where(value > 0, value, np.nan))
        return np.broadcast_to(log, (*np.shape(theta)[:-1], len(self.downwash.z_hat)))

    def downwash_residuals(self, theta: FloatArray) -> FloatArray:
        """Whitened residuals of the downwash alone, (..., n)."""
        return where_finite(
            lambda x: x @ self._whitener.T, np.log(self.downwash.ratio) - self.log_downwash(theta)
        )

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


@dataclass(frozen=True, slots=True, kw_only=True)
class JointFit:
    """A model fitted to lift and downwash together.

    `chi2_lift` and `chi2_downwash` are their parts of chi2 at the common optimum. `p_value` is that
    of the rise of chi2 over its minimum for lift alone when the downwash is added: small where the
    two contradict each other.
    """

    model: LiftModel
    theta: FloatArray
    covariance: FloatArray
    estimates: dict[str, Estimate]
    chi2_lift: float
    chi2_downwash: float
    n_downwash: int
    p_value: float


def fit_joint(
    lift: LeastSquaresFit,
    data: Observations,
    downwash: DownwashRatio,
    parts: tuple[budget.Component, ...] = (),
) -> JointFit:
    """Fit the model of a lift fit again, to the same trials with the same noise, and to the
    downwash.

    Raises
    ------
    InputRefused
        The model declares no downwash or has no free parameter, needs what the geometry does not
        have, or there is no downwash.
    NotConverged
        The optimiser failed.
    """
    from scipy.stats import chi2

    model = lift.model
    if model.downwash is None or not model.parameters:
        lack = "declares no downwash" if model.downwash is None else "has no free coefficient"
        raise InputRefused(
            f"joint fit of {model.name}",
            lack,
            "choose another `base`, or leave downwash = true out",
        )
    lacking = [n for n in model.needs if n not in data.geometry]
    if lacking:
        raise InputRefused(
            f"joint fit of {model.name}",
            f"its downwash needs {', '.join(lacking)}",
            "add it to [vehicle]",
        )
    if not len(downwash.z_hat):
        raise InputRefused(
            f"joint fit of {model.name}",
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
        geometry=data.geometry,
    )
    theta = minimise(both, lift.theta)
    covariance, determined = parameter_covariance(both.derivatives(theta))
    sd = np.where(determined, np.sqrt(np.diag(covariance)), np.inf)
    r_downwash = both.downwash_residuals(theta)
    chi2_lift, chi2_downwash = float(alone.chi2(theta)), float(r_downwash @ r_downwash)
    rise = max(chi2_lift + chi2_downwash - float(alone.chi2(minimise(alone, lift.theta))), 0.0)
    return JointFit(
        model=model,
        theta=theta,
        covariance=covariance,
        estimates=interval90(model, theta, sd, lift.effective),
        chi2_lift=chi2_lift,
        chi2_downwash=chi2_downwash,
        n_downwash=len(r_downwash),
        p_value=float(chi2.sf(rise, len(r_downwash))),
    )
