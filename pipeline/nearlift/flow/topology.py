"""The wake between rotors and ground as numbers: vortices, stagnation zone, the angle at which jets
split, left and right.

A vortex is a core where Gamma_2 (Graftieaux, Michard and Grosjean 2001) exceeds 2/pi in size: there
rotation outweighs strain. It looks at directions over a window, not at derivatives, and is unmoved
by a uniform stream. So is a jet that merely bends; what is counted is a standing vortex, about
which the mean flow itself turns: Gamma_1, which sees the stream, must be large there too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.flow.field import VelocityField
from nearlift.flow.scene import Scene

CORE = 2 / math.pi
#: Least |Gamma_1| within the core of a standing vortex.
STANDING = 0.5
#: Radius of Gamma_2's window over rotor radius, and the least grid spacings it may be.
WINDOW_HAT, WINDOW_NODES = 0.4, 2.0
#: A vortex has at least this area over r^2 and this circulation over U r.
LEAST_AREA, LEAST_CIRCULATION = 0.03, 0.03
#: Air slower than this over the control's downwash is stagnant.
SLOW = 0.3
#: The zone beneath an axis reaches so many radii to either side: 0.85 of a fully contracted wake's
#: half-width, 1/sqrt(2) by momentum theory, the rest being its shear layer.
CORE_HAT = 0.85 / math.sqrt(2)
#: Vortices are looked for so many radii beyond the outermost axes: to the edge of the disks.
DISK_HAT = 1.0
#: A stream counts for the split angle where it is at least this fast.
FAST = 0.4


@dataclass(frozen=True, slots=True, kw_only=True)
class Vortex:
    """A vortex core: centre in vehicle axes, circulation (counter-clockwise positive) and area."""

    x_m: float
    y_m: float
    circulation_m2_s: float
    area_m2: float


@dataclass(frozen=True, slots=True, kw_only=True)
class WakeTopology:
    """One mean field in numbers; lengths over rotor radius, areas over its square.

    Attributes
    ----------
    vortices : tuple of Vortex
    stagnant : (ny, nx) bool
        The stagnation zone.
    numbers : dict of str to float
        `vortices_ccw`, `vortices_cw`, `vortex_pairs`, `stagnation_area_hat2`,
        `stagnation_height_hat`, `split_angle_deg`, `asymmetry`.
    """

    vortices: tuple[Vortex, ...]
    stagnant: NDArray[np.bool_]
    numbers: dict[str, float]


QUANTITIES = (
    "vortices_ccw",
    "vortices_cw",
    "vortex_pairs",
    "stagnation_area_hat2",
    "stagnation_height_hat",
    "split_angle_deg",
    "asymmetry",
)


def gamma(field: VelocityField, radius_m: float, *, moving: bool = True) -> FloatArray:
    """Mean sine of the angle between a neighbour's direction and its velocity, (ny, nx): Gamma_2,
    or Gamma_1 if not `moving`.

    Gamma_2 takes velocities less the neighbourhood's mean. Neighbours lie within `radius_m`; nan
    where fewer than half of them, or the node itself, have vectors.
    """
    dx, dy = field.dx_m, field.dy_m
    reach_x, reach_y = int(radius_m / dx + 1e-9), int(radius_m / dy + 1e-9)
    offsets = [
        (j, i)
        for j in range(-reach_y, reach_y + 1)
        for i in range(-reach_x, reach_x + 1)
        if (i * dx) ** 2 + (j * dy) ** 2 <= radius_m**2 * (1 + 1e-9) and (i, j) != (0, 0)
    ]
    ny, nx = field.shape
    pad = ((reach_y, reach_y), (reach_x, reach_x))
    known = np.pad(field.valid, pad)
    vx, vy = (np.pad(np.where(field.valid, v, 0.0), pad) for v in (field.vx_m_s, field.vy_m_s))

    def shifted(a: NDArray[Any], j: int, i: int) -> NDArray[Any]:
        return a[reach_y + j : reach_y + j + ny, reach_x + i : reach_x + i + nx]

    count = (
        sum((shifted(known, j, i).astype(float) for j, i in offsets), np.zeros((ny, nx)))
        + field.valid
    )
    safe = np.maximum(count, 1)
    mean_x = (
        sum((shifted(vx, j, i) for j, i in offsets), np.zeros((ny, nx))) + shifted(vx, 0, 0)
    ) / safe
    mean_y = (
        sum((shifted(vy, j, i) for j, i in offsets), np.zeros((ny, nx))) + shifted(vy, 0, 0)
    ) / safe
    total = np.zeros((ny, nx))
    for j, i in offsets:
        px, py = i * dx, j * dy
        ux, uy = shifted(vx, j, i) - moving * mean_x, shifted(vy, j, i) - moving * mean_y
        size = np.hypot(ux, uy) * math.hypot(px, py)
        with np.errstate(invalid="ignore", divide="ignore"):
            sine = np.where(size > 0, (px * uy - py * ux) / size, 0.0)
        total += np.where(shifted(known, j, i), sine, 0.0)
    enough = field.valid & (count - 1 >= 0.5 * len(offsets))
    result: FloatArray = np.where(enough, total / np.maximum(count - 1, 1), np.nan)
    return result


def vortices(field: VelocityField, scene: Scene, reference_m_s: float) -> tuple[Vortex, ...]:
    """Vortex cores between rotor plane and ground, from left to right."""
    from scipy.ndimage import label

    radius = max(WINDOW_HAT * scene.radius_m, WINDOW_NODES * max(field.dx_m, field.dy_m))
    turning, still = np.nan_to_num(gamma(field, radius)), None
    xx, yy = np.meshgrid(field.x_m, field.y_m)
    height = scene.height_m(xx, yy)
    outer = max(abs(c) for c in scene.rotors_m) + DISK_HAT * scene.radius_m
    where = (yy < -0.25 * scene.radius_m) & (height > 0.5 * radius) & (np.abs(xx) <= outer)
    curl = np.gradient(field.vy_m_s, field.dx_m, axis=1) - np.gradient(
        field.vx_m_s, field.dy_m, axis=0
    )
    cell = field.dx_m * field.dy_m
    found = []
    for sign in (1.0, -1.0):
        labels, n = label(where & (sign * turning > CORE))
        for k in range(1, n + 1):
            core = labels == k
            area = float(core.sum() * cell)
            circulation = float(np.nansum(curl[core]) * cell)
            if (
                area < LEAST_AREA * scene.radius_m**2
                or sign * circulation < LEAST_CIRCULATION * reference_m_s * scene.radius_m
            ):
                continue
            if still is None:
                still = np.nan_to_num(gamma(field, radius, moving=False))
            if float(np.max(sign * still[core])) < STANDING:
                continue
            weight = np.maximum(sign * still[core], 0.0) ** 4
            found.append(
                Vortex(
                    x_m=float(np.average(xx[core], weights=weight)),
                    y_m=float(np.average(yy[core], weights=weight)),
                    circulation_m2_s=circulation,
                    area_m2=area,
                )
            )
    return tuple(sorted(found, key=lambda v: (v.x_m, v.y_m)))


@dataclass(frozen=True, slots=True, kw_only=True)
class StagnationZone:
    """Slow air that rests on the ground beneath the contracted wakes.

    Attributes
    ----------
    nodes : (ny, nx) bool
        Nodes within it.
    top_m : (nx,)
        Extent along y above the ground of each column of nodes; 0 where there is none.
    """

    nodes: NDArray[np.bool_]
    top_m: FloatArray


def stagnation(field: VelocityField, scene: Scene, reference_m_s: float) -> StagnationZone:
    """The stagnation zone. A column's extent is from the ground, however high the picture ends
    above it, to where the speed, linear between nodes, passes `SLOW` of the reference: so it does
    not depend on where the grid's nodes happen to stand.

    Only what lies beneath `CORE_HAT` radii of an axis counts: air beside a contracted wake is slow
    all the way up, and stagnates nowhere.
    """
    _, yy = np.meshgrid(field.x_m, field.y_m)
    ground = scene.boundary_y_m(field.x_m)
    threshold = SLOW * reference_m_s
    speed = np.where(field.valid & (yy > ground) & (yy < 0), field.speed_m_s, np.nan)
    top = np.zeros(len(field.x_m))
    for i in np.flatnonzero(scene.column_shares(field.x_m, CORE_HAT) > 0):
        seen = np.flatnonzero(np.isfinite(speed[:, i]))
        if not len(seen) or speed[seen[0], i] >= threshold:
            continue
        fast = np.flatnonzero(speed[seen, i] >= threshold)
        if len(fast):
            low, high = seen[fast[0] - 1], seen[fast[0]]
            share = (threshold - speed[low, i]) / (speed[high, i] - speed[low, i])
            crossing = field.y_m[low] + share * (field.y_m[high] - field.y_m[low])
        else:
            crossing = field.y_m[seen[-1]]
        top[i] = crossing - ground[i]
    return StagnationZone(nodes=np.isfinite(speed) & (yy < ground + top), top_m=top)


def split_angle_deg(
    field: VelocityField, scene: Scene, zone: StagnationZone, reference_m_s: float
) -> float:
    """Angle between the two streams into which a rotor's jet parts, mean over rotors: 180 along the
    ground; nan where no air stagnates between them, since nothing splits there, or if unseen.
    """
    xx, yy = np.meshgrid(field.x_m, field.y_m)
    height = scene.height_m(xx, yy)
    found = []
    for centre in scene.rotors_m:
        beneath = np.abs(field.x_m - centre) <= CORE_HAT * scene.radius_m
        if not zone.top_m[beneath].any():
            continue
        near = (
            (np.abs(xx - centre) <= 2 * scene.radius_m)
            & (yy < -0.5 * scene.radius_m)
            & (height > 0)
            & (height < 2 * scene.radius_m)
        )
        fast = near & field.valid & (np.nan_to_num(field.speed_m_s) > FAST * reference_m_s)
        angles = []
        for side in (-1, 1):
            stream = fast & (side * np.nan_to_num(field.vx_m_s) > 0) & (side * (xx - centre) > 0)
            if stream.sum() < 3:
                break
            flux = field.speed_m_s[stream]
            angles.append(
                math.atan2(
                    side * float(flux @ field.vx_m_s[stream]), -float(flux @ field.vy_m_s[stream])
                )
            )
        if len(angles) == 2:
            found.append(math.degrees(sum(angles)))
    return float(np.mean(found)) if found else math.nan


def asymmetry(field: VelocityField, scene: Scene) -> float:
    """(Right-going less left-going momentum) over both, beneath the rotor plane: +1 all to the
    right.
    """
    xx, yy = np.meshgrid(field.x_m, field.y_m)
    half = min(-field.x_m[0], field.x_m[-1])
    # as much of the left as of the right
    below = (yy < 0) & (scene.height_m(xx, yy) > 0) & (np.abs(xx) <= half) & field.valid
    vx = np.where(below, field.vx_m_s, 0.0)
    total = float((vx**2).sum())
    return float((vx * np.abs(vx)).sum()) / total if total > 0 else math.nan


def wake_topology(field: VelocityField, scene: Scene, reference_m_s: float) -> WakeTopology:
    """Everything above for one mean field near a ground."""
    cores = vortices(field, scene, reference_m_s)
    zone = stagnation(field, scene, reference_m_s)
    r = scene.radius_m
    ccw, cw = (float(sum(s * v.circulation_m2_s > 0 for v in cores)) for s in (1, -1))
    numbers = {
        "vortices_ccw": ccw,
        "vortices_cw": cw,
        "vortex_pairs": min(ccw, cw),
        "stagnation_area_hat2": float(zone.top_m @ scene.column_shares(field.x_m, CORE_HAT))
        * field.dx_m
        / r**2,
        "stagnation_height_hat": float(zone.top_m.max()) * math.cos(scene.tilt_rad) / r,
        "split_angle_deg": split_angle_deg(field, scene, zone, reference_m_s),
        "asymmetry": asymmetry(field, scene),
    }
    return WakeTopology(vortices=cores, stagnant=zone.nodes, numbers=numbers)
