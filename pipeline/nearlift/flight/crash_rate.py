"""Crash rates with intervals, and the lowest set-point (level) for a given risk."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import UsageError
from nearlift.results import IntArray
from nearlift.results.document import IfAny, Real

#: Bootstrap resamples of the flights for the interval of a level.
RESAMPLES = 400
#: Gap between set-points, in rotor radii, that needs no refinement.
FINEST = 0.005


def binomial90(crashes: IntArray, flights: int) -> tuple[FloatArray, FloatArray]:
    """Jeffreys' equal-tailed 90 % interval of a crash rate, to 0 or 1 if none or all crashed."""
    from scipy.special import betaincinv

    k = np.asarray(crashes, dtype=float)
    low = np.where(k == 0, 0.0, betaincinv(k + 0.5, flights - k + 0.5, 0.05))
    high = np.where(k == flights, 1.0, betaincinv(k + 0.5, flights - k + 0.5, 0.95))
    return low, high


def level(target_z_hat: FloatArray, rate: FloatArray, risk: float, least: float) -> FloatArray:
    """Lowest set-point above which the crash rate stays within `risk`, shape (...).

    Rates (..., n) at ascending set-points (n,) are clipped to [least, 1 - least], half a crash
    among the flights, and their logits interpolated. The level is nan where the highest set-point
    is riskier; where all are safer it is the lowest, an upper bound.
    """
    safe = np.clip(np.asarray(rate, dtype=float), least, 1 - least)
    above, n = safe > risk, len(target_z_hat)
    # index of the highest set-point that is riskier; -1 where none is
    last = np.where(above.any(axis=-1), n - 1 - above[..., ::-1].argmax(axis=-1), -1)
    i = np.clip(last, 0, n - 2)
    a, b = (
        np.log(p / (1 - p))
        for p in (np.take_along_axis(safe, at[..., None], -1)[..., 0] for at in (i, i + 1))
    )
    share = (a - math.log(risk / (1 - risk))) / np.where(a == b, 1.0, a - b)
    between = target_z_hat[i] + (target_z_hat[i + 1] - target_z_hat[i]) * share
    between = np.where(last == n - 1, np.nan, between)
    return np.where(last < 0, target_z_hat[0], between)


def refuse_few(risk: float, flights: int) -> None:
    """Refuse a risk too small for the number of flights.

    Raises
    ------
    UsageError
        Fewer than three crashes are expected at that risk; says how many flights would do.
    """
    if risk * flights < 3:
        raise UsageError(
            "risk",
            f"{risk:g} cannot be seen in {flights} flights",
            f"fly at least {int(np.ceil(3 / risk))}",
        )


def resamples(flights: int, rng: np.random.Generator) -> FloatArray:
    """Bootstrap weights of the flights (RESAMPLES, flights), the first row as flown."""
    drawn = rng.multinomial(flights, np.full(flights, 1 / flights), size=RESAMPLES - 1)
    return np.concatenate([np.ones((1, flights)), drawn]) / flights


def levels(
    target_z_hat: FloatArray, crashed: NDArray[np.bool_], risk: float, weights: FloatArray
) -> FloatArray:
    """Levels under the bootstrap weights of `resamples`, (RESAMPLES,), the first as flown; each
    weight is common to all set-points, as the gusts are.
    """
    least = 0.5 / crashed.shape[1]
    return level(target_z_hat, weights @ crashed.T, risk, least)


def wide_gaps(target_z_hat: FloatArray, resampled: FloatArray) -> set[float]:
    """Set-points to add so that no level is interpolated over a gap wider than half its interval.

    `resampled` are the levels of one curve under resampling, the first as flown. Empty where the
    level and the ends of its interval lie in narrow gaps; a gap of FINEST is always narrow.
    """
    low, high = spread90(resampled)
    width = high - low
    allowed = max(FINEST, 0.5 * width) if np.isfinite(width) else FINEST
    middles = set()
    for at in (low, high, resampled[0]):
        if np.isfinite(at) and at > target_z_hat[0]:
            i = int(np.searchsorted(target_z_hat, at))
            below, above = float(target_z_hat[i - 1]), float(target_z_hat[i])
            if above - below > allowed:
                middles.add(round(0.5 * (below + above), 6))
    return middles


def spread90(values: FloatArray) -> tuple[float, float]:
    """5 % and 95 % points; nan (no set-point was safe enough) ranks above every level."""
    n, ordered = len(values), np.sort(values)
    low, high = (float(ordered[min(int(q * n), n - 1)]) for q in (0.05, 0.95))
    return low, high


@dataclass(frozen=True, slots=True, kw_only=True)
class CrashLevel:
    """Lowest set-point at a risk, with its 90 % bootstrap interval over the flights; an upper bound
    where it is `lowest_flown`. `exponent` is the power of the paper's model, where it is of that.
    """

    exponent: IfAny[float] = None
    risk: Real
    value: Real
    lo90: Real
    hi90: Real
    lowest_flown: Real
