"""Topology of the wake between rotors and ground: vortices, stagnation zone, one jet or two.

A vortex is a core where |Gamma_2| (Graftieaux, Michard and Grosjean 2001) exceeds 2/pi: rotation
outweighs strain. Gamma_2 is unaffected by a uniform stream, so a bending jet and its edge have it
too. Only standing vortices are counted, about which the mean flow turns: |Gamma_1| is large there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.flow.field import Scene, VelocityField, take_columns

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
#: Vortices are not looked for nearer than this to the rotor plane, where blades and body are.
PLANE_HAT = 0.25
#: Rows by which a picture that ends above the ground is carried on to it, and gaps are, at most.
CARRIED = 3
#: Steps along x and y in which the zone, which is flat, is added up, over radius.
STEPS_HAT = 0.04, 0.01
#: Two jets: the weaker side has at least this share of the stronger side's momentum.
MIN_JET_SHARE = 1 / 3
#: Least |right - left| / (right + left) of the momentum of a leaning wake. A symmetric wake reaches
#: 0.07 where a fifth of the vectors is missing.
MIN_LEAN = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Vortex:
    """A vortex core: centre in vehicle axes, circulation (counter-clockwise positive) and area."""

    x_m: float
    y_m: float
    circulation_m2_s: float
    area_m2: float


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
    """Vortex cores, from left to right.

    Those within `PLANE_HAT` radii of the rotor plane or half a window of the ground are left out.
    So are those with vectors in less than half of their window.
    """
    from scipy.ndimage import label

    radius = max(WINDOW_HAT * scene.radius_m, WINDOW_NODES * max(field.dx_m, field.dy_m))
    turning, still = (np.nan_to_num(gamma(field, radius, moving=m)) for m in (True, False))
    xx, yy = np.meshgrid(field.x_m, field.y_m)
    height = scene.height_m(xx, yy)
    where = (np.abs(yy) > PLANE_HAT * scene.radius_m) & (height > 0.5 * radius)
    dx, dy, cores = field.dx_m, field.dy_m, []
    curl = np.gradient(field.vy_m_s, dx, axis=1) - np.gradient(field.vx_m_s, dy, axis=0)
    cell = dx * dy
    least = LEAST_AREA * scene.radius_m**2, LEAST_CIRCULATION * reference_m_s * scene.radius_m
    for sign in (1.0, -1.0):
        labels, n = label(where & (sign * turning > CORE) & (sign * still > STANDING))
        for core in (labels == k for k in range(1, n + 1)):
            area, turn = float(core.sum() * cell), float(np.nansum(curl[core]) * cell)
            if area >= least[0] and sign * turn >= least[1]:
                x, y = np.average([xx[core], yy[core]], axis=1, weights=still[core] ** 4).tolist()
                cores.append(Vortex(x_m=x, y_m=y, circulation_m2_s=turn, area_m2=area))
    return tuple(sorted(cores, key=lambda v: (v.x_m, v.y_m)))


@dataclass(frozen=True, slots=True, kw_only=True)
class StagnationZone:
    """Slow air on the ground beneath the rotors' inner halves: nodes (ny, nx), area, and greatest
    height along the boundary's normal.
    """

    nodes: NDArray[np.bool_]
    area_m2: float
    height_m: float


def stagnation(field: VelocityField, scene: Scene, reference_m_s: float) -> StagnationZone:
    """Zone of mean speed below `SLOW` of the reference that reaches the ground, within `INNER_HAT`
    radii of an axis.

    Either component is linear between nodes, and down to the ground along the line through each
    column's lowest two. The zone is every slow point that slow points join to the ground, so it
    does not depend on the places of the nodes.
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
    fine = np.zeros((len(y), len(x)))
    for component in (field.vx_m_s, field.vy_m_s):
        v = np.pad(np.where(seen, component, np.nan), ((unseen, 0), (0, 0)), constant_values=np.nan)
        v = _carried(v)
        along = take_columns(v, (x - field.x_m[0]) / field.dx_m)
        fine = np.hypot(fine, take_columns(along.T, (y - first) / field.dy_m).T)
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


def jets(field: VelocityField, scene: Scene) -> str:
    """``"two jets"`` or ``"one jet"`` along the ground, with the side to which the wake leans."""
    xx, yy = np.meshgrid(field.x_m, field.y_m)
    half = min(-field.x_m[0], field.x_m[-1])  # as much of the left as of the right
    below = (yy < 0) & (scene.height_m(xx, yy) > 0) & (np.abs(xx) <= half) & field.valid
    vx = field.vx_m_s[below]
    right, left = (float((vx[side * vx > 0] ** 2).sum()) for side in (1, -1))
    number = "two jets" if min(right, left) >= MIN_JET_SHARE * max(right, left) else "one jet"
    if abs(right - left) <= MIN_LEAN * (right + left):
        return number
    return f"{number}, leaning {'right' if right > left else 'left'}"
