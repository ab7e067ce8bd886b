"""Crash rates with intervals, the set-point for a given risk, and whether the time step was small enough."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import UsageError
from nearlift.results import IntArray

#: Resamples of the flights behind the interval of a level.
RESAMPLES = 400
INTERVAL = (5.0, 95.0)


def binomial90(crashes: IntArray, flights: int) -> tuple[FloatArray, FloatArray]:
    """Equal-tailed 90 % interval of a crash rate (Jeffreys; the end at 0 or 1 where no flight, or every flight, crashed)."""
    from scipy.special import betaincinv

    k = np.asarray(crashes, dtype=float)
    low = np.where(k == 0, 0.0, betaincinv(k + 0.5, flights - k + 0.5, 0.05))
    high = np.where(k == flights, 1.0, betaincinv(k + 0.5, flights - k + 0.5, 0.95))
    return low, high


def level(target_z_hat: FloatArray, rate: FloatArray, risk: float, least: float) -> float:
    """The lowest set-point from which upwards the crash rate stays at or below `risk`; log-linear between set-points.

    Parameters
    ----------
    target_z_hat, rate : array (n,)
        Set-points, ascending, and crash rates.
    risk : float
    least : float
        What a rate of zero is taken for, half a crash among the flights.

    Returns
    -------
    float
        nan where even the highest set-point is riskier; the lowest set-point itself (an upper bound) where all are safer.
    """
    safe = np.maximum(np.asarray(rate, dtype=float), least)
    above = np.flatnonzero(safe > risk)
    if not len(above):
        return float(target_z_hat[0])
    last = int(above[-1])
    if last == len(safe) - 1:
        return float("nan")
    a, b = np.log(safe[last]), np.log(safe[last + 1])
    return float(target_z_hat[last] + (target_z_hat[last + 1] - target_z_hat[last]) * (a - np.log(risk)) / (a - b))


def refuse_few(risk: float, flights: int) -> None:
    """A risk that so few flights cannot show is refused.

    Raises
    ------
    UsageError
        Fewer than three crashes are expected at that risk; says how many flights would do.
    """
    if risk * flights < 3:
        raise UsageError("risk", f"{risk:g} cannot be seen in {flights} flights", f"fly at least {int(np.ceil(3 / risk))}")


def levels(target_z_hat: FloatArray, crashed: NDArray[np.bool_], risk: float, rng: np.random.Generator, resamples: int = RESAMPLES) -> FloatArray:
    """Levels under resampling of the flights, which common gusts tie together over all set-points: shape (resamples,), the first as flown."""
    flights = crashed.shape[1]
    weights = rng.multinomial(flights, np.full(flights, 1 / flights), size=resamples - 1)
    rates = np.concatenate([crashed.mean(axis=1)[None], weights @ crashed.T / flights])
    return np.array([level(target_z_hat, r, risk, 0.5 / flights) for r in rates])


def spread90(values: FloatArray) -> tuple[float, float]:
    """5 % and 95 % points; where some are nan (no set-point was safe enough) those count as beyond the highest."""
    filled = np.sort(np.where(np.isfinite(values), values, np.inf))
    low, high = (float(filled[min(int(q / 100 * len(filled)), len(filled) - 1)]) for q in INTERVAL)
    return (low if np.isfinite(low) else float("nan")), (high if np.isfinite(high) else float("nan"))


@dataclass(frozen=True, slots=True, kw_only=True)
class Convergence:
    """What halving the time step changes.

    Attributes
    ----------
    converged : bool
        No crash rate leaves its own binomial interval.
    worst : float
        Largest change of a crash rate.
    worst_target_z_hat : float
        Set-point where that is.
    beyond : int
        Settings whose rate leaves its interval.
    settings, flights : int
        How many were compared.
    step_s, halved_s : float
    """

    converged: bool
    worst: float
    worst_target_z_hat: float
    beyond: int
    settings: int
    flights: int
    step_s: float
    halved_s: float


def convergence(target_z_hat: FloatArray, coarse: NDArray[np.bool_], fine: NDArray[np.bool_], step_s: float) -> Convergence:
    """Compare the same flights (settings, flights) at a step and at half of it."""
    flights = coarse.shape[1]
    before, after = coarse.sum(axis=1), fine.sum(axis=1)
    low, high = binomial90(before, flights)
    rate = after / flights
    outside = (rate < low) | (rate > high)
    change = np.abs(after - before) / flights
    worst = int(change.argmax())
    return Convergence(
        converged=not bool(outside.any()),
        worst=float(change[worst]),
        worst_target_z_hat=float(target_z_hat[worst]),
        beyond=int(outside.sum()),
        settings=len(before),
        flights=flights,
        step_s=step_s,
        halved_s=step_s / 2,
    )
