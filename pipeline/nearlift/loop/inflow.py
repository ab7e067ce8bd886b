"""Evidence of measured downwash (PIV) for an explanation of lift.

An effect declares whether it changes the inflow at the disk (`Effect.inflow`). Lift predicts the
downwash of each explanation, with an uncertainty; a measured downwash is more or less probable.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift import derivative
from nearlift.declare import FloatArray
from nearlift.likelihood.problem import need
from nearlift.loop.candidate_fit import Fitted
from nearlift.results.diagnosis import FORM_SD

#: Prior probability that the cuts are not the inflow at the disk. Their downwash is then uniform
#: over a range of one control's downwash, which bounds the evidence.
NOT_THE_INFLOW = 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredDownwash:
    """Downwash at the disk at one distance over its value far away, with standard uncertainty."""

    z_hat: float
    ratio: float
    u: float


def predicted(fitted: Fitted, vector: FloatArray, z_hat: FloatArray) -> FloatArray:
    """Downwash over its value far away, (..., m), of a fitted model that has one, at vectors
    (..., P).
    """
    candidate = fitted.candidate
    model = candidate.model
    assert model.downwash is not None
    # an effect on the inflow has the same size in all trials, and needs no more than geometry
    known = {
        name: need(candidate.data, name, model.name)
        for name in model.needs
        if name in candidate.base.needs or name == "radius_m"
    }
    values = {s.parameter.name: vector[..., s.start, None] for s in candidate.slots}
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.asarray(model.downwash(z_hat, **known, **values), dtype=float)
    return np.broadcast_to(ratio, (*vector.shape[:-1], len(z_hat)))


def log_density(measured: tuple[MeasuredDownwash, ...], fitted: Fitted) -> float:
    """Log density of the measured downwash given the trials' lift and an explanation of it.

    The prediction is linear about the fit. It is uncertain by the covariance of the fit, and in
    common by `FORM_SD` of the predicted change. The density is 0 for a model without a downwash.
    """
    from scipy.stats import multivariate_normal

    if not measured or fitted.candidate.model.downwash is None:
        return 0.0
    z_hat, ratio, u = np.array([(m.z_hat, m.ratio, m.u) for m in measured]).T
    covariance, (low, high) = fitted.covariance, fitted.candidate.bounds
    mean = predicted(fitted, fitted.vector, z_hat)
    change, apart = derivative.central(
        lambda vector: predicted(fitted, vector, z_hat),
        fitted.vector,
        1e3 * np.sqrt(np.diag(covariance)),
        low,
        high,
    )
    columns = (change / np.where(apart > 0, apart, 1.0)[:, None]).T
    form = FORM_SD * (1 - mean)
    spread = columns @ covariance @ columns.T + np.outer(form, form) + np.diag(u**2)
    if not (np.isfinite(mean).all() and np.isfinite(spread).all()):
        return float(np.log(NOT_THE_INFLOW))
    at_disk = multivariate_normal.logpdf(ratio, mean, spread, allow_singular=True)
    return float(np.logaddexp(np.log1p(-NOT_THE_INFLOW) + at_disk, np.log(NOT_THE_INFLOW)))
