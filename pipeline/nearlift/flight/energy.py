"""Power to hover near a boundary over power far away, at the same thrust (the weight).

Its relation to L / L_inf depends on the quantity held while L / L_inf was measured or derived:

power              thrusts at the same power: T scales as P^(2/3) at a fixed inflow factor, so
                   cost = ratio^(-3/2). The paper takes this for all.
thrust             the ratio is P_inf / P at the same thrust: cost = 1 / ratio. So it is in the
                   theories (Hsiao-Chirarattananon's gamma; an image's 1/(1 - s) by momentum
                   theory).
rpm                thrusts at the same frequency: ratio = (P_inf/P)^n, so cost = ratio^(-1/n). For
                   a small rotor n is between 0.60 and 0.82.
throttle, voltage  between constant rpm and constant power. The exponent is known only between 1
                   and 1/0.60.

Mechanical power, without the losses of motors and electronics.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

Held = Literal["power", "thrust", "rpm", "throttle", "voltage"]
#: Exponent e of cost = ratio^(-e): (lowest, best, highest).
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
    """Relative power (lowest, best, highest) over the uncertainty of the exponent for `held`."""
    values = np.stack([np.power(ratio, -e) for e in EXPONENTS[held]])
    return values.min(axis=0), values[1], values.max(axis=0)
