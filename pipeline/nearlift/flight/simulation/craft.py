"""Rotorcraft in vertical flight and the gusts that push it: blade-element lift, weight, force, and
scales of the paper's Eq. 6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Craft:
    """A rotorcraft that only goes up and down: L = rotors C_L rho f^2 r^4 far from every boundary,
    f in revolutions per second.

    The paper's C_L = 1.6 makes a Crazyflie hover at 351 Hz; its measured hover is at 278 Hz (C_L =
    2.55). No crash depends on it: C_L enters Eq. 6 only through the groups, and the gains were
    chosen with it. Thrust follows the command with time constant `motor_lag_s`, and lift far away
    never exceeds `most_lift_N`; the paper's vehicle has neither.
    """

    radius_m: float
    mass_kg: float
    gravity_m_s2: float
    density_kg_m3: float
    C_L: float
    rotors: int = 4
    motor_lag_s: float = 0.0
    most_lift_N: float = math.inf

    @property
    def weight_N(self) -> float:
        """Weight."""
        return self.mass_kg * self.gravity_m_s2

    @property
    def lift_per_f2(self) -> float:
        """L / f^2 far away, N s^2."""
        return self.rotors * self.C_L * self.density_kg_m3 * self.radius_m**4

    @property
    def hover_Hz(self) -> float:
        """Rotor frequency at which lift far away is the weight."""
        return math.sqrt(self.weight_N / self.lift_per_f2)

    @property
    def time_s(self) -> float:
        """Time scale of Eq. 6, sqrt(r / g)."""
        return math.sqrt(self.radius_m / self.gravity_m_s2)


#: The vehicle of the paper's simulation.
CRAZYFLIE_AS_PRINTED = Craft(
    radius_m=0.023, mass_kg=0.027, gravity_m_s2=9.8, density_kg_m3=1.2, C_L=1.6
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """Random vertical force: standard deviation in N, hold and correlation time in s.

    The force is constant for `hold_s`, then drawn anew with an autocorrelation of exp(-hold_s /
    correlation_s) (0: white). A standard deviation alone says nothing without a bandwidth: the
    paper's 0.015 N "white noise" is one value per step of 0.1 s, that is hold_s = 0.1, a two-sided
    power spectral density of sd^2 hold = 2.25e-5 N^2 s at low frequency, with its first zero at
    10 Hz. The same sd drawn for every 0.01 s step has a tenth of it, and no vehicle crashes.
    """

    sd_N: float
    hold_s: float
    correlation_s: float = 0.0


#: The paper's white noise, held for its step of 0.1 s.
PAPER_DISTURBANCE = Disturbance(sd_N=0.015, hold_s=0.1)
