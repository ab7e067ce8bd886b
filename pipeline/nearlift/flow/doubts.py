"""Mean fields that cannot be true: flow along thrust, one component flipped, speeds far from a
hovering wake's, a cut outside the picture.
"""

from __future__ import annotations

import math

import numpy as np

from nearlift.errors import InputRefused
from nearlift.flow.downwash import DEFLECTION_HAT, Cut, along_cut, over_span, span_weights
from nearlift.flow.field import VelocityField, has_flipped_component, is_transposed
from nearlift.flow.scene import Scene

#: A wake's speed may be this factor above or below that of the hovering vehicle (a quarter to full
#: throttle is a factor of 2.3).
FACTOR = 10.0


def wake_speed_m_s(
    mass_kg: float, gravity_m_s2: float, density_kg_m3: float, rotors: int, radius_m: float
) -> float:
    """Speed of the hovering vehicle's far wake by momentum theory, twice the induced velocity."""
    return 2 * math.sqrt(
        mass_kg * gravity_m_s2 / rotors / (2 * density_kg_m3 * math.pi * radius_m**2)
    )


def check_plausible(
    mean: VelocityField, scene: Scene, cut: Cut, expected_m_s: float, where: str
) -> None:
    """Raise `InputRefused`, with the key that corrects it, if the field is implausible."""
    x0, x1, y0, y1 = (1e3 * v for v in (mean.x_m[0], mean.x_m[-1], mean.y_m[0], mean.y_m[-1]))
    spans = (
        f"the field spans x = {x0:.4g} to {x1:.4g} mm and y = {y0:.4g} to {y1:.4g} mm about the"
        " rotors' midpoint"
    )
    through, covered = over_span(
        along_cut(mean.vy_m_s, mean.y_m, cut.below_m),
        span_weights(mean.x_m, cut.centres_m, cut.half_span_m),
    )
    ends = np.array([c + s * cut.half_span_m for c in cut.centres_m for s in (-1, 1)])
    clearance = float(scene.height_m(ends, np.full(len(ends), -cut.below_m)).min())
    grounded = scene.boundary == "ground"
    if covered == 0 and not (grounded and clearance <= 0):
        raise InputRefused(
            where,
            f"the cut {1e3 * cut.below_m:.4g} mm below the rotor plane has no vector; {spans}",
            "check origin, rotors, mask, thrust, and the unit of length (length_unit, scale)",
        )
    speed = float(np.nanpercentile(mean.speed_m_s, 99))
    if not expected_m_s / FACTOR < speed < expected_m_s * FACTOR:
        ratio = speed / expected_m_s
        raise InputRefused(
            where,
            f"its fastest air moves at {speed:.3g} m/s, {ratio:.2g} times the {expected_m_s:.3g}"
            " m/s of the hovering vehicle's wake",
            "check velocity_unit, scale and frame_time"
            + (" (mm/s written as m/s?)" if 300 < ratio < 3000 else ""),
        )
    turned = grounded and clearance < DEFLECTION_HAT * scene.radius_m
    if covered and not turned and abs(through) < expected_m_s / FACTOR:
        raise InputRefused(
            where,
            f"air goes through the cut at {through:.3g} m/s, and at {speed:.3g} m/s elsewhere; the"
            f" hovering vehicle's wake has {expected_m_s:.3g} m/s",
            "are the two velocity components swapped? else check thrust, across, origin, rotors",
        )
    if is_transposed(mean):
        raise InputRefused(
            where,
            "mass is conserved only with x and y in each other's place",
            "the columns of the two coordinates are swapped; correct their names",
        )
    if has_flipped_component(mean):
        raise InputRefused(
            where,
            "one component is flipped against its axis: it creates air out of nothing",
            "say v_sign = -1 under [piv], or turn thrust or across round",
        )
    wake = (
        (mean.y_m[:, None] < -0.25 * scene.radius_m)
        & (mean.y_m[:, None] > -1.5 * scene.radius_m)
        & scene.beneath(mean.x_m, 0.7)[None, :]
    )
    above_boundary = scene.height_m(mean.x_m[None, :], mean.y_m[:, None]) > 0.3 * scene.radius_m
    seen = wake & above_boundary & mean.valid
    if seen.sum() >= 6 and float(np.mean(mean.vy_m_s[seen])) > 0:
        raise InputRefused(
            where,
            "air beneath the rotors moves along thrust, at"
            f" {float(np.mean(mean.vy_m_s[seen])):.3g} m/s",
            'turn `thrust` round ("+y" for "-y"), or say v_sign = -1 where the software counts v'
            " downwards",
        )
