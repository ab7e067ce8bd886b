"""The likelihood of one model at one boundary.

Forces are measured, ratios are not: the unit is the trial, ``log lift = a[throttle] + log
ratio(z_hat; theta) + error``. The levels a = log L_inf are nuisances, one per throttle, or a curve
of throttle and supply. They are linear, so they are eliminated in closed form and never divided by.
In the logarithm a gain error is additive, and one covariance serves all throttles. Trials scatter
by a percent or less, so the difference to a likelihood in force is of second order in that percent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift import derivative
from nearlift.declare import FloatArray, LiftModel
from nearlift.errors import InputRefused, NotConverged
from nearlift.likelihood.covariance import Covariance
from nearlift.likelihood.subspace import SPANNED
from nearlift.results import Observations

#: Numbers that are whitened at once. Ours: each step makes a copy, of 8 MB at this size.
BLOCK = 1_000_000


def where_finite(linear: Callable[[FloatArray], FloatArray], x: FloatArray) -> FloatArray:
    """`linear` of `x` row by row, (..., n) to (..., m); nan throughout where a row holds inf or
    nan.

    BLAS kernels differ in their results for inf and nan, so such rows never reach them.
    """
    whole = np.isfinite(x).all(axis=-1, keepdims=True)
    if whole.all():
        return linear(x)
    return np.where(whole, linear(np.where(whole, x, 0.0)), np.nan)


@dataclass(frozen=True, kw_only=True)
class Likelihood:
    """A model, the trials, and the covariance of the trials' errors.

    Parameter vectors are shape (p,) or (m, p); predictions (n,) or (m, n).
    """

    model: LiftModel
    data: Observations
    covariance: Covariance
    #: Added to every recorded distance, m.
    offset_m: float = 0.0
    #: Added to the log ratio whatever the parameters, a number or (n,).
    shift: FloatArray | float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """The free parameters, in the order of every vector here."""
        return tuple(p.name for p in self.model.parameters)

    @cached_property
    def known(self) -> dict[str, object]:
        """Arguments of the model besides its parameters: geometry, and per-trial covariates."""
        return needed(self.model, self.data)

    @cached_property
    def z_hat(self) -> FloatArray:
        """Distance of each trial in rotor radii, (n,), the height error added; nan at the boundary
        and beyond.
        """
        z_hat = self.data.z_hat + self.offset_m / self.data.radius_m
        return np.where(z_hat > 0, z_hat, np.nan)

    def log_ratio(self, theta: FloatArray) -> FloatArray:
        """Log L / L_inf of each trial; not finite where the model has no value."""
        columns = {name: np.asarray(theta)[..., i, None] for i, name in enumerate(self.names)}
        with np.errstate(invalid="ignore", divide="ignore"):
            log = np.log(self.model.evaluate(self.z_hat, **columns, **self.known)) + self.shift
        return np.broadcast_to(log, (*np.shape(theta)[:-1], self.data.n))

    @cached_property
    def _levels(self) -> tuple[FloatArray, FloatArray]:
        """QR of the whitened columns that log L_inf is linear in: what eliminates it.

        Raises
        ------
        NotConverged
            A curve of L_inf has columns that these trials do not tell apart.
        """
        columns = self.data.level_design
        q, r = np.linalg.qr(self.covariance.whiten(columns.T).T)
        pivots = np.abs(np.diag(r))
        if self.data.curve is not None and pivots.min() < SPANNED * pivots.max():
            curve = self.data.curve
            raise NotConverged(
                "levels",
                f"these trials do not determine a curve of degree {curve.degree} in"
                f" {' and '.join(curve.of)}",
                "a lower degree, or fewer columns in [levels] of",
            )
        return q, r

    @property
    def levels_log_det(self) -> tuple[int, float]:
        """Number of levels, and log determinant of their information, left by integration."""
        _, r = self._levels
        return len(r), 2 * float(np.log(np.abs(np.diag(r))).sum())

    @property
    def d_shown_levels_d_lift(self) -> FloatArray:
        """Change of log L_inf of each throttle per unit change of each trial's log lift, theta
        held, (K, n).
        """
        q, r = self._levels
        gain = np.asarray(np.linalg.solve(r, self.covariance.unwhiten(q.T)), dtype=np.float64)
        return self.data.shown(gain)

    def project(self, x: FloatArray) -> FloatArray:
        """Whiten along the last axis and remove what a free L_inf per throttle absorbs; a row with
        a value that is not finite is nan.
        """
        q, _ = self._levels

        def projected(x: FloatArray) -> FloatArray:
            white = self.covariance.whiten(x)
            white -= (white @ q) @ q.T
            return white

        if x.ndim != 2 or x.size <= BLOCK:
            return where_finite(projected, x)
        result, rows = np.empty(x.shape), max(BLOCK // self.data.n, 1)
        for i in range(0, len(x), rows):
            result[i : i + rows] = where_finite(projected, x[i : i + rows])
        return result

    def unproject(self, x: FloatArray) -> FloatArray:
        """Apply the transpose of `project` along the last axis."""
        q, _ = self._levels
        return self.covariance.unwhiten(x - (x @ q) @ q.T)

    @cached_property
    def _target(self) -> FloatArray:
        return self.project(np.log(self.data.lift_N))

    def residuals(self, theta: FloatArray) -> FloatArray:
        """Whitened residuals with L_inf eliminated; their sum of squares is chi2."""
        return self.left(self.log_ratio(theta))

    def left(self, log_ratio: FloatArray) -> FloatArray:
        """Whitened residuals for a log ratio of each trial, (..., n)."""
        return self._target - self.project(log_ratio)

    def chi2(self, theta: FloatArray) -> FloatArray:
        """Sum of squared whitened residuals; inf where the model has no value."""
        r = self.residuals(theta)
        total = np.einsum("...i,...i->...", r, r)
        return np.where(np.isfinite(total), total, np.inf)

    def log_likelihood(self, theta: FloatArray) -> FloatArray:
        """Log likelihood, L_inf at its best value given theta."""
        constant = (
            self.covariance.log_det
            + self.data.n * np.log(2 * np.pi)
            + 2 * np.log(self.data.lift_N).sum()
        )
        result: FloatArray = -0.5 * (self.chi2(theta) + constant)
        return result

    def shown_covariance(self, covariance: FloatArray) -> FloatArray:
        """Covariance of log L_inf at each shown throttle, from that of the coefficients of
        `level_design`.
        """
        return self.data.shown(self.data.shown(covariance).T)

    @property
    def level_covariance(self) -> FloatArray:
        """Covariance of what multiplies the trials' `level_design`, theta held, (K, K)."""
        _, r = self._levels
        inverse = np.linalg.inv(r)
        return np.asarray(inverse @ inverse.T, dtype=np.float64)

    def best_levels(self, x: FloatArray) -> FloatArray:
        """Least-squares coefficients of `level_design` for rows of trials (..., n), (..., K).

        They are the level per throttle, or a curve's coefficients; nan where a row has a value that
        is not finite.
        """
        q, r = self._levels
        return where_finite(
            lambda x: np.asarray(
                np.linalg.solve(r, q.T @ self.covariance.whiten(x).T).T, dtype=np.float64
            ),
            x,
        )

    def derivatives(self, theta: FloatArray) -> FloatArray:
        """Derivatives of `residuals` with respect to each parameter, (..., p, n)."""
        return -self.project(self.slopes(theta))

    def jacobian(self, theta: FloatArray) -> FloatArray:
        """D log ratio / d theta at one theta, shape (n, p)."""
        result: FloatArray = self.slopes(np.asarray(theta, dtype=float)).T
        return result

    def slopes(self, theta: FloatArray) -> FloatArray:
        """D log ratio / d theta, (..., p, n), by central differences within the bounds."""
        low, high = self.model.bounds
        size = np.maximum(np.maximum(np.abs(theta), 1e-2 * (high - low)), 1e-6)
        change, apart = derivative.central(self.log_ratio, theta, size, low, high)
        return np.asarray(change / apart[..., None], dtype=np.float64)

    def height_slope(self, theta: FloatArray) -> FloatArray:
        """D log ratio / d z at one theta, per metre, shape (n,); 0 in free air."""
        named = self.model.named(np.asarray(theta))
        return height_slope(self.model, self.data, named, self.offset_m)


def need(data: Observations, name: str, model: str) -> Any:
    """Geometry or covariate `name` of the trials, or a refusal that says what to record."""
    known = {
        **data.covariates,
        "radius_m": data.radius_m,
        "throttle": data.throttle,
        "session": data.session,
        "z_hat": data.z_hat,
        **data.geometry,
    }
    if name in known:
        return known[name]
    raise InputRefused(
        f"model {model}",
        f"needs {name}, which this campaign does not know",
        "add it to [vehicle] or to the schedule, or choose another model",
    )


def needed(model: LiftModel, data: Observations) -> dict[str, Any]:
    """All that the model needs of the trials besides its parameters, or a refusal."""
    return {name: need(data, name, model.name) for name in model.needs}


def lift_ratio(model: LiftModel, data: Observations, parameters: Mapping[str, float]) -> FloatArray:
    """L / L_inf of each trial at given parameter values, (n,)."""
    values = model.evaluate(data.z_hat, **parameters, **needed(model, data))
    ratio = np.asarray(values, dtype=float)
    return np.broadcast_to(ratio, (data.n,))


def height_slope(
    model: LiftModel, data: Observations, parameters: dict[str, float], offset_m: float = 0.0
) -> FloatArray:
    """D log ratio / d z of each trial, per metre, at given parameter values and every distance
    moved by `offset_m`.
    """
    known, z_hat = needed(model, data), data.z_hat + offset_m / data.radius_m
    return slope_with_distance(
        lambda z: np.log(model.evaluate(z, **parameters, **known)), z_hat, data.radius_m
    )


def slope_with_distance(
    log_ratio: Callable[[FloatArray], FloatArray], z_hat: FloatArray, radius_m: float
) -> FloatArray:
    """Slope of a log ratio, a function of z_hat (n,), with distance, 1/m, (n,); 0 in free air."""
    with np.errstate(invalid="ignore", divide="ignore"):
        slope = derivative.at_zero(lambda t: log_ratio(z_hat * (1 + t))) / z_hat / radius_m
    return np.nan_to_num(slope, posinf=0.0, neginf=0.0)


def usable(model: LiftModel, data: Observations) -> NDArray[np.bool_]:
    """Mask of the trials inside the model's `valid_z_hat` (lower end excluded), or in free air."""
    low, high = model.valid_z_hat
    return (data.z_hat > low) & ((data.z_hat <= high) | np.isinf(data.z_hat))
