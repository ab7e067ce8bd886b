"""Rotorcraft in vertical flight, its PID controller and gusts, and their dimensionless groups.

The controller of rotor frequency is f = max(0, kP (z - z0) + kD z' + kI integral(z - z0) + f0).
Here z is the distance to the boundary. Above a ground the gains are negative: a vehicle that is too
low (z < z0) must turn its rotors faster. Below a ceiling it must slow them: gains are positive.
The paper prints positive gains for both, with which the loop above a ground is unstable.

Crash rates depend on the groups alone. Their scales are length r, time sqrt(r/g), force m g and
frequency hover_Hz. With K = rotors C_L rho r^4, the paper's four (Eq. 6) are

    alpha = kP r sqrt(K / (m g))             beta = kD sqrt(r g) sqrt(K / (m g))
    gamma = kI r sqrt(r/g) sqrt(K / (m g))   delta = f0 sqrt(K / (m g))

Eq. 6 leaves out the disturbance over weight, its hold and correlation time, step and duration. It
also leaves out the height of contact and the largest thrust.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nearlift.declare import Boundary
from nearlift.errors import ManifestError
from nearlift.results.document import Unbounded

#: Direction of lift along z: away from a ground, towards a ceiling.
LIFT_SIGN: dict[Boundary, float] = {"ground": 1.0, "ceiling": -1.0}
#: Largest real part of a stable pole, 1/s: rounding of the pole at zero of an unused integrator.
POLE_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Craft:
    """A rotorcraft that only goes up and down: L = rotors C_L rho f^2 r^4 far from every boundary,
    f in revolutions per second.

    The paper's C_L = 1.6 makes a Crazyflie hover at 351 Hz; its measured hover is at 278 Hz (C_L =
    2.55). No crash depends on it: C_L enters Eq. 6 only through the groups, and the gains were
    chosen with it. Lift far away never exceeds `most_lift_N`; the paper's vehicle has no limit.
    """

    radius_m: float
    mass_kg: float
    gravity_m_s2: float
    density_kg_m3: float
    C_L: float
    rotors: int = 4
    most_lift_N: float = math.inf

    @property
    def weight_N(self) -> float:
        """Weight."""
        return self.mass_kg * self.gravity_m_s2

    @property
    def hover_Hz(self) -> float:
        """Rotor frequency at which lift far away is the weight."""
        lift_per_f2 = self.rotors * self.C_L * self.density_kg_m3 * self.radius_m**4
        return math.sqrt(self.weight_N / lift_per_f2)

    @property
    def time_s(self) -> float:
        """Time scale of Eq. 6, sqrt(r / g)."""
        return math.sqrt(self.radius_m / self.gravity_m_s2)


@dataclass(frozen=True, slots=True, kw_only=True)
class Disturbance:
    """Random vertical force: standard deviation in N, hold and correlation time in s.

    The force is constant for `hold_s`, then drawn again with an autocorrelation of exp(-hold_s /
    correlation_s) (0: white). A standard deviation is incomplete without a bandwidth. The paper's
    0.015 N "white noise" is one value per step of 0.1 s, that is hold_s = 0.1. Its two-sided power
    spectral density at low frequency is sd^2 hold = 2.25e-5 N^2 s, with its first zero at 10 Hz.
    The same sd drawn for every 0.01 s step has a tenth of it, and no vehicle crashes.
    """

    sd_N: float
    hold_s: float
    correlation_s: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Gains:
    """kP in 1/(m s), kD in 1/m, kI in 1/(m s^2), with the signs of Eq. 5."""

    kP: float
    kD: float
    kI: float

    def poles(self, craft: Craft, boundary: Boundary) -> np.ndarray:
        """Complex poles (3,), in 1/s, of the loop linearised about hover far from the boundary."""
        # s^3 = sign * 2 g / f0 * (kD s^2 + kP s + kI)
        stiffness = LIFT_SIGN[boundary] * 2.0 * craft.gravity_m_s2 / craft.hover_Hz
        return np.roots([1.0, -stiffness * self.kD, -stiffness * self.kP, -stiffness * self.kI])

    def refuse_unstable(self, craft: Craft, boundary: Boundary) -> None:
        """Raise `ManifestError` if the loop is unstable without a boundary, or kP or kD is zero."""
        worst = float(self.poles(craft, boundary).real.max())
        if worst > POLE_ROUNDING or self.kP == 0.0 or self.kD == 0.0:
            raise ManifestError(
                f"simulate.gains.{boundary}",
                f"kP = {self.kP:g}, kD = {self.kD:g}, kI = {self.kI:g} do not bring the vehicle"
                f" back to its set-point (a pole at {worst:+.3g} 1/s)",
                "kP, kD and kI must be negative above a ground and positive below a ceiling; kP kD"
                " must be large enough for kI",
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Groups:
    """Dimensionless groups of a flight.

    Gains carry the sign of Eq. 5; `delta` is 1 where f0 balances the weight far from the boundary.
    `most_lift` is the largest lift far away over weight.
    """

    alpha: float
    beta: float
    gamma: float
    delta: float = 1.0
    noise: float
    hold: float
    correlation: float
    duration: float
    contact: float = 0.0
    most_lift: Unbounded = math.inf

    @classmethod
    def scaled(
        cls,
        craft: Craft,
        gains: Gains,
        gusts: Disturbance,
        duration_s: float,
        contact_z_hat: float = 0.0,
    ) -> Groups:
        """Groups of a vehicle, its controller and its gusts, with f0 of hover far away."""
        r, t, f = craft.radius_m, craft.time_s, craft.hover_Hz
        return cls(
            alpha=gains.kP * r / f,
            beta=gains.kD * r / t / f,
            gamma=gains.kI * r * t / f,
            noise=gusts.sd_N / craft.weight_N,
            hold=gusts.hold_s / t,
            correlation=gusts.correlation_s / t,
            duration=duration_s / t,
            contact=contact_z_hat,
            most_lift=craft.most_lift_N / craft.weight_N,
        )

    def gains(self, craft: Craft) -> Gains:
        """Gains that give another vehicle (payload, size) the same alpha, beta and gamma."""
        r, t, f = craft.radius_m, craft.time_s, craft.hover_Hz
        return Gains(kP=self.alpha * f / r, kD=self.beta * f * t / r, kI=self.gamma * f / (r * t))

    def disturbance(self, craft: Craft) -> Disturbance:
        """Disturbance that gives another vehicle the same noise, hold and correlation."""
        return Disturbance(
            sd_N=self.noise * craft.weight_N,
            hold_s=self.hold * craft.time_s,
            correlation_s=self.correlation * craft.time_s,
        )
