"""Page's cumulative sum test of the lift ratio: rate of false alarms and mean detection delay.

S = max(0, S + x - D / 2) adds readings x = |L / L_inf - 1| of standard deviation sigma, one every
`every_s`; the alarm is S > h sigma. The mean of x is 0 without a boundary, D with one; a constant
offset, which averaging does not reduce, is taken at the worse end (95 %, one-sided) of either. Mean
times to an alarm are Siegmund's (1985): (exp(-2 m b) + 2 m b - 1) / (2 m^2) readings for a drift of
m sigma and b = h + 1.166.
"""

from __future__ import annotations

import math

from nearlift.likelihood import student

#: Siegmund's correction for the overshoot at the barriers, in standard deviations.
OVERSHOOT = 1.166
HOUR_S = 3600.0


def run_length(drift: float, threshold: float) -> float:
    """Mean number of readings to an alarm; drift and threshold in standard deviations."""
    b = threshold + OVERSHOOT
    exponent = -2.0 * drift * b
    if abs(exponent) < 1e-6:
        return b * b
    return math.inf if exponent > 700 else (math.expm1(exponent) - exponent) / (2.0 * drift**2)


def sequential_test(
    change: float, sigma: float, offset_u: float, every_s: float, alarms_per_hour: float
) -> tuple[float, float]:
    """Threshold in sigma and mean delay in s for a relative change of lift; both infinite where the
    offset hides it.

    `sigma` is the standard deviation of one reading, taken every `every_s`, without the constant
    offset; `offset_u` the standard uncertainty of that: floor, payload and supply. The mean rate of
    false alarms is allowed with the offset at its 95 % end.
    """
    drift = (0.5 * abs(change) - student.NORMAL_90 * offset_u) / sigma
    if drift <= 0:
        return math.inf, math.inf
    wanted = HOUR_S / (alarms_per_hour * every_s)
    low, high = 0.0, 1.0
    while run_length(-drift, high) < wanted:
        high *= 2.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if run_length(-drift, middle) >= wanted else (middle, high)
    return high, every_s * run_length(drift, high)
