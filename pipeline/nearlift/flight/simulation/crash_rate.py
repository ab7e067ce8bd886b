"""Crash rates with intervals, and the lowest set-point (level) for a given risk."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import UsageError
from nearlift.results import IntArray

#: Resamples of the flights behind the interval of a level.
RESAMPLES = 400
#: And so many for each draw of a model.
PER_DRAW = 50
INTERVAL = (5.0, 95.0)


def binomial90(crashes: IntArray, flights: int) -> tuple[FloatArray, FloatArray]:
    """Equal-tailed 90 % interval of a crash rate (Jeffreys; the end at 0 or 1 where no flight, or
    every flight, crashed).
    """
    from scipy.special import betaincinv

    k = np.asarray(crashes, dtype=float)
    low = np.where(k == 0, 0.0, betaincinv(k + 0.5, flights - k + 0.5, 0.05))
    high = np.where(k == flights, 1.0, betaincinv(k + 0.5, flights - k + 0.5, 0.95))
    return low, high


def upper95(crashes: IntArray, flights: int) -> FloatArray:
    """One-sided 95 % upper bound of a crash rate (Clopper and Pearson): where no flight crashed
    nearly 3 / flights, the rule of three.
    """
    from scipy.special import betaincinv

    k = np.asarray(crashes, dtype=float)
    bound: FloatArray = np.where(
        k >= flights, 1.0, betaincinv(k + 1.0, np.maximum(flights - k, 1e-9), 0.95)
    )
    return bound


def falling(rate: FloatArray) -> FloatArray:
    """The nearest rates that nowhere rise with the set-point (isotonic least squares), along the
    last axis: farther away is no riskier.
    """
    from scipy.optimize import isotonic_regression

    rows = np.atleast_2d(np.asarray(rate, dtype=float))
    result: FloatArray = np.stack(
        [isotonic_regression(row, increasing=False).x for row in rows]
    ).reshape(np.shape(rate))
    return result


def estimate(crashes: IntArray, flights: int) -> FloatArray:
    """Crash rates (n,) over ascending set-points: (k + 1/2) / (flights + 1), the mean under
    Jeffreys' prior, made to fall.
    """
    return falling((np.asarray(crashes, dtype=float) + 0.5) / (flights + 1))


def rate_draws(
    crashed: NDArray[np.bool_],
    number: int,
    rng: np.random.Generator,
    crash: float = 0.5,
    safe: float = 0.5,
) -> FloatArray:
    """Crash rates under resampling of the flights, with what none of them may have shown: shape
    (number, set-points), each row falling.

    The Bayesian bootstrap (Rubin 1981) weighs whole flights, which common gusts tie together over
    all set-points; a pseudo-crash and a pseudo-return of weights `crash` and `safe` (gamma shapes)
    at each set-point keep a rate that was never seen from being zero for certain. At one set-point
    the draws are Beta(k + crash, flights - k + safe): halves are Jeffreys' posterior, (1, 0) and
    (0, 1) have Clopper and Pearson's upper and lower bounds as percentiles.

    Parameters
    ----------
    crashed : bool array (set-points, flights)
        Set-points ascending.
    """
    weights = rng.standard_exponential((number, crashed.shape[1]))
    shape = (number, len(crashed))
    more, less = (rng.gamma(a, size=shape) if a > 0 else np.zeros(shape) for a in (crash, safe))
    drawn: FloatArray = (weights @ crashed.T + more) / (
        weights.sum(axis=1, keepdims=True) + more + less
    )
    return falling(drawn)


def level(target_z_hat: FloatArray, rate: FloatArray, risk: float, least: float) -> FloatArray:
    """The lowest set-point from which upwards the crash rate stays at or below `risk`; between
    set-points the logit of the rate is linear.

    Parameters
    ----------
    target_z_hat : array (n,)
        Set-points, ascending.
    rate : array (..., n)
        Crash rates.
    risk : float
    least : float
        What a rate of zero is taken for, half a crash among the flights (and a rate of one for all
        but half a flight).

    Returns
    -------
    array (...)
        nan where even the highest set-point is riskier; the lowest set-point itself (an upper
        bound) where all are safer.
    """
    safe = np.clip(np.asarray(rate, dtype=float), least, 1 - least)
    above, n = safe > risk, len(target_z_hat)
    # the highest that is riskier; -1 where none is
    last = np.where(above.any(axis=-1), n - 1 - above[..., ::-1].argmax(axis=-1), -1)
    i = np.clip(last, 0, n - 2)
    a, b = (
        np.log(p / (1 - p))
        for p in (np.take_along_axis(safe, at[..., None], -1)[..., 0] for at in (i, i + 1))
    )
    share = (a - math.log(risk / (1 - risk))) / np.where(a == b, 1.0, a - b)
    between = target_z_hat[i] + (target_z_hat[i + 1] - target_z_hat[i]) * share
    lowest: FloatArray = np.where(
        last < 0, target_z_hat[0], np.where(last == n - 1, np.nan, between)
    )
    return lowest


def refuse_few(risk: float, flights: int) -> None:
    """A risk that so few flights cannot show is refused.

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


def resamples(flights: int, rng: np.random.Generator, number: int = RESAMPLES) -> FloatArray:
    """Weights of the flights under resampling, (number, flights), the first row as flown: one table
    serves all that is compared.
    """
    drawn = rng.multinomial(flights, np.full(flights, 1 / flights), size=number - 1)
    return np.concatenate([np.ones((1, flights)), drawn]) / flights


def levels(
    target_z_hat: FloatArray, crashed: NDArray[np.bool_], risk: float, weights: FloatArray
) -> FloatArray:
    """Levels under `resamples` of the flights, which common gusts tie together over all set-points:
    shape (number,), the first as flown.
    """
    least = 0.5 / crashed.shape[1]
    return level(target_z_hat, weights @ crashed.T, risk, least)


#: Set-points nearer to each other than this, in radii, are told apart by no vehicle.
FINEST = 0.005


def wide_gaps(target_z_hat: FloatArray, levels_by_curve: Sequence[FloatArray]) -> set[float]:
    """Set-points to fly next, so that a level is not read across a gap wider than half of its
    stated interval.

    `levels_by_curve` are one curve's levels under resampling, the first as flown, or those of
    several whose spread is stated together. Empty where every level, and the ends of the interval,
    lie between set-points near enough.
    """
    low, high = spread90(np.concatenate(levels_by_curve))
    width = high - low
    allowed = max(FINEST, 0.5 * width) if np.isfinite(width) else FINEST
    wanted = [low, high, *(values[0] for values in levels_by_curve)]
    middles = set()
    for at in wanted:
        if np.isfinite(at) and at > target_z_hat[0]:
            i = int(np.searchsorted(target_z_hat, at))
            below, above = float(target_z_hat[i - 1]), float(target_z_hat[i])
            if above - below > allowed:
                middles.add(round(0.5 * (below + above), 6))
    return middles


def levels_held(target_z_hat: FloatArray, values: FloatArray) -> FloatArray:
    """Levels that the set-points hold; those at the lowest set-point, which are only upper bounds,
    become nan.
    """
    result: FloatArray = np.where(values > target_z_hat[0], values, np.nan)
    return result


def spread90(values: FloatArray) -> tuple[float, float]:
    """5 % and 95 % points; where some are nan (no set-point was safe enough) those count as beyond
    the highest.
    """
    filled = np.sort(np.where(np.isfinite(values), values, np.inf))
    low, high = (float(filled[min(int(q / 100 * len(filled)), len(filled) - 1)]) for q in INTERVAL)
    return (low if np.isfinite(low) else float("nan")), (
        high if np.isfinite(high) else float("nan")
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CrashLevel:
    """The lowest set-point for a risk, with the flights' own 90 % interval; at `lowest_flown` it is
    only an upper bound.
    """

    risk: float
    value: float
    lo90: float
    hi90: float
    lowest_flown: float

    @classmethod
    def resampled(cls, target_z_hat: FloatArray, values: FloatArray, risk: float) -> CrashLevel:
        """From the levels under resampling, the first as flown."""
        lo90, hi90 = spread90(values)
        return cls(
            risk=risk,
            value=float(values[0]),
            lo90=lo90,
            hi90=hi90,
            lowest_flown=float(target_z_hat[0]),
        )
