"""Roll torque and angular acceleration near a sidewall, from the difference of lift between the
near and the far rotors.

Positive torque tips the vehicle towards the wall (the near rotors lose lift). Changes of lift are
fractions of each rotor's own share of the weight; the arm is the distance of a pair's axis from the
roll axis, half the ADJACENT spacing.

The paper's 0.2 N mm is 3 % of one pair's lift at 45 mm (0.18 N mm); 3 % of the whole weight would
be 0.36 N mm, and with the true arm of 32.5 mm it is 0.13 N mm. Its 400 deg/s^2 holds for its
inertia of 2 to 3e-5 kg m^2; measured ones are 1.4 to 1.7e-5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.flight import Ratio
from nearlift.results.serial import optional

#: Roll inertia of a Crazyflie, kg m^2: lowest and highest of its system identifications.
MEASURED_INERTIA = (1.4e-5, 1.7e-5)
#: Relative standard uncertainty of an inertia declared without one: uniform over that range.
INERTIA_SPREAD = (
    (MEASURED_INERTIA[1] - MEASURED_INERTIA[0])
    / (MEASURED_INERTIA[1] + MEASURED_INERTIA[0])
    / math.sqrt(3)
)


def acceleration_deg_s2(torque: float, inertia_kg_m2: float) -> float:
    """Angular acceleration in degrees per second squared."""
    return math.degrees(torque / inertia_kg_m2)


@dataclass(frozen=True, slots=True, kw_only=True)
class RollReading:
    """Torque and acceleration by one interpretation of the paper's statement."""

    assumption: str
    arm_m: float
    inertia_lo_kg_m2: float
    inertia_hi_kg_m2: float
    torque_N_m: float
    acceleration_lo_deg_s2: float
    acceleration_hi_deg_s2: float


def reading(
    assumption: str, difference: float, arm_m: float, inertia: tuple[float, float]
) -> RollReading:
    """Torque and range of acceleration when the near pair of the paper's vehicle (27 g, 9.8 m/s^2)
    loses the fraction `difference` of its lift, half the weight.
    """
    torque = difference * 0.027 * 9.8 / 2 * arm_m
    return RollReading(
        assumption=assumption,
        arm_m=arm_m,
        inertia_lo_kg_m2=inertia[0],
        inertia_hi_kg_m2=inertia[1],
        torque_N_m=torque,
        acceleration_lo_deg_s2=acceleration_deg_s2(torque, inertia[1]),
        acceleration_hi_deg_s2=acceleration_deg_s2(torque, inertia[0]),
    )


PAPER_READINGS = (
    reading(
        "as the paper's numbers come out: 3 % of the near pair, arm 45 mm, its inertia",
        0.03,
        0.045,
        (2e-5, 3e-5),
    ),
    reading("3 % of the whole lift, arm 45 mm, its inertia", 0.06, 0.045, (2e-5, 3e-5)),
    reading("3 % of the near pair, true arm 32.5 mm, its inertia", 0.03, 0.0325, (2e-5, 3e-5)),
    reading(
        "3 % of the near pair, true arm 32.5 mm, measured inertia", 0.03, 0.0325, MEASURED_INERTIA
    ),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class RollTorque:
    """Torque over the gap with its 90 % interval, arrays (n,), and the angular acceleration at the
    least gap where the inertia is known.
    """

    torque_N_m: FloatArray
    lo90_N_m: FloatArray
    hi90_N_m: FloatArray
    acceleration_deg_s2: float | None = optional()
    lo90_deg_s2: float | None = optional()
    hi90_deg_s2: float | None = optional()


@dataclass(frozen=True, slots=True, kw_only=True)
class FittedRoll:
    """Roll torque by the campaign's fitted sidewall model over `z_hat`, the gap of the nearest tip,
    under two assumptions: no change of the far pair's lift, or the same law for both pairs. The
    inertia is the manifest's, `u_inertia` its relative standard uncertainty.
    """

    arm_m: float
    z_hat: FloatArray
    inertia_kg_m2: float | None
    u_inertia: float
    near_pair_only: RollTorque
    same_law: RollTorque


@dataclass(frozen=True, slots=True, kw_only=True)
class RollResult:
    """Effect of a sidewall's differential lift, by the paper's numbers and by the fit, if any."""

    paper: tuple[RollReading, ...] = PAPER_READINGS
    fitted: FittedRoll | None = optional()


def fitted_roll(
    ratios: Sequence[Ratio],
    nearest_z_hat: float,
    *,
    weight_N: float,
    arm_m: float,
    spacing_hat: float,
    inertia_kg_m2: float | None,
    u_inertia: float | None,
    rng: np.random.Generator,
) -> FittedRoll:
    """Roll torque over the gap with 90 % intervals, from best estimate and draws of L / L_inf.

    The measured ratio is that of the whole vehicle over the gap of its nearest tip. If the near
    pair alone loses lift, it loses twice the vehicle's fraction: the upper value. The lower has
    both pairs follow one law of their own gaps, the far pair's larger by the spacing. Both are
    given, since lift alone cannot tell them apart.

    Without an inertia in the manifest the torque alone is given, since inertia depends on the
    batteries and does not follow from mass. `u_inertia` is its relative standard uncertainty
    (log-normal; `INERTIA_SPREAD` if None), included in the interval of the acceleration.
    """
    u_inertia = INERTIA_SPREAD if u_inertia is None else u_inertia
    z_hat = np.geomspace(max(nearest_z_hat, 0.01), 2.0, 40)
    loss, far = (
        np.stack([1.0 - ratio(z) for ratio in ratios]) for z in (z_hat, z_hat + spacing_hat)
    )
    # each pair's share by the same law, scaled so that together they lose what the vehicle does
    both = loss + far
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(both != 0, 2.0 * loss * (loss - far) / both, 0.0)
    whole = weight_N / 2 * arm_m
    factor = np.exp(u_inertia * rng.standard_normal(len(loss) - 1))
    near_pair_only, same_law = (
        _torque(torque, inertia_kg_m2, factor) for torque in (whole * 2.0 * loss, whole * share)
    )
    return FittedRoll(
        arm_m=arm_m,
        z_hat=z_hat,
        inertia_kg_m2=inertia_kg_m2,
        u_inertia=u_inertia,
        near_pair_only=near_pair_only,
        same_law=same_law,
    )


def _torque(torque: FloatArray, inertia_kg_m2: float | None, factor: FloatArray) -> RollTorque:
    low, high = np.percentile(torque[1:], [5, 95], axis=0)
    interval = RollTorque(torque_N_m=torque[0], lo90_N_m=low, hi90_N_m=high)
    if inertia_kg_m2 is None:
        return interval
    scale = acceleration_deg_s2(1.0, inertia_kg_m2)
    slow, fast = np.percentile(scale * torque[1:, 0] / factor, [5, 95])
    return replace(
        interval,
        acceleration_deg_s2=scale * torque[0, 0],
        lo90_deg_s2=float(slow),
        hi90_deg_s2=float(fast),
    )
