"""Dimensionless groups of a flight, which alone decide crash rates: the paper's Eq. 6 and more.

Scales: length r, time sqrt(r/g), force m g, frequency hover_Hz. With K = rotors C_L rho r^4,
the paper's are

    alpha = kP r sqrt(K / (m g))             beta = kD sqrt(r g) sqrt(K / (m g))
    gamma = kI r sqrt(r/g) sqrt(K / (m g))   delta = f0 sqrt(K / (m g))

Left out there: the disturbance over weight, its hold and correlation time, step and duration, the
height of contact, motor lag, estimator delay, largest thrust, and (in L / L_inf) spacing over
radius and the bound on the ratio.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from nearlift.flight.simulation.control import Gains
from nearlift.flight.simulation.craft import Craft, Disturbance
from nearlift.results.serial import Unbounded


@dataclass(frozen=True, slots=True, kw_only=True)
class Groups:
    """Dimensionless groups of a flight. Gains carry the sign of Eq. 5; `delta` is 1 where f0
    balances the weight far from the boundary; the controller sees the state of `delay` ago, rotor
    frequency follows its command with time constant `motor_lag`, and `most_lift` is the largest
    lift far away over weight.
    """

    alpha: float
    beta: float
    gamma: float
    delta: float
    noise: float
    hold: float
    correlation: float
    duration: float
    contact: float = 0.0
    motor_lag: float = 0.0
    delay: float = 0.0
    most_lift: Unbounded = math.inf


def dimensionless(
    craft: Craft,
    gains: Gains,
    disturbance: Disturbance,
    duration_s: float,
    contact_z_hat: float = 0.0,
    delay_s: float = 0.0,
) -> Groups:
    """Groups of a vehicle, its controller and its gusts, with f0 of hover far away."""
    per_Hz = 1.0 / craft.hover_Hz
    r, t = craft.radius_m, craft.time_s
    return Groups(
        alpha=gains.kP * r * per_Hz,
        beta=gains.kD * r / t * per_Hz,
        gamma=gains.kI * r * t * per_Hz,
        delta=1.0,
        noise=disturbance.sd_N / craft.weight_N,
        hold=disturbance.hold_s / t,
        correlation=disturbance.correlation_s / t,
        duration=duration_s / t,
        contact=contact_z_hat,
        motor_lag=craft.motor_lag_s / t,
        delay=delay_s / t,
        most_lift=craft.most_lift_N / craft.weight_N,
    )


def gains_for(groups: Groups, craft: Craft) -> Gains:
    """Gains that give another vehicle (payload, size) the same alpha, beta and gamma."""
    r, t, f = craft.radius_m, craft.time_s, craft.hover_Hz
    return Gains(kP=groups.alpha * f / r, kD=groups.beta * f * t / r, kI=groups.gamma * f / (r * t))


def disturbance_for(groups: Groups, craft: Craft) -> Disturbance:
    """Disturbance that gives another vehicle the same noise, hold and correlation."""
    return Disturbance(
        sd_N=groups.noise * craft.weight_N,
        hold_s=groups.hold * craft.time_s,
        correlation_s=groups.correlation * craft.time_s,
    )
