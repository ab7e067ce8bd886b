"""A model's curve over distance, and the 90 % band that the covariance of its fit implies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from nearlift import derivative
from nearlift.declare import Boundary, FloatArray, LiftModel
from nearlift.likelihood import student
from nearlift.likelihood.problem import lift_ratio
from nearlift.report.evidence import Evidence, lift_inf_N, where
from nearlift.results import Observations
from nearlift.results.fit import ModelFit, ParameterCovariance
from nearlift.stages.fit import POSTERIOR

#: Two curves that part by less than this much of what the data span are one line in a figure.
VISIBLE = 0.01


def ratio(model: LiftModel, z_hat: FloatArray, arguments: Mapping[str, object]) -> FloatArray:
    """L / L_inf at `z_hat`; nan outside the model's range and where it has no value."""
    low, high = model.valid_z_hat
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        value = np.broadcast_to(np.asarray(model(z_hat, **arguments), dtype=float), z_hat.shape)
    defined = (z_hat > low) & (z_hat <= high) & np.isfinite(value) & (value > 0)
    return np.where(defined, value, np.nan)


def uncertainty(
    model: LiftModel,
    z_hat: FloatArray,
    arguments: Mapping[str, object],
    values: Mapping[str, float],
    among: ParameterCovariance,
) -> FloatArray:
    """Standard uncertainty of L / L_inf at `z_hat` from the covariance of the fitted parameters, to
    first order; nan where that has no end.
    """
    names = among.names
    covariance = np.array(among.values, dtype=float).reshape(len(names), len(names))
    covariance[~np.isfinite(covariance)] = np.nan
    centre = {**arguments, **{n: values[n] for n in names}}
    low, high = np.array([model.parameter(name).bounds for name in names]).reshape(-1, 2).T
    at = np.array([values[name] for name in names])
    size = np.maximum(np.abs(at), 1e-3 * np.minimum(high - low, 1.0))

    def ratios(points: FloatArray) -> FloatArray:
        each = (dict(zip(names, points[i], strict=True)) for i in np.ndindex(*points.shape[:-1]))
        values = [ratio(model, z_hat, {**centre, **x}) for x in each]
        return np.array(values).reshape(*points.shape[:-1], len(z_hat))

    change, apart = derivative.central(ratios, at, size, low, high)
    jacobian = change / apart[:, None]
    variance = np.einsum("iz,ij,jz->z", jacobian, covariance, jacobian)
    result: FloatArray = np.sqrt(np.maximum(variance, 0.0))
    return result


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """L / L_inf - 1 of a model over recorded distance, arrays of shape (n,).

    Attributes
    ----------
    middle, low, high : array
        The curve and its 90 % band; nan where the intervals of the coefficients have no end.
    least_squares : array
        The base fit's curve where it is another one.
    """

    middle: FloatArray
    low: FloatArray
    high: FloatArray
    least_squares: FloatArray

    def parts(self, span: float) -> bool:
        """Whether least squares differs visibly from `middle` where the data span so much."""
        apart = np.nanmax(np.abs(self.least_squares - self.middle), initial=0.0)
        return bool(apart > VISIBLE * span)


def posterior_quantiles(
    evidence: Evidence,
    boundary: Boundary,
    model: LiftModel,
    z_hat: FloatArray,
    known: Mapping[str, object],
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """The 5, 50 and 95 % quantiles of L / L_inf - 1 at each `z_hat` over the posterior's draws;
    None where there are none.
    """
    if not evidence.has(POSTERIOR):
        return None
    draws = where(evidence.table(POSTERIOR), boundary=boundary, model=model.name)
    each = {p.name: where(draws, parameter=p.name)["value"][:, None] for p in model.parameters}
    if not each or not all(len(x) for x in each.values()):
        return None
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        value = np.asarray(model(z_hat, **known, **each), dtype=float) - 1
    medians = {n: float(np.median(x)) for n, x in each.items()}
    inside = np.isfinite(ratio(model, z_hat, {**known, **medians}))
    finite = np.where(np.isfinite(value) & inside, value, 0.0)
    quantiles = np.quantile(finite, [0.05, 0.5, 0.95], axis=0)
    low, middle, high = np.where(inside, quantiles, np.nan)
    return low, middle, high


def base_curve(evidence: Evidence, boundary: Boundary, z_hat: FloatArray) -> Curve:
    """The base fit at recorded distances, with its height error.

    It is the pointwise median and 90 % of the posterior, or least squares with the band of its
    covariance. Do not write to its arrays: figures, charts and words ask for the same curve, which
    is made once.
    """
    asked = boundary, z_hat.tobytes()
    if asked not in evidence.curves:
        evidence.curves[asked] = _base_curve(evidence, boundary, z_hat)
    return evidence.curves[asked]


def _base_curve(evidence: Evidence, boundary: Boundary, z_hat: FloatArray) -> Curve:
    model, fit = evidence.base(boundary)
    known = evidence.known(boundary, model)
    z_hat = z_hat + height_found_m(fit) / evidence.observations[boundary].radius_m
    plain = ratio(model, z_hat, {**known, **fit.values}) - 1
    drawn = posterior_quantiles(evidence, boundary, model, z_hat, known)
    if drawn is None:
        reach = quantile90(fit) * uncertainty(model, z_hat, known, fit.values, fit.covariance)
        drawn = plain - reach, plain, plain + reach
    low, middle, high = drawn
    if endless(fit):
        low = high = np.full_like(middle, np.nan)
    return Curve(middle=middle, low=low, high=high, least_squares=plain)


def endless(fit: ModelFit) -> bool:
    """Whether a determined coefficient's 90 % interval has no end, because no repeats tell what the
    trials of a visit share.
    """
    return any(math.isfinite(e.u) and math.isinf(e.lo90) for e in fit.parameters.values())


def height_found_m(fit: ModelFit) -> float:
    """Height error of a fit, m, to add to every recorded distance; 0 where it found none."""
    return fit.height_error.value if fit.height_error else 0.0


def log_residual(model: LiftModel, fit: ModelFit, data: Observations) -> FloatArray:
    """Log lift less the model's at the corrected distances (n,), of trials in the model's range."""
    z_hat = data.z_hat + height_found_m(fit) / data.radius_m
    log_ratio = np.log(lift_ratio(model, replace(data, z_hat=z_hat), fit.values))
    result: FloatArray = np.log(data.lift_N) - log_ratio - np.log(lift_inf_N(fit, data))
    return result


def quantile90(fit: ModelFit) -> float:
    """How many standard uncertainties the fit's own 90 % intervals reach to either side."""
    for e in fit.parameters.values():
        if 0 < e.u < math.inf and math.isfinite(e.hi90):
            return (e.hi90 - e.value) / e.u
    return student.NORMAL_90
