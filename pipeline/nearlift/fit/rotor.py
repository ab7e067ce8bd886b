"""Lift coefficient C_L of the rotors far from every boundary, and whether it is constant.

    L_inf = rotors C_L rho f^2 r^4        f in turns per second

Carter, Bouchard and Quinn 2021 hold C_L at 1.6 at every speed. With a logged speed, or a map from
throttle to speed, it is estimated per throttle and its trend with speed is tested. For one rotor in
air of one viscosity the Reynolds number is in proportion to speed. The exponent of C_L ~ f^m is
therefore that of the Reynolds number.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from nearlift.campaign.manifest import Campaign
from nearlift.declare import FloatArray
from nearlift.effects.gain import STANDARD, density
from nearlift.fit.held_quantity import Response, logged
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.likelihood import student
from nearlift.results import Estimate, Observations
from nearlift.results.fit import (
    RotorCoefficient,
    RotorTrend,
    RotorUnknown,
    ThrottleLift,
)
from nearlift.rounding import chance, plus_minus

#: C_L, dimensionless, of Carter, Bouchard and Quinn 2021, at every speed.
PAPER_C_L = 1.6
NO_SPEED = (
    "No rotor speed is known: log rpm in trials.csv, or give [vehicle.throttle_map], and C_L is"
    " estimated per throttle."
)
NO_DENSITY = (
    "The density of air is not known: give air_density in [rig], or log temperature (pressure,"
    " humidity)."
)


class Trend(NamedTuple):
    """Constant C_L, and the exponent m of C_L ~ f^m with the p-value of m = 0 (None for one
    throttle).

    `excess` is the Birge ratio about the power law, at least 1; the exponent's interval is wider by
    it.
    """

    mean: Estimate
    exponent: Estimate | None = None
    p_trend: float | None = None
    excess: float = 1.0


def coefficient(
    lift_N: FloatArray,
    speed_Hz: FloatArray,
    *,
    air_density: FloatArray | float,
    radius_m: float,
    rotors: int,
) -> FloatArray:
    """C_L from the whole vehicle's lift, all rotors at one speed in turns per second (their root
    mean square where they differ). Shapes broadcast.
    """
    return np.asarray(lift_N / (rotors * air_density * speed_Hz**2 * radius_m**4), dtype=np.float64)


def examine(
    campaign: Campaign,
    fit: LeastSquaresFit,
    responses: Sequence[Response],
) -> RotorCoefficient:
    """C_L per throttle from L_inf and the logged or mapped speed, or the `missing` inputs.

    The air's density is taken as exact: an error of it scales all C_L alike.
    """
    data, vehicle = fit.problem.data, campaign.vehicle
    measured, air = logged_speed(data, responses), air_density(campaign, data)
    if measured is None and vehicle.throttle_map is not None:
        mapped = vehicle.throttle_map.speed_Hz(data.levels)
        measured = mapped, np.full(len(mapped), vehicle.throttle_map.uncertainty)
    if measured is None or not (known := np.isfinite(measured[0])).any():
        return RotorUnknown(missing=("rpm",), text=NO_SPEED)
    if air is None:
        return RotorUnknown(missing=("air_density",), text=NO_DENSITY)
    log_levels = data.shown(fit.level_coefficients)
    covariance = fit.problem.shown_covariance(fit.level_covariance)[known][:, known]
    speed, u_log = (each[known] for each in measured)
    C_L = coefficient(
        np.exp(log_levels[known]),
        speed,
        air_density=air,
        radius_m=data.radius_m,
        rotors=vehicle.rotors,
    )
    # errors of speed are independent between throttles
    whole = covariance + np.diag((2 * u_log) ** 2)
    law, u = trend(np.log(C_L), whole, np.log(speed)), C_L * np.sqrt(np.diag(whole))
    return RotorTrend(
        air_density=air,
        per_throttle={
            x: ThrottleLift.around(c, u_c, student.NORMAL_90, speed_Hz=f)
            for x, f, c, u_c in zip(data.levels[known], speed, C_L, u, strict=True)
        },
        mean=law.mean,
        exponent=law.exponent,
        p_trend=law.p_trend,
        text=_text(C_L, u, law),
    )


def air_density(campaign: Campaign, data: Observations) -> float | None:
    """Air density in kg/m^3 by the manifest, else the mean of the log; None without either."""
    if campaign.rig.air_density is not None:
        return campaign.rig.air_density
    kelvin = data.covariates.get("temperature_K")
    if kelvin is None or not np.isfinite(kelvin).any():
        return None
    others = {n: data.covariates.get(n) for n in ("pressure_Pa", "humidity")}
    pressure, humidity = (STANDARD[n] if x is None else x for n, x in others.items())
    return float(np.nanmean(density(kelvin, pressure, humidity)))


def logged_speed(
    data: Observations, responses: Sequence[Response]
) -> tuple[FloatArray, FloatArray] | None:
    """Speed per throttle far from the boundary, and the standard uncertainty of its logarithm; None
    where no rpm was logged.

    Without an estimated response of speed to the boundary it is the geometric mean at each
    throttle's farthest station.
    """
    known = next((r for r in responses if r.logged.quantity == "speed_Hz"), None)
    if known is not None:
        return np.exp(known.log_far), known.u_log_far
    speed = logged(data).get("speed_Hz")
    if speed is None:
        return None
    mean, u = [], []
    for k in range(len(data.levels)):
        at_throttle = data.level == k
        far = np.log(speed[at_throttle & (data.z_hat == data.z_hat[at_throttle].max())])
        mean.append(far.mean())
        u.append(far.std(ddof=1) / np.sqrt(len(far)) if len(far) > 1 else 0.0)
    return np.exp(mean), np.array(u)


def _text(C_L: FloatArray, u: FloatArray, law: Trend) -> str:
    """C_L and its trend, with the paper's constant."""
    low, high = C_L.min(), C_L.max()
    text = f"C_L is {low:.3g} to {high:.3g}" if len(C_L) > 1 else f"C_L is {low:.3g} ± {u[0]:.1g}"
    text += f" ({100 * (law.mean.value / PAPER_C_L - 1):+.0f} % from the paper's {PAPER_C_L:g})."
    if law.exponent and law.p_trend is not None:
        text += (
            f" C_L scales as speed (Reynolds number) to the power"
            f" {plus_minus(law.exponent.value, law.exponent.u)} ({chance(law.p_trend)} for a"
            " constant)."
        )
    if law.excess > 1:
        text += (
            f" C_L scatters about that law by {law.excess:.2g} times its uncertainty. The"
            " interval is widened by that."
        )
    return text


def trend(log_C: FloatArray, covariance: FloatArray, log_f: FloatArray) -> Trend:
    """Constant and power law through (K,) values by generalised least squares."""
    from scipy.stats import t

    k = len(log_C)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    y, level = whiten @ log_C, whiten @ np.ones(k)
    value = float(np.exp(level @ y / (level @ level)))
    mean = Estimate.around(value, value / float(np.sqrt(level @ level)), student.NORMAL_90)
    if k < 2:
        return Trend(mean)
    x = np.column_stack([level, whiten @ (log_f - log_f.mean())])
    inverse = np.linalg.inv(x.T @ x)
    slope = (inverse @ (x.T @ y))[1]
    # scatter about the power law beyond the uncertainties widens the interval, at the scatter's
    # degrees of freedom
    birge = float(np.sqrt(np.sum((y - x @ inverse @ (x.T @ y)) ** 2) / (k - 2))) if k > 2 else 1.0
    excess, dof = (birge, float(k - 2)) if birge > 1 else (1.0, np.inf)
    u = float(np.sqrt(inverse[1, 1])) * excess
    exponent = Estimate.around(slope, u, student.quantile(0.95, dof))
    return Trend(mean, exponent, float(2 * t.sf(abs(slope) / u, dof)), excess)
