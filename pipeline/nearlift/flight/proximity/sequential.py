"""A sequential test of the lift ratio: how many false alarms it raises in an hour, and how long it
takes to notice a boundary that changes lift by so much.

Page's cumulative sum S = max(0, S + x - D / 2) adds up readings x = |L / L_inf - 1| of standard
deviation sigma, one every `every_s`; the alarm is S > h sigma. Without a boundary x has mean 0,
with one D. What averaging does not take away is an offset that stays: either mean is taken at its
worse end (95 %, one-sided). Mean times to an alarm are Siegmund's (1985),
(exp(-2 m b) + 2 m b - 1) / (2 m^2) readings for a drift of m sigma and b = h + 1.166.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

#: What Siegmund adds for the overshoot at either barrier.
OVERSHOOT = 1.166
#: The 95 % point of a standard normal.
ONE_SIDED = 1.6448536269514722
HOUR_S = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SequentialTest:
    """Threshold in sigma, and mean delay of the alarm in s (infinite where what averaging does not
    take away hides the change).
    """

    threshold: float
    delay_s: float


def run_length(drift: float, threshold: float) -> float:
    """Mean number of readings to an alarm; drift and threshold in standard deviations."""
    b = threshold + OVERSHOOT
    exponent = -2.0 * drift * b
    if abs(exponent) < 1e-6:
        return b * b
    return math.inf if exponent > 700 else (math.expm1(exponent) - exponent) / (2.0 * drift**2)


def sequential_test(
    change: float, sigma: float, offset_u: float, every_s: float, alarms_per_hour: float
) -> SequentialTest:
    """The test for one change of lift (a fraction).

    Parameters
    ----------
    sigma : float
        Standard deviation of one reading, without what stays.
    offset_u : float
        Standard uncertainty of what stays: floor, payload and supply.
    every_s : float
        Time between readings.
    alarms_per_hour : float
        False alarms allowed, where the offset is at its 95 % end.
    """
    drift = (0.5 * abs(change) - ONE_SIDED * offset_u) / sigma
    if drift <= 0:
        return SequentialTest(threshold=math.inf, delay_s=math.inf)
    wanted = HOUR_S / (alarms_per_hour * every_s)
    low, high = 0.0, 1.0
    while run_length(-drift, high) < wanted:
        high *= 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if run_length(-drift, middle) >= wanted else (middle, high)
    return SequentialTest(threshold=high, delay_s=every_s * run_length(drift, high))
