"""One fitted and diagnosed campaign of each verdict, at the ground; and the whole report
of each.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Table = dict[str, np.ndarray]


def _sag(table: Table) -> None:
    """A supply that falls in the course of each session, and lift with its square."""
    n = len(table["trial"])
    fall = np.linspace(0.0, 3.0, n) % 1.0
    supply = 4.1 - 0.5 * fall + 0.01 * np.random.default_rng(2).standard_normal(n)
    table["supply_V"] = supply
    table["lift_N"] = table["lift_N"] * (supply / supply.mean()) ** 2


def _ripple(table: Table) -> None:
    """What no library holds: stations and throttles that stand up and down by turns."""
    station, throttle = (
        np.unique(table[name], return_inverse=True)[1] for name in ("z_hat", "throttle")
    )
    table["lift_N"] = table["lift_N"] * (1 + 0.015 * (-1.0) ** (station + throttle))


MADE: dict[str, dict[str, Any]] = {
    "adequate": {},
    "effect": {"edit": _sag},
    "unexplained": {"edit": _ripple},
    "not_diagnosed": {"repeats": 1},
}
