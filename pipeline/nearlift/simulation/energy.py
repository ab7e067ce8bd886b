"""What hovering near a boundary costs, and where to hover when a crash has a price.

Relative cost is power to hover near the boundary over power far away, always at the same thrust (the weight). What L / L_inf says
of it depends on what was held while L / L_inf was measured or derived:

power   thrusts at the same power: T goes as P^(2/3) at a fixed inflow factor, so cost = ratio^(-3/2), as the paper takes it for all.
thrust  the ratio is P_inf / P at the same thrust, as the theories' factor is (Hsiao-Chirarattananon's gamma; an image's 1/(1 - s)
        read through momentum theory): cost = 1 / ratio.
rpm     thrusts at the same frequency: ratio = (P_inf/P)^n with n between 0.60 and 0.82 for a small rotor, so cost = ratio^(-1/n).
throttle, voltage  between constant rpm and constant power; the exponent is known only between 1 and 1/0.60.

Mechanical power; motors and electronics are not in it.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from nearlift.declare import FloatArray

Held = Literal["power", "thrust", "rpm", "throttle", "voltage"]
#: Exponent e of cost = ratio^(-e) as (lowest, best, highest).
EXPONENTS: dict[Held, tuple[float, float, float]] = {
    "power": (1.5, 1.5, 1.5),
    "thrust": (1.0, 1.0, 1.0),
    "rpm": (1 / 0.82, 1 / 0.70, 1 / 0.60),
    "throttle": (1.0, 1.5, 1 / 0.60),
    "voltage": (1.0, 1.5, 1 / 0.60),
}


def paper_cost(ratio: Any) -> Any:
    """(L / L_inf)^(-3/2), whatever was held."""
    return np.power(ratio, -1.5)


def cost(ratio: Any, held: Held) -> tuple[Any, Any, Any]:
    """Relative cost by what was held: (lowest, best, highest) over what is not known of the exponent. Shapes as `ratio`."""
    values = np.stack([np.power(ratio, -e) for e in EXPONENTS[held]])
    return values.min(axis=0), values[1], values.max(axis=0)


def expected_cost(relative_cost: FloatArray, rate: FloatArray, price: float) -> FloatArray:
    """Cost of a flight in energies of a hover far away of the same duration: relative cost, and `price` for each crash."""
    result: FloatArray = relative_cost + price * rate
    return result


def best_set_point(target_z_hat: FloatArray, relative_cost: FloatArray, rate: FloatArray, price: float) -> tuple[int, float]:
    """Index of the set-point of least expected cost (the highest of equals), and that cost."""
    total = expected_cost(relative_cost, rate, price)
    best = int(len(total) - 1 - np.argmin(total[::-1]))
    return best, float(total[best])


def front(relative_cost: FloatArray, rate: FloatArray) -> IntIndex:
    """Set-points that no other beats in both energy and risk, by ascending risk."""
    order = np.lexsort((relative_cost, rate))
    kept, least = [], np.inf
    for i in order:
        if relative_cost[i] < least:
            kept.append(i)
            least = relative_cost[i]
    return np.array(kept, dtype=np.int64)


IntIndex = np.ndarray[Any, np.dtype[np.int64]]
