"""Hover power near a boundary, and the set-point of least expected cost at a price of a crash.

Relative cost is power to hover near the boundary over power far away, at the same thrust (the
weight). Its relation to L / L_inf depends on what was held while L / L_inf was measured or derived:

power              thrusts at the same power: T goes as P^(2/3) at a fixed inflow factor, so
                   cost = ratio^(-3/2), as the paper takes it for all.
thrust             the ratio is P_inf / P at the same thrust, as in the theories
                   (Hsiao-Chirarattananon's gamma; an image's 1/(1 - s) by momentum theory):
                   cost = 1 / ratio.
rpm                thrusts at the same frequency: ratio = (P_inf/P)^n with n between 0.60 and 0.82
                   for a small rotor, so cost = ratio^(-1/n).
throttle, voltage  between constant rpm and constant power; the exponent is known only between 1
                   and 1/0.60.

Mechanical power, without the losses of motors and electronics.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from nearlift.declare import FloatArray
from nearlift.flight.simulation.crash_rate import estimate, upper95
from nearlift.results import IntArray

Held = Literal["power", "thrust", "rpm", "throttle", "voltage"]
#: Exponent e of cost = ratio^(-e): (lowest, best, highest).
EXPONENTS: dict[Held, tuple[float, float, float]] = {
    "power": (1.5, 1.5, 1.5),
    "thrust": (1.0, 1.0, 1.0),
    "rpm": (1 / 0.82, 1 / 0.70, 1 / 0.60),
    "throttle": (1.0, 1.5, 1 / 0.60),
    "voltage": (1.0, 1.5, 1 / 0.60),
}

#: Crash rate above which no set-point is advised.
MOST_CRASHES = 0.5
#: Number of flights at which the search for a sufficient number ends.
MOST_FLIGHTS = 10_000_000


def paper_cost(ratio: Any) -> Any:
    """(L / L_inf)^(-3/2), whatever was held."""
    return np.power(ratio, -1.5)


def cost(ratio: Any, held: Held) -> tuple[Any, Any, Any]:
    """Relative cost (lowest, best, highest) over the uncertainty of the exponent for `held`."""
    values = np.stack([np.power(ratio, -e) for e in EXPONENTS[held]])
    return values.min(axis=0), values[1], values.max(axis=0)


def best_set_point(relative_cost: FloatArray, rate: FloatArray, price: float) -> tuple[int, float]:
    """Index and expected cost of the cheapest set-point (the highest of equals); costs and the
    `price` of a crash are in energies of a hover far away of the same duration.

    Set-points where more than half of the flights crash are excluded, except the highest.
    """
    total = np.where(rate > MOST_CRASHES, np.inf, relative_cost + price * rate)
    total[-1] = relative_cost[-1] + price * rate[-1]
    best = int(len(total) - 1 - np.argmin(total[::-1]))
    return best, float(total[best])


@dataclass(frozen=True, slots=True, kw_only=True)
class BestSetPoint:
    """Set-point of least expected cost at a price of a crash, and whether the flights resolve it.

    Attributes
    ----------
    price : float
        Of a crash, in energies of a hover far away of the same duration.
    target_z_hat, lo90, hi90 : float or None
        None where none is advised; the interval is over draws of the model and the flights.
    farthest : bool
        Whether it is the farthest set-point flown.
    crashes : int
        In flights that had no part in the choice.
    rate, rate_hi95 : float
        Estimate and one-sided upper bound of the crash rate, from the same flights.
    resolved : bool
        Whether it costs less, even at the upper bound of its crash rate, than the farthest
        set-point would without crashes. True of the farthest itself: the best is there or beyond.
    flights_needed : int or None
        Flights that would resolve it at the crash rate of the flights that chose it; None where it
        is resolved or `MOST_FLIGHTS` would not do.
    agrees : bool
        Whether both extrapolations of lift below the nearest station lead to it; if not,
        `target_z_hat` is None and the interval is that of the model's own form.
    """

    price: float
    target_z_hat: float | None
    lo90: float | None = None
    hi90: float | None = None
    farthest: bool
    expected_cost: float
    relative_cost: float
    crashes: int
    rate: float
    rate_hi95: float
    resolved: bool
    flights_needed: int | None
    agrees: bool = True


def choose(
    target_z_hat: FloatArray,
    relative_cost: FloatArray,
    crashes: IntArray,
    again: IntArray,
    flights: int,
    price: float,
) -> BestSetPoint:
    """Set-point of least expected cost among n, and whether this number of flights resolves it.

    Choosing the best of many selects for luck: the crash rate stated is that of `again`, the
    crashes in as many other flights.
    """
    best, _ = best_set_point(relative_cost, estimate(crashes, flights), price)
    farthest = best == len(crashes) - 1
    k = int(again[best])
    rate = float(estimate(again[best : best + 1], flights)[0])
    saving = float(relative_cost[-1] - relative_cost[best])

    def shown(crashes: int, flights: int) -> bool:
        return price * float(upper95(crashes, flights)) <= saving

    resolved = farthest or shown(k, flights)
    needed = None
    first = int(crashes[best])
    if not resolved and saving > price * first / flights:
        # the first flights may resolve it where the others do not: then at least twice as many
        needed = 2 * flights if shown(first, flights) else flights
        while not shown(round(first * needed / flights), needed) and needed < MOST_FLIGHTS:
            needed = int(np.ceil(1.05 * needed))
        if needed >= MOST_FLIGHTS:
            needed = None
    return BestSetPoint(
        price=price,
        target_z_hat=float(target_z_hat[best]) if resolved else None,
        farthest=farthest,
        expected_cost=float(relative_cost[best] + price * rate),
        relative_cost=float(relative_cost[best]),
        crashes=k,
        rate=rate,
        rate_hi95=float(upper95(k, flights)),
        resolved=resolved,
        flights_needed=needed,
    )


def front(relative_cost: FloatArray, rate: FloatArray) -> IntArray:
    """Pareto front of energy and risk: indices of set-points, by ascending risk."""
    order = np.lexsort((relative_cost, rate))
    kept, least = [], np.inf
    for i in order:
        if relative_cost[i] < least:
            kept.append(i)
            least = relative_cost[i]
    return np.array(kept, dtype=np.int64)
