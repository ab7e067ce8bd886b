"""Lift over L_inf near a boundary: the curve that is quoted with its 90 % band, and its cells.

An effect that depends on distance alone, such as a height offset or a stagnation zone, belongs to
the vehicle and its place. It is drawn in the curve, and the cells are as measured. An effect along
anything else, such as supply voltage or time, belongs to the rig. A curve over distance cannot show
it, so each trial is corrected for it. Both follow from the residual of the whole model: a trial
deviates from the curve by what that model leaves.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nearlift import catalogue, derivative
from nearlift.declare import Boundary, FloatArray, LiftModel, compose
from nearlift.likelihood import student
from nearlift.likelihood.problem import lift_ratio
from nearlift.report.evidence import Evidence, lift_inf_N
from nearlift.results import Observations
from nearlift.results.fit import ModelFit, ParameterCovariance
from nearlift.stages.diagnose import LOOP_RESIDUALS
from nearlift.stages.fit import POSTERIOR


@dataclass(frozen=True, slots=True)
class Curve:
    """L / L_inf - 1 of a model over recorded distance with its 90 % band, arrays of shape (n,).

    The band is nan where the intervals of the coefficients have no end. `least_squares` is the base
    fit's curve where it is another one.
    """

    middle: FloatArray
    low: FloatArray
    high: FloatArray
    least_squares: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class QuotedModel:
    """The quoted model as a curve over distance.

    Attributes
    ----------
    model, values : LiftModel, mapping
        The base model with the effects of the vehicle; everything that it takes besides distance.
    in_curve, in_points : tuple of str
        Effects that the curve has, and those that the points are corrected for.
    covariance : ParameterCovariance or None
        Of the model's parameters by the most probable explanation, where it has effects.
    is_base : bool
        Whether the curve is the base fit's own.
    """

    model: LiftModel
    values: Mapping[str, Any]
    in_curve: tuple[str, ...]
    in_points: tuple[str, ...]
    covariance: ParameterCovariance | None
    is_base: bool

    @property
    def effects(self) -> tuple[str, ...]:
        """All effects of the quoted model that are dealt with."""
        return self.in_curve + self.in_points


@dataclass(frozen=True, slots=True, kw_only=True)
class RelativeLift:
    """Cells of one boundary, arrays of shape (n,), in the order of throttle and distance.

    `u` is the standard uncertainty of `delta_L` from the scatter of trials, visits and heights,
    without that of L_inf, which a throttle's cells share. `u_L_inf` is the largest of the latter
    from the same scatter, as a fraction.
    """

    throttle: FloatArray
    z_hat: FloatArray
    delta_L: FloatArray
    u: FloatArray
    u_L_inf: float


def ratio(model: LiftModel, z_hat: FloatArray, arguments: Mapping[str, Any]) -> FloatArray:
    """L / L_inf at `z_hat` (..., n) for arguments (..., 1); nan outside the model's range and where
    it has no value.
    """
    low, high = model.valid_z_hat
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        value = np.asarray(model(z_hat, **arguments), dtype=float)
    defined = (z_hat > low) & (z_hat <= high) & np.isfinite(value) & (value > 0)
    return np.where(defined, value, np.nan)


def slopes(
    model: LiftModel, z_hat: FloatArray, values: Mapping[str, Any], names: Sequence[str]
) -> FloatArray:
    """Change of L / L_inf per unit of each of these parameters (k, n)."""
    at = np.array([values[name] for name in names], dtype=float)
    low, high = np.array([model.parameter(name).bounds for name in names]).reshape(-1, 2).T
    size = np.maximum(np.abs(at), 1e-3 * np.minimum(high - low, 1.0))

    def ratios(points: FloatArray) -> FloatArray:
        moved = dict(zip(names, np.moveaxis(points, -1, 0)[..., None], strict=True))
        return ratio(model, z_hat, {**values, **moved})

    change, apart = derivative.central(ratios, at, size, low, high)
    return change / apart[:, None]


def uncertainty(
    model: LiftModel, z_hat: FloatArray, values: Mapping[str, Any], among: ParameterCovariance
) -> FloatArray:
    """Standard uncertainty of L / L_inf at `z_hat` from the covariance of the fitted parameters, to
    first order; nan where that has no end.
    """
    k = len(among.names)
    covariance = np.array(among.values, dtype=float).reshape(k, k)
    covariance[~np.isfinite(covariance)] = np.nan
    jacobian = slopes(model, z_hat, values, among.names)
    variance = np.einsum("iz,ij,jz->z", jacobian, covariance, jacobian)
    result: FloatArray = np.sqrt(np.maximum(variance, 0.0))
    return result


def height_found_m(fit: ModelFit) -> float:
    """Height error of a fit, m, to add to every recorded distance; 0 where it found none."""
    return fit.height_error.value if fit.height_error else 0.0


def log_residual(model: LiftModel, fit: ModelFit, data: Observations) -> FloatArray:
    """Log lift less the model's at the corrected distances (n,), of trials in the model's range."""
    z_hat = data.z_hat + height_found_m(fit) / data.radius_m
    log_ratio = np.log(lift_ratio(model, replace(data, z_hat=z_hat), fit.values))
    result: FloatArray = np.log(data.lift_N) - log_ratio - np.log(lift_inf_N(fit, data))
    return result


def has_open_interval(fit: ModelFit) -> bool:
    """Whether a determined coefficient's 90 % interval has no end, because no repeats
    determine the error that trials of a visit share.
    """
    return any(math.isfinite(e.u) and math.isinf(e.lo90) for e in fit.parameters.values())


# the base fit


def base_curve(evidence: Evidence, boundary: Boundary, z_hat: FloatArray) -> Curve:
    """The base fit at recorded distances, with its height error.

    It is the pointwise median and 90 % of the posterior, or least squares with the band of its
    covariance.
    """
    model, fit = evidence.base(boundary)
    known = evidence.known(boundary, model)
    z_hat = z_hat + height_found_m(fit) / evidence.observations[boundary].radius_m
    values = {**known, **fit.values}
    plain = ratio(model, z_hat, values) - 1
    # cells of several throttles share their distances
    places, index = np.unique(z_hat, return_inverse=True)
    drawn = posterior_quantiles(evidence, boundary, model, places, known)
    if drawn is None:
        # as many standard uncertainties as the fit's own intervals reach
        known_ends = [e for e in fit.parameters.values() if 0 < e.u < math.inf > e.hi90]
        quantile = next(((e.hi90 - e.value) / e.u for e in known_ends), student.NORMAL_90)
        reach = quantile * uncertainty(model, z_hat, values, fit.covariance)
        low, middle, high = plain - reach, plain, plain + reach
    else:
        low, middle, high = (each[index] for each in drawn)
    if has_open_interval(fit):
        low = high = np.full_like(middle, np.nan)
    return Curve(middle, low, high, plain)


def posterior_quantiles(
    evidence: Evidence,
    boundary: Boundary,
    model: LiftModel,
    z_hat: FloatArray,
    known: Mapping[str, Any],
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """The 5, 50 and 95 % quantiles of L / L_inf - 1 at each `z_hat` over the posterior's draws;
    None where there are none.
    """
    draws = _draws(evidence, boundary, model)
    if not draws:
        return None
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        value = np.asarray(model(z_hat, **known, **draws), dtype=float) - 1
    medians = {n: float(np.median(x)) for n, x in draws.items()}
    inside = np.isfinite(ratio(model, z_hat, {**known, **medians}))
    finite = np.where(np.isfinite(value) & inside, value, 0.0)
    low, middle, high = np.where(inside, np.quantile(finite, [0.05, 0.5, 0.95], axis=0), np.nan)
    return low, middle, high


@functools.lru_cache(maxsize=3)
def _draws(evidence: Evidence, boundary: Boundary, model: LiftModel) -> dict[str, FloatArray]:
    """Draws of each parameter of a model (m, 1); empty where it was not sampled."""
    if not evidence.has(POSTERIOR):
        return {}
    long = evidence.frame(POSTERIOR, boundary=boundary, model=model.name)
    by_name = dict([*long.groupby("parameter")["value"]])
    return {p.name: by_name[p.name].to_numpy()[:, None] for p in model.parameters if by_name}


# what is quoted


@functools.lru_cache(maxsize=3)
def quoted_model(evidence: Evidence, boundary: Boundary) -> QuotedModel:
    """The model whose curve belongs to the cells."""
    base, fit = evidence.base(boundary)
    quoted, data = evidence.quoted(boundary), evidence.observations[boundary]
    diagnosis = evidence.diagnosed(boundary)
    accepted = diagnosis.accepted if diagnosis and evidence.has(LOOP_RESIDUALS) else None
    effects = [catalogue.effect(n, quoted.form(n)) for n in (accepted.effects if accepted else ())]
    of_distance = {"z_hat", "radius_m", *evidence.campaign.geometry()}
    parts = [
        e
        for e in effects
        if e.acts_on != "force"
        and {*e.needs} <= of_distance
        and all(p.per != "session" for p in e.parameters)
    ]
    in_curve = tuple(e.name for e in parts)
    if accepted and "offset_m" in accepted.parameters and "height_offset" not in accepted.effects:
        # the zero error of the distance: the curve is over recorded distance
        parts.insert(0, catalogue.effect("height_offset"))
    model = compose(base, *parts) if parts else base
    # quoted values are means over rival explanations, and together may draw none of them
    estimates = accepted.parameters if accepted else quoted.coefficients
    known = evidence.campaign.geometry() | {"radius_m": data.radius_m}
    known |= evidence.known(boundary, base) | {**fit.values}
    known |= {n: e.value for n, e in estimates.items()}
    free = [p.name for p in model.parameters]
    return QuotedModel(
        model=model,
        values={n: v for n, v in known.items() if n in {*model.needs, *free}},
        in_curve=in_curve,
        in_points=tuple(e.name for e in effects if e.name not in in_curve),
        covariance=accepted.covariance.among(free) if accepted else None,
        is_base=quoted.verdict != "unexplained" and not effects,
    )


def line(evidence: Evidence, boundary: Boundary, z_hat: FloatArray) -> Curve:
    """The quoted model's L / L_inf - 1 at recorded distances, without the effects that the cells
    are corrected for.

    Its 90 % band is that of the quoted coefficients. Where it has an effect, these allow for rivals
    that draw other curves; the band is then the most probable explanation's.
    """
    drawn, quoted = quoted_model(evidence, boundary), evidence.quoted(boundary)
    if drawn.is_base:
        return base_curve(evidence, boundary, z_hat)
    middle = least_squares = ratio(drawn.model, z_hat, drawn.values) - 1
    correlation = quoted.correlation
    free = [n for n in correlation.parameters if n in quoted.coefficients]
    if not drawn.effects:
        least_squares = base_curve(evidence, boundary, z_hat).least_squares
        if len(free) == 1:
            # one coefficient moves the whole curve: the band is its interval, however uneven
            c = quoted.coefficients[free[0]]
            at = {**drawn.values, free[0]: np.array([[c.lo90], [c.hi90]])}
            ends = ratio(drawn.model, z_hat, at) - 1
            return Curve(middle, np.minimum(*ends), np.maximum(*ends), least_squares)
    covariance = drawn.covariance
    u = np.array([quoted.coefficients[n].u for n in free])
    if not covariance and free and np.isfinite(u).all():
        rows = [correlation.parameters.index(n) for n in free]
        among = np.outer(u, u) * np.array(correlation.values)[np.ix_(rows, rows)]
        covariance = ParameterCovariance.named(free, among)
    reach = np.full_like(middle, np.nan)
    if covariance:
        spread = uncertainty(drawn.model, z_hat, drawn.values, covariance)
        reach = student.NORMAL_90 * spread
    return Curve(middle, middle - reach, middle + reach, least_squares)


@functools.lru_cache(maxsize=3)
def relative_lift(evidence: Evidence, boundary: Boundary) -> RelativeLift:
    """Every cell's lift over the L_inf of the model that is drawn."""
    drawn, data = quoted_model(evidence, boundary), evidence.observations[boundary]
    data = data.take((data.z_hat > 0) & np.isfinite(data.z_hat) & (data.lift_N > 0))

    def middle(z_hat: FloatArray) -> FloatArray:
        if drawn.is_base:
            return base_curve(evidence, boundary, z_hat).middle
        return ratio(drawn.model, z_hat, drawn.values) - 1

    diagnosed = evidence.diagnosed(boundary) if drawn.effects else None
    if diagnosed:
        left = evidence.frame(LOOP_RESIDUALS, boundary=boundary).set_index("trial")["after"]
        # nan for trials that were not diagnosed
        log_ratio = np.log1p(middle(data.z_hat)) + left.reindex(data.trial).to_numpy(dtype=float)
    else:
        level = lift_inf_N(evidence.base(boundary)[1], data, drawn=True)
        log_ratio = np.log(data.lift_N / level)
    noise = diagnosed.noise if diagnosed else evidence.fits.noise[boundary]
    keep = np.isfinite(log_ratio)
    data, log_ratio = data.take(keep), log_ratio[keep]
    both = np.stack([data.levels[data.level], data.z_hat])
    (throttle, z_hat), index = np.unique(both, axis=1, return_inverse=True)
    index = index.ravel()
    n = np.bincount(index).astype(float)
    of_trial = (
        (data.u_lift_N / data.lift_N) ** 2 + noise.relative**2 + (noise.force_N / data.lift_N) ** 2
    )
    along = derivative.at_zero(lambda t: np.log1p(middle(z_hat * (1 + t))))
    slope = np.nan_to_num(along / z_hat)
    visits = np.bincount(np.unique(np.stack([index, data.visit]), axis=1)[0], minlength=len(n))
    shared = ((slope * noise.height_m / data.radius_m) ** 2 + noise.common**2) / visits
    variance = np.bincount(index, of_trial) / n**2 + shared
    cell_ratio = np.exp(np.bincount(index, log_ratio) / n)
    # u(log L_inf) of each throttle, by least squares over cells for these and the coefficients
    levels, level_of = np.unique(throttle, return_inverse=True)
    names = [p.name for p in drawn.model.parameters]
    of_coefficients = slopes(drawn.model, z_hat, drawn.values, names)
    of_coefficients /= ratio(drawn.model, z_hat, drawn.values)
    columns = np.vstack([np.eye(len(levels))[level_of].T, np.nan_to_num(of_coefficients)])
    weighted = (columns / np.sqrt(variance)).T
    scale = np.sqrt((weighted**2).sum(axis=0))
    scale[scale == 0] = 1.0
    inverse = np.linalg.pinv((weighted / scale).T @ (weighted / scale))
    u = np.sqrt(np.diagonal(inverse)) / scale
    return RelativeLift(
        throttle=throttle,
        z_hat=z_hat,
        delta_L=cell_ratio - 1,
        u=cell_ratio * np.sqrt(variance),
        u_L_inf=float(u[: len(levels)].max(initial=0.0)),
    )
