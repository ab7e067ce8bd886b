"""Lift coefficient C_L of the rotors far from every boundary, and whether it is constant.

    L_inf = rotors C_L rho f^2 r^4        f in turns per second

Carter, Bouchard and Quinn 2021 hold C_L at 1.6 at every speed. With a logged speed, or a map from
throttle to speed, it is estimated per throttle and its trend with speed is tested. For one rotor in
air of one viscosity the Reynolds number is in proportion to speed, so the exponent of C_L ~ f^m is
that of the Reynolds number.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray

#: C_L in Carter, Bouchard and Quinn 2021.
PAPER = 1.6


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """Constant and power-law fits to C_L.

    Attributes
    ----------
    mean, u_mean : float
        Of a constant C_L.
    middle_Hz, C_middle : float
        Geometric mean speed, and the power law's C_L there.
    p_constant : float or None
        p-value of one C_L for all throttles; None for one throttle.
    exponent, u_exponent : float
        m of C_L ~ f^m; nan for one throttle.
    dof : float
        Of the exponent's interval; infinite where the uncertainties alone give it.
    p_trend : float or None
        p-value of m = 0.
    excess : float
        Birge ratio about the power law where above 1, when it has widened `u_exponent`; else 1.
    """

    mean: float
    u_mean: float
    middle_Hz: float = np.nan
    C_middle: float = np.nan
    p_constant: float | None = None
    exponent: float = np.nan
    u_exponent: float = np.nan
    dof: float = np.inf
    p_trend: float | None = None
    excess: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Rotor:
    """C_L per throttle, its standard uncertainty with the speed's, all (K,), and its trend."""

    throttle: FloatArray
    speed_Hz: FloatArray
    C_L: FloatArray
    u: FloatArray
    trend: Trend


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
    throttle: FloatArray,
    lift_N: FloatArray,
    log_covariance: FloatArray,
    speed_Hz: FloatArray,
    u_log_speed: FloatArray,
    *,
    air_density: float,
    radius_m: float,
    rotors: int,
) -> Rotor:
    """C_L per throttle and its trend.

    Parameters
    ----------
    lift_N, log_covariance : (K,), (K, K)
        L_inf, and the covariance of its logarithm.
    speed_Hz, u_log_speed : (K,)
        Speed far from the boundary, and the standard uncertainty of its logarithm, independent
        between throttles.
    air_density : float
        In kg/m^3; taken as exact, an error of it scales all C_L alike.
    """
    C_L = coefficient(lift_N, speed_Hz, air_density=air_density, radius_m=radius_m, rotors=rotors)
    covariance = log_covariance + np.diag((2 * u_log_speed) ** 2)
    law = trend(np.log(C_L), covariance, np.log(speed_Hz))
    return Rotor(
        throttle=throttle,
        speed_Hz=speed_Hz,
        C_L=C_L,
        u=C_L * np.sqrt(np.diag(covariance)),
        trend=law,
    )


def trend(log_C: FloatArray, covariance: FloatArray, log_f: FloatArray) -> Trend:
    """Constant and power law through (K,) values by generalised least squares."""
    from scipy.stats import chi2, norm, t

    k = len(log_C)
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    y = whiten @ log_C
    level = whiten @ np.ones(k)
    mean = float(level @ y / (level @ level))
    u_mean = float(1 / np.sqrt(level @ level))
    constant = Trend(mean=float(np.exp(mean)), u_mean=float(np.exp(mean) * u_mean))
    if k < 2:
        return constant
    left = float((y - mean * level) @ (y - mean * level))
    x = np.column_stack([level, whiten @ (log_f - log_f.mean())])
    inverse = np.linalg.inv(x.T @ x)
    beta = inverse @ (x.T @ y)
    residual = y - x @ beta
    # scatter about the power law beyond the uncertainties widens the interval, at the scatter's
    # degrees of freedom
    excess = float(np.sqrt(residual @ residual / (k - 2))) if k > 2 else 1.0
    wide = excess > 1
    dof = float(k - 2) if wide else np.inf
    u = float(np.sqrt(inverse[1, 1])) * max(excess, 1.0)
    ratio = abs(float(beta[1])) / u
    return replace(
        constant,
        middle_Hz=float(np.exp(log_f.mean())),
        C_middle=float(np.exp(beta[0])),
        p_constant=float(chi2.sf(left, k - 1)),
        exponent=float(beta[1]),
        u_exponent=u,
        dof=dof,
        p_trend=float(2 * (t.sf(ratio, dof) if wide else norm.sf(ratio))),
        excess=max(excess, 1.0),
    )
