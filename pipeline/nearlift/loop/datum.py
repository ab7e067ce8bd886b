"""Zero error of the distance, where its stated uncertainty is too large for the slope of the curve.

It is linearised about its most probable value instead of zero. With an error e, most probable value
m, and f the log ratio, ``f(z + e) = f(z + m) + (e - m) f'(z + m)``. So trials count at z + m, their
log lift greater by ``m f'``, and e has its stated distribution.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.fit import height_error
from nearlift.fit.least_squares import LeastSquaresFit, fit
from nearlift.likelihood.budget import Component, shared
from nearlift.loop.candidate_fit import Fitted
from nearlift.results import Observations

#: Change of the likeliest error, in declared standard uncertainties, that first order carries.
NEAR = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Datum:
    """Trials as `recorded`, the stated zero errors beyond the linear range, and their most probable
    value within its limits.
    """

    recorded: Observations
    parts: tuple[Component, ...] = ()
    limits_m: tuple[float, float] = (0.0, 0.0)
    error_m: float = 0.0

    @property
    def data(self) -> Observations:
        """The trials at their likeliest heights, and those before them; with lift as recorded."""
        recorded, moved = self.recorded, self.error_m / self.recorded.radius_m
        covariates = dict(recorded.covariates)
        if "previous_z_hat" in covariates:
            # 0 where no trial came before
            before = covariates["previous_z_hat"]
            covariates["previous_z_hat"] = np.where(before > 0, before + moved, before)
        return replace(recorded, z_hat=recorded.z_hat + moved, covariates=covariates)

    def lift_N(self, slope: FloatArray) -> FloatArray:
        """Lift (n,) that goes with them; `slope` (n,) is that of the log ratio there, per m."""
        return self.recorded.lift_N * np.exp(self.error_m * slope)

    def at(self, error_m: float) -> Datum:
        """Copy with another most probable error, clipped to its bounds."""
        return replace(self, error_m=float(np.clip(error_m, *self.limits_m)))

    def likeliest(self, fitted: Fitted, slope: FloatArray) -> Datum:
        """The datum as a fit to these heights has it, or this one, where that is near."""
        columns = shared(fitted.candidate.data, self.parts, slope)
        errors = fitted.space.project(columns.T) @ fitted.residual
        moved = self.at(float(errors @ [part.standard for part in self.parts]))
        near = abs(moved.error_m - self.error_m) <= NEAR * height_error.standard_m(self.parts)
        return self if near else moved

    def take(self, keep: NDArray[np.bool_]) -> Datum:
        """Copy with the trials that a mask selects."""
        return replace(self, recorded=self.recorded.take(keep))


def datum(first: LeastSquaresFit, data: Observations) -> Datum:
    """The datum of the trials of a first fit, which leaves it to the slope."""
    error_m = fit(first.model, data, first.parts, first.noise).problem.offset_m
    if not error_m:
        return Datum(recorded=data)
    parts = height_error.common(first.parts, data)
    limits = height_error.limits_m(first.model, data, height_error.standard_m(parts))
    return Datum(recorded=data, parts=parts, limits_m=limits, error_m=error_m)
