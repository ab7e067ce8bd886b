"""Roll torque and angular acceleration near a sidewall, from the lifts of near and far rotors.

Positive torque tips the vehicle towards the wall (the near rotors lose lift). Changes of lift are
fractions of each rotor's own share of the weight. The arm is the distance of a pair's axis from the
roll axis, half the ADJACENT spacing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.flight import Ratio
from nearlift.results.document import IfAny, Numbers, Real

#: Relative standard uncertainty of a stated inertia: uniform over 1.4e-5 to 1.7e-5 kg m^2, the
#: range of a Crazyflie's system identifications.
INERTIA_SPREAD = (1.7e-5 - 1.4e-5) / (1.7e-5 + 1.4e-5) / math.sqrt(3)
#: Least and largest gap, z_hat.
LEAST_GAP, FARTHEST_GAP = 0.01, 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RollTorque:
    """Torque over the gap with its 90 % interval, arrays (n,), and the angular acceleration at the
    least gap where the inertia is known.
    """

    torque_N_m: Numbers
    lo90_N_m: Numbers
    hi90_N_m: Numbers
    acceleration_deg_s2: IfAny[float] = None
    lo90_deg_s2: IfAny[float] = None
    hi90_deg_s2: IfAny[float] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Roll:
    """Roll torque by the campaign's fitted sidewall model over `z_hat`, the gap of the nearest tip.

    It is given under two assumptions: no change of the far pair's lift, or the same law for both
    pairs. The inertia is the manifest's, `u_inertia` its relative standard uncertainty, assumed.
    """

    arm_m: Real
    z_hat: Numbers
    inertia_kg_m2: float | None
    u_inertia: Real
    near_pair_only: RollTorque
    same_law: RollTorque


def roll_beside_wall(
    ratios: Sequence[Ratio],
    nearest_z_hat: float,
    *,
    weight_N: float,
    arm_m: float,
    spacing_hat: float,
    inertia_kg_m2: float | None,
    rng: np.random.Generator,
) -> Roll:
    """Roll torque over the gap with 90 % intervals, from best estimate and draws of L / L_inf.

    The measured ratio is that of the whole vehicle over the gap of its nearest tip. If the near
    pair alone loses lift, it loses twice the vehicle's fraction: the upper value. The lower has
    both pairs follow one law of their own gaps, the far pair's larger by the spacing. Both are
    given, since lift alone cannot distinguish them.

    Without an inertia in the manifest the torque alone is given, since inertia depends on the
    batteries and does not follow from mass. Its relative standard uncertainty `INERTIA_SPREAD`
    (log-normal) is included in the interval of the acceleration.
    """
    z_hat = np.geomspace(max(nearest_z_hat, LEAST_GAP), FARTHEST_GAP, 40)
    loss, far = (
        np.stack([1.0 - ratio(z) for ratio in ratios]) for z in (z_hat, z_hat + spacing_hat)
    )
    # each pair's share by the same law, scaled so that together they lose what the vehicle does
    both = loss + far
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(both != 0, 2.0 * loss * (loss - far) / both, 0.0)
    factor = np.exp(INERTIA_SPREAD * rng.standard_normal(len(loss) - 1))

    def rolled(lost: FloatArray) -> RollTorque:
        torque = weight_N / 2 * arm_m * lost
        low, high = np.percentile(torque[1:], [5, 95], axis=0)
        moment = RollTorque(torque_N_m=torque[0], lo90_N_m=low, hi90_N_m=high)
        if inertia_kg_m2 is None:
            return moment
        turning = math.degrees(1.0 / inertia_kg_m2) * torque[:, 0]
        slow, fast = np.percentile(turning[1:] / factor, [5, 95]).tolist()
        at = {"acceleration_deg_s2": float(turning[0]), "lo90_deg_s2": slow, "hi90_deg_s2": fast}
        return replace(moment, **at)

    return Roll(
        arm_m=arm_m,
        z_hat=z_hat,
        inertia_kg_m2=inertia_kg_m2,
        u_inertia=INERTIA_SPREAD,
        near_pair_only=rolled(2.0 * loss),
        same_law=rolled(share),
    )
