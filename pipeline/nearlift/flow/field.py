"""A velocity field on a rectangular grid, its way from a picture's axes into the vehicle's, and
its spurious vectors.

Vehicle axes: origin midway between the rotors in the rotor plane, x along the light sheet, y along
thrust. Downwash is -vy. A node without a vector is nan in both components, never zero. Spurious
vectors are found by the normalised median test of Westerweel and Scarano (2005).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused

Direction = Literal["+x", "-x", "+y", "-y"]
Half = Literal["left", "right"]
#: Neighbouring nodes may be this much more or less apart than the grid's spacing.
EVEN = 0.02
#: A sign is doubted where both components' divergences go together this much, and by so many
#: standard errors.
DOUBT, ERRORS = 0.2, 8.0
#: Least divisor of a component's median residual, over the field's own typical residual.
RESIDUAL_FLOOR = 1.0
#: Least number of a node's eight neighbours that have a vector, where it is tested.
MIN_NEIGHBOURS = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class VelocityField:
    """One instantaneous or mean field.

    Attributes
    ----------
    x_m : (nx,)
        Ascending, evenly spaced.
    y_m : (ny,)
        Ascending, evenly spaced.
    vx_m_s, vy_m_s : (ny, nx)
        Velocity components along x and y; nan where there is no vector.
    """

    x_m: FloatArray
    y_m: FloatArray
    vx_m_s: FloatArray
    vy_m_s: FloatArray

    @property
    def shape(self) -> tuple[int, int]:
        """(ny, nx)."""
        return len(self.y_m), len(self.x_m)

    @property
    def dx_m(self) -> float:
        """Spacing along x."""
        return float((self.x_m[-1] - self.x_m[0]) / (len(self.x_m) - 1))

    @property
    def dy_m(self) -> float:
        """Spacing along y."""
        return float((self.y_m[-1] - self.y_m[0]) / (len(self.y_m) - 1))

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Mask of the nodes with a vector."""
        return np.isfinite(self.vx_m_s) & np.isfinite(self.vy_m_s)

    @property
    def speed_m_s(self) -> FloatArray:
        """In-plane speed."""
        return np.hypot(self.vx_m_s, self.vy_m_s)

    def without(self, nodes: NDArray[np.bool_]) -> VelocityField:
        """The field without the vectors of these nodes (ny, nx)."""
        vx, vy = (np.where(nodes, np.nan, v) for v in (self.vx_m_s, self.vy_m_s))
        return replace(self, vx_m_s=vx, vy_m_s=vy)


def same_grid(a: VelocityField, b: VelocityField) -> bool:
    """Whether two fields have the same nodes."""
    if a.shape != b.shape:
        return False
    ends = ((a.x_m, b.x_m, a.dx_m), (a.y_m, b.y_m, a.dy_m))
    # both are even, so their ends say it all
    return all(abs(p[k] - q[k]) < 1e-3 * step for p, q, step in ends for k in (0, -1))


def on_grid(
    x: FloatArray, y: FloatArray, values: tuple[FloatArray, ...], where: str
) -> tuple[FloatArray, FloatArray, tuple[FloatArray, ...]]:
    """Scattered rows (n,) that fill a rectangular grid in any order, as axes (nx,), (ny,) and
    arrays (ny, nx); missing nodes are nan.

    Raises
    ------
    InputRefused
        Too few nodes, nodes that repeat, or a grid that is not even.
    """
    across, i = _axis(x, "x", where)
    up, j = _axis(y, "y", where)
    if len(np.unique(j * len(across) + i)) != len(x):
        raise InputRefused(where, "has two vectors at one place", "export one field per file")
    if len(x) < 0.5 * len(across) * len(up):
        what = f"has {len(x)} vectors on a grid of {len(across)} x {len(up)} nodes"
        raise InputRefused(where, what, "export a rectangular grid with at least half of its nodes")
    grids = np.full((len(values), len(up), len(across)), np.nan)
    grids[:, j, i] = values
    return across, up, tuple(grids)


def _axis(values: FloatArray, name: str, where: str) -> tuple[FloatArray, NDArray[np.int64]]:
    """Nodes along one axis, ascending and even, and the node of each row."""
    if not np.isfinite(values).all():
        what = f"has a vector whose {name} is no number"
        raise InputRefused(where, what, "export the positions of masked vectors too")
    nodes = np.unique(values)
    if len(nodes) > 1:
        # positions are printed with few digits: nodes a hundredth of the usual spacing apart are
        # one
        usual = np.median(np.diff(nodes)[np.diff(nodes) > 1e-3 * (nodes[-1] - nodes[0])])
        nodes = nodes[np.concatenate([[True], np.diff(nodes) > 0.3 * usual])]
    if len(nodes) < 3:
        what = f"has {len(nodes)} distinct {name}"
        raise InputRefused(where, what, "a field has at least 3 x 3 nodes")
    step = (nodes[-1] - nodes[0]) / (len(nodes) - 1)
    even = nodes[0] + step * np.arange(len(nodes))
    off, uneven = np.abs(nodes - even).max() / step, np.abs(np.diff(nodes) / step - 1).max()
    if off > max(EVEN * len(nodes), 0.3) or uneven > 0.3:
        what = f"has nodes that are not evenly spaced along {name}"
        raise InputRefused(where, what, "export on the correlation's own rectangular grid")
    return even, np.rint((values - nodes[0]) / step).astype(np.int64)


def orient(
    field: VelocityField,
    *,
    thrust: Direction,
    across: Direction | None = None,
    origin_m: tuple[float, float] = (0.0, 0.0),
    v_sign: int = 1,
) -> VelocityField:
    """Transform a field to vehicle axes.

    `thrust` and `across` are the picture's directions of thrust (+y of the vehicle) and of the
    vehicle's +x, by default the picture's other axis. `origin_m` is the vehicle's origin in the
    picture. `v_sign` is -1 where the second velocity component was written positive against the
    second axis.
    """
    right = across or ("+x" if thrust[1] == "y" else "+y")
    axes = {"x": field.x_m - origin_m[0], "y": field.y_m - origin_m[1]}
    flow = {"x": field.vx_m_s, "y": v_sign * field.vy_m_s}
    x, y = axes[right[1]], axes[thrust[1]]
    grids = np.stack([flow[right[1]], flow[thrust[1]]])
    if right[1] == "y":
        grids = grids.swapaxes(1, 2)
    if right[0] == "-":
        x, grids = -x[::-1], grids[:, :, ::-1]
        grids[0] = -grids[0]
    if thrust[0] == "-":
        y, grids = -y[::-1], grids[:, ::-1]
        grids[1] = -grids[1]
    return VelocityField(x_m=x, y_m=y, vx_m_s=grids[0], vy_m_s=grids[1])


def masked(
    field: VelocityField, rectangles: list[tuple[float, float, float, float]]
) -> VelocityField:
    """The field without its vectors inside rectangles (x from, x to, y from, y to)."""
    hidden, x, y = np.zeros(field.shape, dtype=bool), field.x_m, field.y_m
    for x0, x1, y0, y1 in rectangles:
        hidden |= np.outer((y >= y0) & (y <= y1), (x >= x0) & (x <= x1))
    return field.without(hidden)


def mirrored(field: VelocityField, half: Half) -> VelocityField:
    """Mirror a field of which one half was measured.

    The result is on an even grid that is symmetric about x = 0, with vx of the other sign on the
    other side.
    """
    dx, side = field.dx_m, 1.0 if half == "right" else -1.0
    reach = field.x_m[-1] if half == "right" else -field.x_m[0]
    n = int(np.floor(reach / dx + 1e-6))
    x = np.asarray(dx * np.arange(-n, n + 1), dtype=float)
    position = (side * np.abs(x) - field.x_m[0]) / dx
    sign = np.where(x * side < -1e-9 * dx, -1.0, 1.0)
    return VelocityField(
        x_m=x,
        y_m=field.y_m,
        vx_m_s=sign * take_columns(field.vx_m_s, position),
        vy_m_s=take_columns(field.vy_m_s, position),
    )


def take_columns(values: FloatArray, position: FloatArray) -> FloatArray:
    """Values (..., nx) at fractional columns, linear between neighbours; the last half spacing
    before an edge takes the edge's.
    """
    nx = values.shape[-1]
    near = np.where((position < 0) & (position >= -1), 0.0, position)
    low = np.clip(np.floor(near + 1e-9), 0, nx - 1).astype(np.int64)
    high = np.minimum(low + 1, nx - 1)
    share = np.clip(near - low, 0.0, 1.0)
    share = np.where(share < 1e-6, 0.0, share)
    left, right = values[..., low], values[..., high]
    mixed = np.where(share == 0, left, (1 - share) * left + share * right)
    inside = (near >= 0) & (near <= nx - 1 + 1e-6)
    return np.where(inside, mixed, np.nan)


def has_flipped_component(field: VelocityField) -> bool:
    """Whether the field itself contradicts the sign of one component against its axis.

    Mass is conserved: dvx/dx and dvy/dy oppose each other, in a plane jet wholly, in a round one
    for the most part. With one component flipped they go together.
    """
    gx = np.gradient(field.vx_m_s, field.dx_m, axis=1)
    gy = np.gradient(field.vy_m_s, field.dy_m, axis=0)
    known = np.isfinite(gx) & np.isfinite(gy)
    if known.sum() < 9:
        return False
    a, b = gx[known], gy[known]
    scale = np.sqrt((a @ a) * (b @ b))
    spread = float(np.sqrt(np.sum((a * b) ** 2)))
    together = float(a @ b)
    return bool(together > DOUBT * scale and together > ERRORS * spread > 0)


def difference(case: VelocityField, control: VelocityField) -> FloatArray:
    """Airspeed of the case less that of the control, in vehicle axes, on the case's nodes (ny, nx).

    Linear between the control's nodes; nan outside them and next to missing vectors.
    """

    def at(values: FloatArray, position: FloatArray) -> FloatArray:
        inside = (position > -1e-6) & (position < values.shape[-1] - 1 + 1e-6)
        return np.where(inside, take_columns(values, position), np.nan)

    across = at(control.speed_m_s, (case.x_m - control.x_m[0]) / control.dx_m)
    there = at(across.T, (case.y_m - control.y_m[0]) / control.dy_m).T
    return np.asarray(case.speed_m_s - there)


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """Positions of rotors and boundary in vehicle axes: a ground beneath the wake, a ceiling above
    the inflow, or neither.

    `distance_m` is from the origin (midway between the rotors) to the boundary along its normal,
    inf without one. The tilt is positive where the +x side is farther from the boundary. `rotors_m`
    are x of the rotor axes in the light sheet.
    """

    boundary: Literal["ground", "ceiling", "none"]
    distance_m: float
    tilt_rad: float
    rotors_m: tuple[float, ...]
    radius_m: float

    @property
    def side(self) -> float:
        """Direction from the boundary to the vehicle along y."""
        return 1.0 if self.boundary == "ground" else -1.0

    def height_m(self, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
        """Distance to the boundary along its normal, positive on the vehicle's side, inf without
        one; shapes broadcast.
        """
        if self.boundary == "none":
            return np.full(np.broadcast_shapes(np.shape(x_m), np.shape(y_m)), np.inf)
        cosine, sine = math.cos(self.tilt_rad), math.sin(self.tilt_rad)
        return np.asarray(self.distance_m + self.side * y_m * cosine + x_m * sine)

    def boundary_y_m(self, x_m: FloatArray) -> FloatArray:
        """Height of the boundary at `x_m`."""
        cosine, sine = math.cos(self.tilt_rad), math.sin(self.tilt_rad)
        return np.asarray(-self.side * (self.distance_m + x_m * sine) / cosine)

    def beneath(self, x_m: FloatArray, reach: float = 1.0) -> NDArray[np.bool_]:
        """Whether `x_m` lies within `reach` radii of a rotor axis."""
        return np.asarray(
            np.any([np.abs(x_m - c) <= reach * self.radius_m for c in self.rotors_m], axis=0)
        )


def spurious(vx: FloatArray, vy: FloatArray, threshold: float) -> NDArray[np.bool_]:
    """Vectors (ny, nx) that deviate from the median of their neighbours.

    The limit is `threshold` times the scatter of those neighbours.

    The scatter has a floor, the field's median scatter. The usual floor of 0.1 pixel needs a pixel
    size, which exported fields seldom state. Nodes with fewer than four neighbours are not tested.
    """
    bad = np.zeros(vx.shape, dtype=bool)
    if threshold <= 0:
        return bad
    total = np.zeros(vx.shape)
    for v in (vx, vy):
        windows = sliding_window_view(np.pad(v, 1, constant_values=np.nan), v.shape)
        around = np.delete(windows.reshape(9, *v.shape), 4, axis=0)
        middle = _median(around)
        scatter = _median(np.abs(around - middle))
        enough = np.isfinite(around).sum(axis=0) >= MIN_NEIGHBOURS
        typical = np.nanmedian(scatter[enough]) if (enough & np.isfinite(scatter)).any() else 0.0
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.abs(v - middle) / (scatter + RESIDUAL_FLOOR * typical)
        total += np.where(enough & np.isfinite(ratio), ratio, 0.0) ** 2
    return np.asarray(np.sqrt(total) > threshold) & np.isfinite(vx)


def _median(stack: FloatArray) -> FloatArray:
    """Median along the first axis of what is there: of eight sorted neighbours, where nan sorts
    last.
    """
    ordered = np.sort(stack, axis=0)
    count = np.isfinite(ordered).sum(axis=0)
    low = np.maximum((count - 1) // 2, 0)
    high = np.minimum(count // 2, stack.shape[0] - 1)
    with np.errstate(invalid="ignore"):
        middle = 0.5 * sum(np.take_along_axis(ordered, k[None], 0)[0] for k in (low, high))
    return np.where(count > 0, middle, np.nan)
