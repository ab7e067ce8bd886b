"""The random vertical force, with a spectrum: a standard deviation alone says nothing until its
bandwidth is known.

The force is constant for `hold_s`, then drawn anew; from hold to hold it forgets with
`correlation_s` (0: at once). The paper's 0.015 N "white noise" is one value per step of 0.1 s, that
is hold_s = 0.1: a two-sided power spectral density of sd^2 hold = 2.25e-5 N^2 s at low frequency,
with its first zero at 10 Hz. The same sd drawn for every 0.01 s step has a tenth of it, and no
vehicle crashes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """Standard deviation in N, time for which a value is held in s, and correlation time in s (0:
    white from hold to hold).
    """

    sd_N: float
    hold_s: float
    correlation_s: float = 0.0

    @property
    def memory(self) -> float:
        """Correlation of one held value with the next."""
        return math.exp(-self.hold_s / self.correlation_s) if self.correlation_s > 0 else 0.0

    @property
    def density_N2_s(self) -> float:
        """Two-sided power spectral density at low frequency, N^2 s (per Hz over negative and
        positive frequencies).
        """
        return self.sd_N**2 * self.hold_s * (1 + self.memory) / (1 - self.memory)

    def spectrum_N2_s(self, frequency_Hz: FloatArray) -> FloatArray:
        """Two-sided power spectral density at any frequency, N^2 s."""
        m = self.memory
        turn = 2 * np.pi * np.asarray(frequency_Hz, dtype=float) * self.hold_s
        sequence = (1 - m * m) / (1 - 2 * m * np.cos(turn) + m * m)
        shape: FloatArray = self.sd_N**2 * self.hold_s * np.sinc(turn / (2 * np.pi)) ** 2 * sequence
        return shape


#: The paper's white noise, with the bandwidth that its step of 0.1 s implies.
PAPER_DISTURBANCE = Disturbance(sd_N=0.015, hold_s=0.1)
