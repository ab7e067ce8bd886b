"""Lift over the fitted L_inf, cell by cell, with the line of the model that is quoted.

Where the loop named an effect, a trial deviates from the line by the residual that the whole model
leaves, which is its lift with the effect at that trial's covariates taken out: the points that
belong to a line of distance alone. Without one it is the lift itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from nearlift.declare import Boundary, FloatArray, LiftModel
from nearlift.likelihood import student
from nearlift.report import curves
from nearlift.report.evidence import Evidence, lift_inf_N, where
from nearlift.results.fit import ParameterCovariance
from nearlift.results.quotation import BoundaryResult
from nearlift.stages.diagnose import LOOP_RESIDUALS
from nearlift.stages.reduce import LIFT

#: Relative step of a distance by which a curve's slope is taken.
STEP = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class RelativeLift:
    """Cells of one boundary, arrays of shape (n,), in the order of throttle and distance.

    Attributes
    ----------
    throttle, z_hat, delta_L : array
    u : array
        Standard uncertainty of `delta_L` from the scatter of trials, visits and heights; that of
        L_inf, which a throttle's cells share, is not in it.
    u_L_inf : float
        The largest standard uncertainty of a throttle's L_inf, as a fraction of it, from the same
        scatter.
    """

    throttle: FloatArray
    z_hat: FloatArray
    delta_L: FloatArray
    u: FloatArray
    u_L_inf: float


def by_fit(evidence: Evidence) -> bool:
    """Whether cells are referred to the fitted L_inf, and not to the farthest station."""
    return evidence.campaign.report.reference == "fit"


def named(evidence: Evidence, boundary: Boundary) -> tuple[str, ...]:
    """The effects of the quoted model that are taken out of the cells: where these are referred to
    its L_inf, and where residuals exist.
    """
    taken_out = by_fit(evidence) and evidence.has(LOOP_RESIDUALS)
    return evidence.quoted(boundary).effects if taken_out else ()


def as_quoted(evidence: Evidence, boundary: Boundary) -> bool:
    """Whether the line is that of the quoted coefficients where these are not the base fit's."""
    unexplained = by_fit(evidence) and evidence.quoted(boundary).verdict == "unexplained"
    return unexplained or bool(named(evidence, boundary))


def line(evidence: Evidence, boundary: Boundary, z_hat: FloatArray) -> curves.Curve:
    """The line that belongs to the cells: the quoted model's L / L_inf - 1 over distance, its
    effects aside, and its 90 % band.
    """
    model, fit = evidence.base(boundary)
    quoted, known = evidence.quoted(boundary), evidence.known(boundary, model)
    if not as_quoted(evidence, boundary):
        return curves.band(evidence, boundary, z_hat)
    values = {**known, **fit.values, **{n: c.value for n, c in quoted.coefficients.items()}}
    middle = curves.ratio(model, z_hat, values) - 1
    plain = curves.fitted(evidence, boundary, model.name, z_hat) - 1
    plain = middle if named(evidence, boundary) else plain
    low, high = _band(quoted, model, z_hat, values, middle)
    return curves.Curve(middle=middle, low=low, high=high, least_squares=plain, sampled=False)


def _band(
    quoted: BoundaryResult,
    model: LiftModel,
    z_hat: FloatArray,
    values: Mapping[str, float],
    middle: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Ends of the 90 % band of a curve by the quoted coefficients; nan where they have no end."""
    among = quoted.correlation
    free = [n for n in among.parameters if n in quoted.coefficients]
    rows = [among.parameters.index(n) for n in free]
    u = np.array([quoted.coefficients[n].u for n in free])
    covariance = np.outer(u, u) * np.array(among.values)[np.ix_(rows, rows)]
    if not np.isfinite(covariance).all() or not free:
        none = np.full_like(middle, np.nan)
        return none, none
    if len(free) == 1:
        # one coefficient moves the whole curve: the band is its interval, however uneven
        c = quoted.coefficients[free[0]]
        ends = [curves.ratio(model, z_hat, {**values, free[0]: x}) - 1 for x in (c.lo90, c.hi90)]
        return np.minimum(*ends), np.maximum(*ends)
    spread = curves.uncertainty(
        model, z_hat, values, values, ParameterCovariance.named(free, covariance)
    )
    return middle - student.NORMAL_90 * spread, middle + student.NORMAL_90 * spread


def relative_lift(evidence: Evidence, boundary: Boundary) -> RelativeLift:
    """Every cell's lift over the fitted L_inf, or over that of the farthest station, of unknown
    uncertainty.
    """
    if not by_fit(evidence):
        table = where(evidence.table(LIFT), boundary=boundary)
        return RelativeLift(
            throttle=table["throttle"],
            z_hat=table["z_hat"],
            delta_L=np.asarray(table["delta_L"], dtype=float),
            u=np.asarray(table["u_delta_L"], dtype=float),
            u_L_inf=math.nan,
        )
    data = evidence.observations[boundary]
    data = data.take((data.z_hat > 0) & np.isfinite(data.z_hat) & (data.lift_N > 0))
    if named(evidence, boundary):
        table = where(evidence.table(LOOP_RESIDUALS), boundary=boundary)
        left = dict(zip(table["trial"].tolist(), table["after"].tolist(), strict=True))
        residual = np.array([left.get(t, np.nan) for t in data.trial.tolist()], dtype=float)
        log_ratio = np.log1p(line(evidence, boundary, data.z_hat).middle) + residual
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
    curve = line(evidence, boundary, cell[1])
    beyond = line(evidence, boundary, cell[1] * (1 + STEP))
    slope = np.nan_to_num((np.log1p(beyond.middle) - np.log1p(curve.middle)) / (STEP * cell[1]))
    visits = np.bincount(np.unique(np.stack([index, data.visit]), axis=1)[0], minlength=len(n))
    shared = ((slope * noise.height_m / data.radius_m) ** 2 + noise.common**2) / visits
    variance = np.bincount(index, of_trial) / n**2 + shared
    ratio = np.exp(np.bincount(index, log_ratio) / n)
    return RelativeLift(
        throttle=cell[0],
        z_hat=cell[1],
        delta_L=ratio - 1,
        u=ratio * np.sqrt(variance),
        u_L_inf=_u_of_levels(evidence, boundary, cell[0], cell[1], variance),
    )


def _u_of_levels(
    evidence: Evidence,
    boundary: Boundary,
    throttle: FloatArray,
    z_hat: FloatArray,
    variance: FloatArray,
) -> float:
    """Least squares over the cells for every throttle's log L_inf and the coefficients."""
    model, fit = evidence.base(boundary)
    levels, level = np.unique(throttle, return_inverse=True)
    known = {**evidence.known(boundary, model), **fit.values}
    columns = [level == i for i in range(len(levels))]
    for name in (p.name for p in model.parameters):
        step = STEP * max(abs(known[name]), STEP)
        up, down = (
            np.log(curves.ratio(model, z_hat, {**known, name: known[name] + s}))
            for s in (step, -step)
        )
        columns.append(np.nan_to_num(up - down) / (2 * step))
    weighted = np.stack(columns, axis=1) / np.sqrt(variance)[:, None]
    scale = np.sqrt((weighted**2).sum(axis=0))
    scale[scale == 0] = 1.0
    covariance = np.linalg.pinv((weighted / scale).T @ (weighted / scale))
    return float((np.sqrt(np.diagonal(covariance)) / scale)[: len(levels)].max(initial=0.0))
