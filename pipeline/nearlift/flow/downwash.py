"""Downwash through a cut across the wake beneath each rotor, and its reduction against the control.

By default the cut is a line one rotor diameter below the rotor plane: that is the wake, not the
inflow at the disk. Far from boundaries the two are in proportion. They are not where the ground
turns the jet; a cut in that zone has a warning.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.flow.average import Average, correlation_time
from nearlift.flow.field import Scene, VelocityField, has_flipped_component
from nearlift.results import Estimate

#: Clearances below this many radii lie in the zone in which an impinging jet is turned (about one
#: jet diameter above the plate).
DEFLECTION_HAT = 2.0
#: Below a ceiling a cut further than this many radii beneath the disk measures the wake. By
#: momentum the wake keeps its speed at equal thrust while the inflow at the disk falls, so one says
#: nothing of the other.
WAKE_HAT = 0.5
#: A wake's speed may be this factor above or below that of the hovering vehicle (a quarter to full
#: throttle is a factor of 2.3).
SPEED_FACTOR = 10.0
#: A vehicle tilted by less than this is level.
LEVEL_RAD = 1e-4
#: Part of the span that must have vectors.
COVERED = 0.9
#: Part of the span that may lie in the measured stagnation zone.
STAGNANT = 0.1
WARNINGS = {
    "meets_boundary": "the cut meets the boundary",
    "deflection_zone": (
        "the cut is within one rotor diameter of the boundary, where the jet turns: it is not the"
        " inflow at the disk"
    ),
    "stagnation_zone": (
        "the cut passes through the stagnation zone: it is not the inflow at the disk"
    ),
    "wake": (
        "the cut is in the wake: below a ceiling its speed does not follow the inflow at the disk"
    ),
    "partly_covered": "a tenth or more of the cut has no vectors",
    "no_scatter": "one field: noise is unknown",
}
#: Warnings under which a cut does not measure the inflow at the disk.
NOT_AT_THE_DISK = ("meets_boundary", "deflection_zone", "stagnation_zone", "wake")


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """A cut: `below_m` under the rotor plane, `half_span_m` to both sides of each axis in
    `centres_m`, whose place is known to `u_position_m`.
    """

    below_m: float
    half_span_m: float
    centres_m: tuple[float, ...]
    u_position_m: float
    u_scale: float = 0.0

    def weights(self, x_m: FloatArray) -> FloatArray:
        """Share of the span that each node (nx,) represents; their sum is 1 if the grid holds
        it.
        """
        dx, total = x_m[1] - x_m[0], np.zeros(len(x_m))
        for centre in self.centres_m:
            low = np.maximum(x_m - dx / 2, centre - self.half_span_m)
            high = np.minimum(x_m + dx / 2, centre + self.half_span_m)
            total += np.maximum(high - low, 0.0)
        return np.asarray(total / (2 * self.half_span_m * len(self.centres_m)))

    def mean(self, field: VelocityField) -> tuple[float, float]:
        """Mean downwash over the span's part with vectors, and that part."""
        profile = along_cut(field.vy_m_s, field.y_m, self.below_m)
        weights, known = self.weights(field.x_m), np.isfinite(profile)
        covered = float(weights[known].sum())
        mean = float(weights[known] @ profile[known]) / covered if covered > 0 else math.nan
        return mean, covered

    def half_change(self, field: VelocityField, name: str, step: float) -> float:
        """Half the change of the downwash as `name` is changed by `step` both ways."""
        ways: list[Any] = [np.add(getattr(self, name), s) for s in (step, -step)]
        more, less = (replace(self, **{name: value}).mean(field)[0] for value in ways)
        return (more - less) / 2 if math.isfinite(more) and math.isfinite(less) else 0.0

    def clearance_m(self, scene: Scene) -> float:
        """Least distance from the cut's ends to the boundary; inf without one."""
        ends = np.array([c + s * self.half_span_m for c in self.centres_m for s in (-1, 1)])
        return float(scene.height_m(ends, np.full(len(ends), -self.below_m)).min())


@dataclass(frozen=True, slots=True, kw_only=True)
class CutDownwash:
    """Mean downwash through a cut, m/s, with its uncertainty by source.

    Attributes
    ----------
    value, u : float
        Mean over the span, positive against thrust; standard uncertainty, all parts together.
    u_noise, u_mask, u_position, u_scale : float
        From the scatter of fields, correlation in time included. From the part without vectors,
        the place of the cut and the velocity scale.
    span : float
        Signed change where the cut is longer by the uncertainty of its place; case and control
        share it.
    covered : float
        Part of the span with vectors.
    n_eff : float
        Independent fields behind `u_noise`.
    clearance_hat : float
        Least distance from cut to boundary over rotor radius; inf without a boundary.
    warnings : tuple of str
        Keys of `WARNINGS`.
    """

    value: float
    u: float
    u_noise: float
    u_mask: float
    u_position: float
    span: float
    u_scale: float
    covered: float
    n_eff: float
    clearance_hat: float
    warnings: tuple[str, ...]


def along_cut(vy: FloatArray, y_m: FloatArray, below_m: float) -> FloatArray:
    """Downwash (..., nx) of vy (..., ny, nx) at y = -below_m, linear between rows.

    It is nan outside the grid or next to a missing vector.
    """
    position = (-below_m - y_m[0]) / (y_m[1] - y_m[0])
    low = math.floor(position + 1e-9)
    if low < 0 or position > len(y_m) - 1 + 1e-9:
        return np.full((*vy.shape[:-2], vy.shape[-1]), np.nan)
    share = position - low
    if share < 1e-6 or low + 1 >= len(y_m):
        return -vy[..., low, :]
    return np.asarray(-(1 - share) * vy[..., low, :] - share * vy[..., low + 1, :])


def measure(
    average: Average,
    series: FloatArray,
    cut: Cut,
    scene: Scene,
    stagnant: NDArray[np.bool_] | None = None,
) -> CutDownwash:
    """Downwash through one cut of a mean field in vehicle axes.

    `series` (n, nx) is the downwash along it of each field, by `along_cut`; `stagnant` (ny, nx) is
    the measured stagnation zone.
    """
    mean = average.mean
    weights, (value, covered) = cut.weights(mean.x_m), cut.mean(mean)
    profile = along_cut(mean.vy_m_s, mean.y_m, cut.below_m)
    inside = np.isfinite(profile) & (weights > 0)
    u_noise, n_eff = _noise(series[:, inside] - profile[inside], weights[inside])
    below, aside, span = (
        cut.half_change(mean, name, cut.u_position_m)
        for name in ("below_m", "centres_m", "half_span_m")
    )
    u_position = math.hypot(below, aside)
    spread = float(np.std(profile[inside])) if covered > 0 else math.nan
    u_mask, u_scale = max(1 - covered, 0.0) * spread, cut.u_scale * abs(value)
    slow = 0.0
    if stagnant is not None:
        slow = float(weights @ stagnant[int(np.argmin(np.abs(mean.y_m + cut.below_m)))])
    clearance, ground = cut.clearance_m(scene) / scene.radius_m, scene.boundary == "ground"
    warnings = {
        "meets_boundary": ground and clearance <= 0,
        "deflection_zone": ground and 0 < clearance < DEFLECTION_HAT,
        "stagnation_zone": ground and slow > STAGNANT,
        "wake": scene.boundary == "ceiling" and cut.below_m > WAKE_HAT * scene.radius_m,
        "partly_covered": 0 < covered < COVERED,
        "no_scatter": covered > 0 and not math.isfinite(u_noise),
    }
    return CutDownwash(
        value=value,
        u=math.sqrt(sum(part**2 for part in (u_noise, u_mask, u_position, span, u_scale))),
        u_noise=u_noise,
        u_mask=u_mask,
        u_position=u_position,
        span=span,
        u_scale=u_scale,
        covered=covered,
        n_eff=n_eff,
        clearance_hat=clearance,
        warnings=tuple(name for name, holds in warnings.items() if holds),
    )


def _noise(away: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Standard error of the span's mean and the independent fields behind it, from the fields' (n,
    nodes) deviations from the mean profile.
    """
    n, nodes = away.shape
    if n < 2 or not nodes:
        return math.nan, float(nodes > 0)
    share = weights / weights.sum()
    # a vector that is missing in one field counts as that node's mean there, and the scatter is
    # that of those present
    present = np.isfinite(away)
    means = np.where(present, away, 0.0) @ share
    lifted = means / math.sqrt(max(float(np.mean(present @ share)), 1e-9))
    tau = correlation_time(lifted[:, None])
    return float(np.sqrt(np.var(lifted, ddof=1) * tau / n)), n / tau


def reduction(case: CutDownwash, control: CutDownwash) -> Estimate:
    """Relative loss of downwash of a case against its control.

    Intervals have the effective degrees of freedom of Welch and Satterthwaite.
    """
    from scipy.stats import t

    ratio = case.value / control.value
    parts = []
    for d in (case, control):
        noise = d.u_noise / d.value
        rest = math.hypot(d.u_mask, d.u_position) / d.value
        parts += [(ratio * noise, max(d.n_eff - 1, 1.0)), (ratio * rest, math.inf)]
    # a cut that is too long is so in both pictures
    parts.append((ratio * (case.span / case.value - control.span / control.value), math.inf))
    variance = sum(u**2 for u, _ in parts)
    if not math.isfinite(variance):
        return Estimate(value=1 - ratio, u=math.nan, lo90=math.nan, hi90=math.nan)
    small = sum(u**4 / dof for u, dof in parts if math.isfinite(dof))
    dof = variance**2 / small if small > 0 else math.inf
    return Estimate.around(1 - ratio, math.sqrt(variance), float(t.ppf(0.95, min(dof, 1e6))))


def wake_speed_m_s(
    mass_kg: float, gravity_m_s2: float, density_kg_m3: float, rotors: int, radius_m: float
) -> float:
    """Speed of the hovering vehicle's far wake by momentum theory, twice the induced velocity."""
    disk_N = 2 * density_kg_m3 * math.pi * radius_m**2
    return 2 * math.sqrt(mass_kg * gravity_m_s2 / rotors / disk_N)


def check_plausible(
    mean: VelocityField, scene: Scene, cut: Cut, expected_m_s: float, where: str
) -> None:
    """Raise `InputRefused`, with the key that corrects it, if the field is implausible."""
    refused, radius = partial(InputRefused, where), scene.radius_m
    through, covered = cut.mean(mean)
    clearance, grounded = cut.clearance_m(scene), scene.boundary == "ground"
    if covered == 0 and not (grounded and clearance <= 0):
        x0, x1, y0, y1 = (1e3 * v for v in (*mean.x_m[[0, -1]], *mean.y_m[[0, -1]]))
        raise refused(
            f"the cut {1e3 * cut.below_m:.4g} mm below the rotor plane has no vector; the field"
            f" spans x = {x0:.4g} to {x1:.4g} mm and y = {y0:.4g} to {y1:.4g} mm about the rotors'"
            " midpoint",
            "check origin, rotors, mask, thrust, and the unit of length (length_unit, scale)",
        )
    speed = float(np.nanpercentile(mean.speed_m_s, 99))
    ratio = speed / expected_m_s
    if not 1 / SPEED_FACTOR < ratio < SPEED_FACTOR:
        raise refused(
            f"its fastest air moves at {speed:.3g} m/s, {ratio:.2g} times the {expected_m_s:.3g}"
            " m/s of the hovering vehicle's wake",
            "check velocity_unit, scale and frame_time"
            + (" (mm/s written as m/s?)" if 300 < ratio < 3000 else ""),
        )
    turned = grounded and clearance < DEFLECTION_HAT * radius
    if covered and not turned and abs(through) < expected_m_s / SPEED_FACTOR:
        raise refused(
            f"air goes through the cut at {through:.3g} m/s, and at {speed:.3g} m/s elsewhere; the"
            f" hovering vehicle's wake has {expected_m_s:.3g} m/s",
            "are the two velocity components swapped? else check thrust, across, origin, rotors",
        )
    if has_flipped_component(mean):
        raise refused(
            "one component is flipped against its axis: it creates air out of nothing",
            "say v_sign = -1 under [piv], or turn thrust or across round",
        )
    y, height = mean.y_m[:, None], scene.height_m(mean.x_m[None, :], mean.y_m[:, None])
    wake = (y < -0.25 * radius) & (y > -1.5 * radius) & scene.beneath(mean.x_m, 0.7)[None, :]
    seen = wake & (height > 0.3 * radius) & mean.valid
    up = float(np.mean(mean.vy_m_s[seen])) if seen.sum() >= 6 else 0.0
    if up > 0:
        raise refused(
            f"air beneath the rotors moves along thrust, at {up:.3g} m/s",
            'turn `thrust` round ("+y" for "-y"), or say v_sign = -1 where the software counts v'
            " downwards",
        )
