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
from nearlift.results.serial import optional

#: Bootstrap resamples of the flights for the interval of a level.
RESAMPLES = 400
#: Resamples for each draw of a model.
PER_DRAW = 50


def binomial90(crashes: IntArray, flights: int) -> tuple[FloatArray, FloatArray]:
    """Jeffreys' equal-tailed 90 % interval of a crash rate, to 0 or 1 if none or all crashed."""
    from scipy.special import betaincinv

    k = np.asarray(crashes, dtype=float)
    low = np.where(k == 0, 0.0, betaincinv(k + 0.5, flights - k + 0.5, 0.05))
    high = np.where(k == flights, 1.0, betaincinv(k + 0.5, flights - k + 0.5, 0.95))
    return low, high


def upper95(crashes: IntArray | int, flights: int) -> FloatArray:
    """Clopper and Pearson's one-sided 95 % upper bound of a crash rate: nearly 3 / flights where no
    flight crashed (the rule of three).
    """
    from scipy.special import betaincinv

    k = np.asarray(crashes, dtype=float)
    return np.where(k >= flights, 1.0, betaincinv(k + 1.0, np.maximum(flights - k, 1e-9), 0.95))


def falling(rate: FloatArray) -> FloatArray:
    """Isotonic least-squares fit along the last axis, non-increasing with the set-point."""
    from scipy.optimize import isotonic_regression

    rows = np.atleast_2d(np.asarray(rate, dtype=float))
    return np.stack([isotonic_regression(row, increasing=False).x for row in rows]).reshape(
        np.shape(rate)
    )


def estimate(crashes: IntArray, flights: int) -> FloatArray:
    """Crash rates (..., n) over ascending set-points: (k + 1/2) / (flights + 1), the posterior mean
    under Jeffreys' prior, made non-increasing.
    """
    return falling((np.asarray(crashes, dtype=float) + 0.5) / (flights + 1))


def rate_draws(
    crashed: NDArray[np.bool_],
    number: int,
    rng: np.random.Generator,
    crash: float = 0.5,
    safe: float = 0.5,
) -> FloatArray:
    """Posterior draws of crash rates from the Bayesian bootstrap of flights: shape (number,
    set-points), each row non-increasing; `crashed` is (set-points, flights), set-points ascending.

    The bootstrap (Rubin 1981) weights whole flights, since common gusts correlate the crashes of
    one flight over all set-points; a pseudo-crash and a pseudo-return with gamma weights (shapes
    `crash` and `safe`) at each set-point allow for events not seen. At one set-point the draws are
    Beta(k + crash, flights - k + safe): halves give Jeffreys' posterior, (1, 0) and (0, 1) have
    Clopper and Pearson's upper and lower bounds as percentiles.
    """
    weights = rng.standard_exponential((number, crashed.shape[1]))
    shape = (number, len(crashed))
    more, less = (rng.gamma(a, size=shape) if a > 0 else np.zeros(shape) for a in (crash, safe))
    drawn: FloatArray = (weights @ crashed.T + more) / (
        weights.sum(axis=1, keepdims=True) + more + less
    )
    return falling(drawn)


def level(target_z_hat: FloatArray, rate: FloatArray, risk: float, least: float) -> FloatArray:
    """Lowest set-point above which the crash rate stays within `risk`, shape (...), for rates (...,
    n) at ascending set-points (n,); logits are interpolated, of rates clipped to [least, 1 -
    least]: half a crash among the flights. nan where the highest set-point is riskier; the lowest,
    an upper bound, where all are safer.
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


#: Gap between set-points, in rotor radii, that needs no refinement: no vehicle tells them apart.
FINEST = 0.005


def wide_gaps(target_z_hat: FloatArray, levels_by_curve: Sequence[FloatArray]) -> set[float]:
    """Set-points to add so that no level is interpolated over a gap wider than half its interval.

    `levels_by_curve` are levels under resampling, the first as flown, of one curve or of several
    whose spread is stated together. Empty where every level and the ends of the interval lie in
    narrow gaps; a gap of FINEST is always narrow.
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
    """Levels above the lowest set-point; at it they are only upper bounds, and become nan."""
    return np.where(values > target_z_hat[0], values, np.nan)


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

    exponent: float | None = optional()
    risk: float
    value: float
    lo90: float
    hi90: float
    lowest_flown: float
