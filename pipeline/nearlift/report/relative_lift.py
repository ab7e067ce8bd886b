"""Lift over the fitted L_inf, cell by cell, with the curve of the model that is quoted.

An effect that depends on distance alone, such as a height offset or a stagnation zone, belongs to
the vehicle and its place: it is drawn in the curve, and the cells are as measured. An effect along
anything else, such as supply voltage or time, belongs to the rig: a curve over distance cannot show
it, so each trial is corrected for it. Both follow from the residual of the whole model: a trial
deviates from the curve by what that model leaves.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nearlift import catalogue, derivative
from nearlift.declare import Boundary, Effect, FloatArray, LiftModel, compose
from nearlift.likelihood import student
from nearlift.report import curves
from nearlift.report.evidence import Evidence, lift_inf_N, where
from nearlift.results import Observations
from nearlift.results.fit import ParameterCovariance
from nearlift.results.quotation import BoundaryResult
from nearlift.stages.diagnose import LOOP_RESIDUALS


@dataclass(frozen=True, slots=True, kw_only=True)
class RelativeLift:
    """Cells of one boundary, arrays of shape (n,), in the order of throttle and distance.

    Attributes
    ----------
    throttle, z_hat, delta_L : array
    u : array
        Standard uncertainty of `delta_L` from the scatter of trials, visits and heights, without
        that of L_inf, which a throttle's cells share.
    u_L_inf : float
        The largest standard uncertainty of a throttle's L_inf, as a fraction of it, from the same
        scatter.
    """

    throttle: FloatArray
    z_hat: FloatArray
    delta_L: FloatArray
    u: FloatArray
    u_L_inf: float


@dataclass(frozen=True, slots=True, kw_only=True)
class QuotedModel:
    """The quoted model as a curve over distance.

    Attributes
    ----------
    model : LiftModel
        The base model with the effects of the vehicle.
    values : mapping
        Everything that it takes besides distance.
    in_curve, in_points : tuple of str
        Effects that the curve has, and those that the points are corrected for.
    covariance : ParameterCovariance or None
        Of the model's parameters by the most probable explanation, where it has effects.
    """

    model: LiftModel
    values: Mapping[str, Any]
    in_curve: tuple[str, ...]
    in_points: tuple[str, ...]
    covariance: ParameterCovariance | None = None

    @property
    def effects(self) -> tuple[str, ...]:
        """All effects of the quoted model that are dealt with."""
        return self.in_curve + self.in_points


def quoted_model(evidence: Evidence, boundary: Boundary) -> QuotedModel:
    """The model whose curve belongs to the cells."""
    base, fit = evidence.base(boundary)
    quoted, data = evidence.quoted(boundary), evidence.observations[boundary]
    diagnosed = evidence.diagnosed(boundary)
    accepted = diagnosed.accepted if diagnosed and evidence.has(LOOP_RESIDUALS) else None
    known = {"radius_m": data.radius_m} | evidence.known(boundary, base)
    of_distance = {"z_hat", "radius_m", *evidence.campaign.geometry()}
    parts: list[Effect] = []
    if accepted and "offset_m" in accepted.parameters and "height_offset" not in accepted.effects:
        # the zero error of the distance: the curve is over recorded distance
        parts.append(catalogue.effect("height_offset"))
    in_curve: list[str] = []
    for name in accepted.effects if accepted else ():
        effect = catalogue.effect(name)
        drawable = effect.acts_on != "force" and {*effect.needs} <= of_distance
        if drawable and all(p.per != "session" for p in effect.parameters):
            parts.append(effect)
            in_curve.append(name)
    model = compose(base, *parts) if parts else base
    # quoted values are means over rival explanations, and together may draw none of them
    estimates = accepted.parameters if accepted else quoted.coefficients
    best = {n: e.value for n, e in estimates.items()}
    values = {**evidence.campaign.geometry(), **known, **fit.values, **best}
    free = [p.name for p in model.parameters]
    asked = {*model.needs, *free}
    return QuotedModel(
        model=model,
        values={n: v for n, v in values.items() if n in asked},
        in_curve=tuple(in_curve),
        in_points=tuple(n for n in accepted.effects if n not in in_curve) if accepted else (),
        covariance=accepted.covariance.among(free) if accepted else None,
    )


def _near(evidence: Evidence, boundary: Boundary) -> Observations:
    """Accepted trials at a finite distance from the boundary."""
    data = evidence.observations[boundary]
    return data.take((data.z_hat > 0) & np.isfinite(data.z_hat) & (data.lift_N > 0))


def _residual_after(evidence: Evidence, boundary: Boundary, data: Observations) -> FloatArray:
    """Log lift less the accepted model's (n,); nan for trials that were not diagnosed."""
    table = where(evidence.table(LOOP_RESIDUALS), boundary=boundary)
    left = dict(zip(table["trial"].tolist(), table["after"].tolist(), strict=True))
    return np.array([left.get(t, np.nan) for t in data.trial.tolist()], dtype=float)


def is_base_fit(evidence: Evidence, boundary: Boundary) -> bool:
    """Whether the curve is the base fit's own."""
    return _is_base(evidence, boundary, quoted_model(evidence, boundary))


def _is_base(evidence: Evidence, boundary: Boundary, drawn: QuotedModel) -> bool:
    return evidence.quoted(boundary).verdict != "unexplained" and not drawn.effects


def line(evidence: Evidence, boundary: Boundary, z_hat: FloatArray) -> curves.Curve:
    """The curve that belongs to the cells: the quoted model's L / L_inf - 1 at recorded distances,
    without the effects that the cells are corrected for.

    Its 90 % band is that of the quoted coefficients. Where it has an effect, these allow for rivals
    that draw other curves; the band is then the most probable explanation's.
    """
    drawn = quoted_model(evidence, boundary)
    if _is_base(evidence, boundary, drawn):
        return curves.base_curve(evidence, boundary, z_hat)
    middle = _middle(evidence, boundary, drawn, z_hat)
    plain = middle
    if not drawn.effects:
        plain = curves.base_curve(evidence, boundary, z_hat).least_squares
    quoted = evidence.quoted(boundary)
    free = [n for n in quoted.correlation.parameters if n in quoted.coefficients]
    spread = np.full_like(middle, np.nan)
    if len(free) == 1 and not drawn.effects:
        # one coefficient moves the whole curve: the band is its interval, however uneven
        c = quoted.coefficients[free[0]]
        ends = ({**drawn.values, free[0]: x} for x in (c.lo90, c.hi90))
        one, other = (curves.ratio(drawn.model, z_hat, values) - 1 for values in ends)
        low, high = np.minimum(one, other), np.maximum(one, other)
        return curves.Curve(middle=middle, low=low, high=high, least_squares=plain)
    covariance = drawn.covariance or _quoted_covariance(quoted, free)
    if covariance is not None:
        values = drawn.values
        spread = curves.uncertainty(drawn.model, z_hat, values, values, covariance)
    reach = student.NORMAL_90 * spread
    return curves.Curve(middle=middle, low=middle - reach, high=middle + reach, least_squares=plain)


def _middle(
    evidence: Evidence, boundary: Boundary, drawn: QuotedModel, z_hat: FloatArray
) -> FloatArray:
    """The curve without its band."""
    if _is_base(evidence, boundary, drawn):
        return curves.base_curve(evidence, boundary, z_hat).middle
    return curves.ratio(drawn.model, z_hat, drawn.values) - 1


def _quoted_covariance(quoted: BoundaryResult, free: list[str]) -> ParameterCovariance | None:
    """Covariance of these quoted coefficients; None where one has no end."""
    rows = [quoted.correlation.parameters.index(n) for n in free]
    u = np.array([quoted.coefficients[n].u for n in free])
    if not free or not np.isfinite(u).all():
        return None
    correlation = np.array(quoted.correlation.values)[np.ix_(rows, rows)]
    return ParameterCovariance.named(free, np.outer(u, u) * correlation)


def relative_lift(evidence: Evidence, boundary: Boundary) -> RelativeLift:
    """Every cell's lift over the L_inf of the model that is drawn."""
    drawn, data = quoted_model(evidence, boundary), _near(evidence, boundary)
    if drawn.effects:
        residual = _residual_after(evidence, boundary, data)
        log_ratio = np.log1p(_middle(evidence, boundary, drawn, data.z_hat)) + residual
        diagnosed = evidence.diagnosed(boundary)
    else:
        level = lift_inf_N(evidence.base(boundary)[1], data, drawn=True)
        log_ratio, diagnosed = np.log(data.lift_N / level), None
    noise = diagnosed.noise if diagnosed else evidence.fits.noise[boundary]
    keep = np.isfinite(log_ratio)
    data, log_ratio = data.take(keep), log_ratio[keep]
    both = np.stack([data.levels[data.level], data.z_hat])
    cell, index = np.unique(both, axis=1, return_inverse=True)
    index = index.ravel()
    n = np.bincount(index).astype(float)
    of_trial = (
        (data.u_lift_N / data.lift_N) ** 2 + noise.relative**2 + (noise.force_N / data.lift_N) ** 2
    )
    along = derivative.at_zero(
        lambda t: np.log1p(_middle(evidence, boundary, drawn, cell[1] * (1 + t)))
    )
    slope = np.nan_to_num(along / cell[1])
    visits = np.bincount(np.unique(np.stack([index, data.visit]), axis=1)[0], minlength=len(n))
    shared = ((slope * noise.height_m / data.radius_m) ** 2 + noise.common**2) / visits
    variance = np.bincount(index, of_trial) / n**2 + shared
    ratio = np.exp(np.bincount(index, log_ratio) / n)
    return RelativeLift(
        throttle=cell[0],
        z_hat=cell[1],
        delta_L=ratio - 1,
        u=ratio * np.sqrt(variance),
        u_L_inf=_u_L_inf(drawn, cell[0], cell[1], variance),
    )


def _u_L_inf(
    drawn: QuotedModel, throttle: FloatArray, z_hat: FloatArray, variance: FloatArray
) -> float:
    """Largest standard uncertainty of a throttle's log L_inf, by least squares over the cells for
    these and the coefficients.
    """
    levels, level = np.unique(throttle, return_inverse=True)
    names = [p.name for p in drawn.model.parameters]
    at = np.array([drawn.values[name] for name in names])

    def log_ratio(points: FloatArray) -> FloatArray:
        each = (dict(zip(names, points[i], strict=True)) for i in np.ndindex(*points.shape[:-1]))
        values = [np.log(curves.ratio(drawn.model, z_hat, {**drawn.values, **x})) for x in each]
        return np.array(values).reshape(*points.shape[:-1], len(z_hat))

    # an offset is a few millimetres, in metres
    change, apart = derivative.central(log_ratio, at, np.maximum(np.abs(at), 1e-4))
    slopes = np.nan_to_num(change / apart[:, None])
    weighted = np.column_stack([np.eye(len(levels))[level], slopes.T]) / np.sqrt(variance)[:, None]
    scale = np.sqrt((weighted**2).sum(axis=0))
    scale[scale == 0] = 1.0
    inverse = np.linalg.pinv((weighted / scale).T @ (weighted / scale))
    u = np.sqrt(np.diagonal(inverse)) / scale
    return float(u[: len(levels)].max(initial=0.0))
