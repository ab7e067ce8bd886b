"""Random vertical force with a given standard deviation, hold and correlation time.

The force is constant for `hold_s`, then drawn anew with an autocorrelation of exp(-hold_s /
correlation_s) (0: white). A standard deviation alone says nothing without a bandwidth: the paper's
0.015 N "white noise" is one value per step of 0.1 s, that is hold_s = 0.1, a two-sided power
spectral density of sd^2 hold = 2.25e-5 N^2 s at low frequency, with its first zero at 10 Hz. The
same sd drawn for every 0.01 s step has a tenth of it, and no vehicle crashes.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """Random vertical force: standard deviation in N, hold and correlation time in s (0: white)."""

    sd_N: float
    hold_s: float
    correlation_s: float = 0.0


#: The paper's white noise, held for its step of 0.1 s.
PAPER_DISTURBANCE = Disturbance(sd_N=0.015, hold_s=0.1)
