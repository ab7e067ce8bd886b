"""The wake between rotors and ground as numbers: vortices, stagnation zone, the angle at which jets
split, left and right.

A vortex is a core where Gamma_2 (Graftieaux, Michard and Grosjean 2001) exceeds 2/pi in size: there
rotation outweighs strain. It looks at directions over a window, not at derivatives, and is unmoved
by a uniform stream. So is a jet that merely bends, or its edge; what is counted is a standing
vortex, about which the mean flow itself turns: Gamma_1, which sees the stream, is large there too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.flow.field import VelocityField, take_columns
from nearlift.flow.scene import Scene

CORE = 2 / math.pi
#: Least |Gamma_1| in the core of a standing vortex.
STANDING = 0.5
#: Radius of Gamma_2's window over rotor radius, and the least grid spacings it may be.
WINDOW_HAT, WINDOW_NODES = 0.4, 2.0
#: A vortex has at least this area over r^2 and this circulation over U r.
LEAST_AREA, LEAST_CIRCULATION = 0.03, 0.1
#: Air slower than this over the control's downwash is stagnant.
SLOW = 0.3
#: The zone beneath an axis is that under the rotor's inner half: within the core of a wake, which
#: contracts to 1/sqrt(2) of the radius by momentum theory, even with its shear layer.
INNER_HAT = 0.5
#: A jet stagnates within so many radii of its axis.
NEAR_HAT = 1.0
#: Vortices are not looked for nearer than this to the rotor plane, where blades and body are.
PLANE_HAT = 0.25
#: Rows by which a picture that ends above the ground is carried on to it, and gaps are, at most.
CARRIED = 3
#: Steps along x and y in which the zone, which is flat, is added up, over radius.
STEPS_HAT = 0.04, 0.01
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
    """One mean field in numbers (`vortices_ccw`, `vortices_cw`, `vortex_pairs`,
    `stagnation_area_hat2`, `stagnation_height_hat`, `split_angle_deg`, `asymmetry`; lengths over
    rotor radius, areas over its square), with its vortices and the stagnation zone (ny, nx).
    """

    vortices: tuple[Vortex, ...]
    stagnant: NDArray[np.bool_]
    numbers: dict[str, float]


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

    def whole(a: NDArray[Any]) -> FloatArray:
        """Sum over the window, the node itself included."""
        return sum((shifted(a, j, i) for j, i in (*offsets, (0, 0))), np.zeros((ny, nx)))

    count = whole(known)
    mean_x, mean_y = (whole(v) / np.maximum(count, 1) for v in (vx, vy))
    total = np.zeros((ny, nx))
    for j, i in offsets:
        px, py = i * dx, j * dy
        ux, uy = shifted(vx, j, i) - moving * mean_x, shifted(vy, j, i) - moving * mean_y
        size = np.hypot(ux, uy) * math.hypot(px, py)
        with np.errstate(invalid="ignore", divide="ignore"):
            sine = np.where(size > 0, (px * uy - py * ux) / size, 0.0)
        total += np.where(shifted(known, j, i), sine, 0.0)
    enough = field.valid & (count - 1 >= 0.5 * len(offsets))
    return np.where(enough, total / np.maximum(count - 1, 1), np.nan)


def vortices(field: VelocityField, scene: Scene, reference_m_s: float) -> tuple[Vortex, ...]:
    """Vortex cores, from left to right. Left out are those nearer to the rotor plane than
    `PLANE_HAT` radii, to the ground than half the window, or where fewer than half of a window has
    vectors.
    """
    from scipy.ndimage import label

    radius = max(WINDOW_HAT * scene.radius_m, WINDOW_NODES * max(field.dx_m, field.dy_m))
    turning, still = (np.nan_to_num(gamma(field, radius, moving=m)) for m in (True, False))
    xx, yy = np.meshgrid(field.x_m, field.y_m)
    height = scene.height_m(xx, yy)
    where = (np.abs(yy) > PLANE_HAT * scene.radius_m) & (height > 0.5 * radius)
    curl = np.gradient(field.vy_m_s, field.dx_m, axis=1) - np.gradient(
        field.vx_m_s, field.dy_m, axis=0
    )
    cell = field.dx_m * field.dy_m
    cores = []
    for sign in (1.0, -1.0):
        labels, n = label(where & (sign * turning > CORE) & (sign * still > STANDING))
        for k in range(1, n + 1):
            core = labels == k
            area = float(core.sum() * cell)
            circulation = float(np.nansum(curl[core]) * cell)
            if (
                area < LEAST_AREA * scene.radius_m**2
                or sign * circulation < LEAST_CIRCULATION * reference_m_s * scene.radius_m
            ):
                continue
            weight = (sign * still[core]) ** 4
            cores.append(
                Vortex(
                    x_m=float(np.average(xx[core], weights=weight)),
                    y_m=float(np.average(yy[core], weights=weight)),
                    circulation_m2_s=circulation,
                    area_m2=area,
                )
            )
    return tuple(sorted(cores, key=lambda v: (v.x_m, v.y_m)))


@dataclass(frozen=True, slots=True, kw_only=True)
class StagnationZone:
    """Slow air that rests on the ground beneath the rotors' inner halves: its nodes (ny, nx), area
    and greatest height along the boundary's normal; and the speed on the ground (nx,), beneath the
    rotors or not.
    """

    nodes: NDArray[np.bool_]
    area_m2: float
    height_m: float
    ground_m_s: FloatArray


def stagnation(field: VelocityField, scene: Scene, reference_m_s: float) -> StagnationZone:
    """The stagnation zone: what the level of `SLOW` of the reference in the mean speed encloses
    together with the ground, beneath `INNER_HAT` radii of an axis.

    Either component is linear between nodes, and down to the ground along the line through each
    column's lowest two; the zone is every slow point that slow points join to the ground. So it
    does not depend on where the grid's nodes happen to stand.
    """
    from scipy.ndimage import label

    _, yy = np.meshgrid(field.x_m, field.y_m)
    ground = scene.boundary_y_m(field.x_m)
    seen = field.valid & (yy > ground) & (yy < 0)
    # a picture that ends a little above the ground is carried on to it
    unseen = min(max(math.ceil((field.y_m[0] - ground.min()) / field.dy_m), 0), CARRIED)
    first = field.y_m[0] - unseen * field.dy_m
    dx, dy = (s * scene.radius_m for s in STEPS_HAT)
    x, y = np.arange(field.x_m[0], field.x_m[-1], dx), np.arange(first, 0.0, dy)
    x = x[scene.beneath(x, INNER_HAT + STEPS_HAT[0])]
    fine, on_ground = np.zeros((len(y), len(x))), np.zeros(len(ground))
    for component in (field.vx_m_s, field.vy_m_s):
        v = np.pad(np.where(seen, component, np.nan), ((unseen, 0), (0, 0)), constant_values=np.nan)
        v = _carried(v)
        along = take_columns(v, (x - field.x_m[0]) / field.dx_m)
        fine = np.hypot(fine, take_columns(along.T, (y - first) / field.dy_m).T)
        at = (ground - first) / field.dy_m
        on_ground = np.hypot(on_ground, np.diagonal(take_columns(v.T, at)))
    height = scene.height_m(*np.meshgrid(x, y))
    slow = (fine < SLOW * reference_m_s) & (height >= 0) & scene.beneath(x, INNER_HAT)
    labels, _ = label(slow)
    rests = np.unique(labels[slow & (height < 2 * dy)])
    zone = slow & np.isin(labels, rests)
    near_x, near_y = (
        np.clip(np.searchsorted(a, b - 0.5 * d), 0, len(a) - 1)
        for a, b, d in ((x, field.x_m, dx), (y, field.y_m, dy))
    )
    nodes = zone[np.ix_(near_y, near_x)] & scene.beneath(field.x_m, INNER_HAT) & (yy > ground)
    return StagnationZone(
        nodes=nodes,
        area_m2=float(zone.sum()) * dx * dy,
        height_m=float(height[zone].max()) if zone.any() else 0.0,
        ground_m_s=on_ground,
    )


def _carried(values: FloatArray) -> FloatArray:
    """Each column carried on below its lowest two on the line through them, and straight across
    gaps of at most `CARRIED` nodes.
    """
    values, rows = values.copy(), np.arange(len(values))
    for column in values.T:
        known = np.flatnonzero(np.isfinite(column))
        if len(known) < 2:
            continue
        lowest = known[:2]
        rise = np.diff(column[lowest]) / np.diff(lowest)
        below = rows < lowest[0]
        column[below] = column[lowest[0]] + rise * (rows[below] - lowest[0])
        above = np.searchsorted(known, rows)
        inside = (above > 0) & (above < len(known)) & ~np.isfinite(column)
        inside[inside] = np.diff(known)[above[inside] - 1] - 1 <= CARRIED
        column[inside] = np.interp(rows[inside], known, column[known])
    return values


def stagnation_points_m(
    field: VelocityField, scene: Scene, zone: StagnationZone, reference_m_s: float
) -> FloatArray:
    """Places x on the boundary where slow air parts to the left and to the right."""
    _, yy = np.meshgrid(field.x_m, field.y_m)
    lowest = np.argmax(field.valid & (yy > scene.boundary_y_m(field.x_m)), axis=0)
    columns = np.arange(len(field.x_m))
    along = (
        math.cos(scene.tilt_rad) * field.vx_m_s[lowest, columns]
        - math.sin(scene.tilt_rad) * field.vy_m_s[lowest, columns]
    )
    left = np.flatnonzero((along[:-1] <= 0) & (along[1:] > 0))
    share = -along[left] / (along[left + 1] - along[left])
    speed = (1 - share) * zone.ground_m_s[left] + share * zone.ground_m_s[left + 1]
    x: FloatArray = (field.x_m[left] + share * field.dx_m)[speed < SLOW * reference_m_s]
    return x


def split_angle_deg(
    field: VelocityField, scene: Scene, zone: StagnationZone, reference_m_s: float
) -> float:
    """Angle between the two streams into which a rotor's jet parts, mean over rotors: 180 along the
    ground; nan where no stagnation point lies on the boundary within `NEAR_HAT` radii of the axis,
    since nothing splits there, or if unseen.
    """
    points = stagnation_points_m(field, scene, zone, reference_m_s)
    xx, yy = np.meshgrid(field.x_m, field.y_m)
    height = scene.height_m(xx, yy)
    splits = []
    for centre in scene.rotors_m:
        if not (np.abs(points - centre) <= NEAR_HAT * scene.radius_m).any():
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
            splits.append(math.degrees(sum(angles)))
    return float(np.mean(splits)) if splits else math.nan


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
        "stagnation_area_hat2": zone.area_m2 / r**2,
        "stagnation_height_hat": zone.height_m / r,
        "split_angle_deg": split_angle_deg(field, scene, zone, reference_m_s),
        "asymmetry": asymmetry(field, scene),
    }
    return WakeTopology(vortices=cores, stagnant=zone.nodes, numbers=numbers)
