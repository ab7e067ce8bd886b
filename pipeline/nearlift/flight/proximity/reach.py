"""Detection range of a boundary at given rates of false alarms and misses.

Without a boundary the estimate of L / L_inf scatters about 1 with standard deviation sigma(T). An
alarm is raised when it departs, in the boundary's direction, by more than k_fa sigma, with k_fa the
normal quantile of the false-alarm rate; a boundary that changes lift by D is missed at the given
rate when D = (k_fa + k_miss) sigma. The range is the largest z_hat at which |L / L_inf - 1| is D.

    sigma(T)^2 = short^2 / T + floor^2 + payload^2 + supply^2

Averaging over T reduces only `short`, the standard deviation of a one-second average.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nearlift.flight import Ratio
from nearlift.flight.proximity.inverse import grid


@dataclass(frozen=True, slots=True, kw_only=True)
class Sensor:
    """Noise of a relative lift reading: the standard deviation of the average over one second, that
    which averaging does not reduce, and the time between independent readings.
    """

    short_per_sqrt_Hz: float
    floor: float
    every_s: float = 0.01

    def sigma(self, averaging_s: float, payload: float = 0.0, supply: float = 0.0) -> float:
        """Standard deviation of the estimated L / L_inf; `payload` and `supply` are relative
        standard uncertainties of weight and of lift by the supply.
        """
        short = self.short_per_sqrt_Hz**2 / averaging_s
        return float(np.sqrt(short + self.floor**2 + payload**2 + supply**2))


def needed(sigma: float, false_alarm_rate: float, miss_rate: float) -> float:
    """Relative change of lift that is detected at these rates."""
    from scipy.special import ndtri

    return float(sigma * (-ndtri(false_alarm_rate) - ndtri(miss_rate)))


def reach(ratio: Ratio, change: float, low: float, high: float) -> float:
    """Largest z_hat from `low` to `high` at which |L / L_inf - 1| is at least `change`,
    interpolated on the grid; nan where there is none. A result of `high` is a lower bound.
    """
    z_hat = grid(low, high)
    effect = np.abs(ratio(z_hat) - 1.0)
    enough = np.flatnonzero(effect >= change)
    if not len(enough):
        return float("nan")
    last = int(enough[-1])
    if last == len(z_hat) - 1:
        return float(z_hat[-1])
    a, b = effect[last], effect[last + 1]
    return float(z_hat[last] + (z_hat[last + 1] - z_hat[last]) * (a - change) / (a - b))


def reaches(
    ratios: Sequence[Ratio], change: float, low: float, high: float
) -> tuple[float, float, float]:
    """Detection range of the first ratio (the best estimate), and its 90 % interval over the
    others, of which those without a range count as zero.
    """
    heights = [reach(f, change, low, high) for f in ratios]
    lo90, hi90 = (
        np.percentile(np.nan_to_num(heights[1:], nan=0.0), [5, 95])
        if len(heights) > 1
        else (heights[0], heights[0])
    )
    return heights[0], float(lo90), float(hi90)
