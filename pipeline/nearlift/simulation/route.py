"""The cheapest way through a corridor that keeps the risk of a crash below a bound.

The corridor is seen from the side: a floor, a ceiling, boxes; the vehicle flies at a constant speed along it on a grid, up and
down at 45 degrees and steeper. Each leg costs energy (power to hover there over power far away, times time; and climbing) and
hazard (crashes per second of a hover at that height, from the crash rates). Dijkstra's algorithm minimises energy + price x
hazard; the price is raised until the way is safe enough.

What this is not: no trajectory (no acceleration, no tracking error beyond that in the crash rates), no forward-flight
aerodynamics (a ground's effect fades with speed), no third dimension, no moving obstacle, and no way that only a non-convex part
of the front offers. A box's sides are kept clear of by half the vehicle; what they do to lift is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused

#: Nodes per rotor radius.
FINENESS = 2
#: A boundary of which no model was fitted is left alone by so many radii.
BERTH = 4.0
#: Prices tried for the front, in energies of the whole way flown far from boundaries.
PRICES = np.concatenate([[0.0], np.geomspace(1e-2, 1e5, 36)])
#: Moves: along, up and down; (columns, rows).
MOVES = ((1, 0), (1, 1), (1, -1), (1, 2), (1, -2), (0, 1), (0, -1), (-1, 0), (-1, 1), (-1, -1))


@dataclass(frozen=True, slots=True, kw_only=True)
class Corridor:
    """Length and height in m; boxes as (x_low, x_high, z_low, z_high)."""

    length_m: float
    height_m: float
    boxes: Sequence[tuple[float, float, float, float]] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Pilot:
    """The vehicle on its way.

    Attributes
    ----------
    radius_m, half_width_m : float
        Rotor radius, and half the vehicle's width, by which the sides of boxes are kept clear of.
    speed_m_s : float
    induced_m_s : float
        Induced velocity in hover far away; climbing by h costs as much as hovering for h / (2 v_i), descending gives nothing back.
    """

    radius_m: float
    half_width_m: float
    speed_m_s: float
    induced_m_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Nearness:
    """What being near one boundary means: relative power and hazard (1/s) as functions of z_hat, and the lowest z_hat flown."""

    power: Callable[[FloatArray], FloatArray]
    hazard: Callable[[FloatArray], FloatArray]
    lowest_z_hat: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """A way: its points, energy relative to the straight distance flown far from boundaries, and its risk of a crash."""

    price: float
    x_m: FloatArray
    z_m: FloatArray
    energy: float
    risk: float


def hazard_of(target_z_hat: FloatArray, crashes: FloatArray, flights: int, duration_s: float) -> Callable[[FloatArray], FloatArray]:
    """Crashes per second as a function of z_hat, from flights at set-points: log-linear between them.

    Where no flight crashed, the fall of the last two rates above zero goes on, from half a crash at most; where all did, the
    hazard is that of all but half a flight.
    """
    rate = np.clip(np.asarray(crashes, dtype=float) / flights, 0.5 / flights, 1 - 0.5 / flights)
    log_hazard = np.log(-np.log1p(-rate) / duration_s)
    seen = np.flatnonzero(crashes > 0)
    last = int(seen[-1]) if len(seen) else 0
    falling = (log_hazard[last] - log_hazard[last - 1]) / (target_z_hat[last] - target_z_hat[last - 1]) if last else -np.inf
    beyond = np.arange(last + 1, len(rate))
    if np.isfinite(falling) and falling < 0:
        log_hazard[beyond] = np.minimum(log_hazard[last] + falling * (target_z_hat[beyond] - target_z_hat[last]), log_hazard[beyond])

    def hazard(z_hat: FloatArray) -> FloatArray:
        z = np.asarray(z_hat, dtype=float)
        value = np.interp(z, target_z_hat, log_hazard)
        over = z > target_z_hat[-1]
        slope = min(falling, 0.0) if np.isfinite(falling) else 0.0
        result: FloatArray = np.exp(np.where(over, log_hazard[-1] + slope * (z - target_z_hat[-1]), value))
        return result

    return hazard


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """Grid of the corridor: coordinates, relative power, hazard, and where one may fly; arrays (columns, rows)."""

    x_m: FloatArray
    z_m: FloatArray
    power: FloatArray
    hazard: FloatArray
    free: np.ndarray


def field(corridor: Corridor, pilot: Pilot, near: Mapping[Boundary, Nearness]) -> Field:
    """Power and hazard everywhere. The effects of floor and ceiling multiply, and their hazards add."""
    step = pilot.radius_m / FINENESS
    x = np.linspace(0, corridor.length_m, max(round(corridor.length_m / step), 2) + 1)
    z = np.linspace(0, corridor.height_m, max(round(corridor.height_m / step), 2) + 1)
    below, above = np.zeros((len(x), len(z))), np.full((len(x), len(z)), corridor.height_m)
    free = np.ones((len(x), len(z)), dtype=bool)
    for x_low, x_high, z_low, z_high in corridor.boxes:
        beside = (x >= x_low - pilot.half_width_m) & (x <= x_high + pilot.half_width_m)
        over, under = z >= z_high, z <= z_low
        below[np.ix_(beside, over)] = np.maximum(below[np.ix_(beside, over)], z_high)
        above[np.ix_(beside, under)] = np.minimum(above[np.ix_(beside, under)], z_low)
        free[np.ix_(beside, ~over & ~under)] = False
    gaps: dict[Boundary, FloatArray] = {"ground": (z - below) / pilot.radius_m, "ceiling": (above - z) / pilot.radius_m}
    power, hazard = np.ones_like(below), np.zeros_like(below)
    for boundary, gap in gaps.items():
        if boundary in near:
            free &= gap >= near[boundary].lowest_z_hat
            at = np.maximum(gap, near[boundary].lowest_z_hat)
            power *= near[boundary].power(at)
            hazard += near[boundary].hazard(at)
        else:
            free &= gap >= BERTH
    return Field(x_m=x, z_m=z, power=power, hazard=hazard, free=free)


def ways(grid: Field, pilot: Pilot, start: tuple[float, float], goal: tuple[float, float], prices: FloatArray = PRICES) -> list[Way]:
    """The best way for each price of a crash, those that repeat left out, by falling risk.

    Raises
    ------
    InputRefused
        Start or goal lies where one may not fly, or nothing joins them.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    # its stub takes no sparse array
    shortest: Any = dijkstra

    ends = []
    for name, (x, z) in (("start", start), ("goal", goal)):
        i, k = int(np.abs(grid.x_m - x).argmin()), int(np.abs(grid.z_m - z).argmin())
        if not grid.free[i, k]:
            column = grid.z_m[grid.free[i]]
            remedy = f"between {column.min():.3g} and {column.max():.3g} m there is room" if len(column) else "a box fills that part of the corridor"
            raise InputRefused(f"simulate.route.{name}", f"({x:g}, {z:g}) m is in or too near an obstacle", remedy)
        ends.append(i * len(grid.z_m) + k)
    rows, columns, energy, hazard = _legs(grid, pilot)
    n = grid.free.size
    straight = float(np.hypot(goal[0] - start[0], goal[1] - start[1])) / pilot.speed_m_s
    found: list[Way] = []
    for price in prices:
        cost = coo_array((energy / straight + price * hazard, (rows, columns)), shape=(n, n)).tocsr()
        distance, before = shortest(cost, indices=ends[0], return_predecessors=True)
        if not np.isfinite(distance[ends[1]]):
            raise InputRefused("simulate.route", "no way joins start and goal", "make a gap wider than the lowest set-points flown on either side")
        way = [ends[1]]
        while way[-1] != ends[0]:
            way.append(int(before[way[-1]]))
        nodes = np.array(way[::-1])
        along, up = np.divmod(nodes, len(grid.z_m))
        own_energy, own_hazard = _sum(nodes, rows, columns, energy, n), _sum(nodes, rows, columns, hazard, n)
        new = Way(price=float(price), x_m=grid.x_m[along], z_m=grid.z_m[up], energy=own_energy / straight, risk=float(-np.expm1(-own_hazard)))
        if not found or (new.risk < found[-1].risk * (1 - 1e-9) and new.energy > found[-1].energy * (1 + 1e-9)):
            found.append(new)
    return found


def _legs(grid: Field, pilot: Pilot) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Every move between free nodes: from, to, energy in seconds of hover far away, hazard."""
    nx, nz = grid.free.shape
    index = np.arange(nx * nz).reshape(nx, nz)
    dx, dz = grid.x_m[1], grid.z_m[1]
    parts = []
    for a, b in MOVES:
        here = (slice(max(-a, 0), nx - max(a, 0)), slice(max(-b, 0), nz - max(b, 0)))
        there = (slice(max(a, 0), nx - max(-a, 0)), slice(max(b, 0), nz - max(-b, 0)))
        both = grid.free[here] & grid.free[there]
        time = float(np.hypot(a * dx, b * dz)) / pilot.speed_m_s
        climb = max(b * dz, 0.0) / (2 * pilot.induced_m_s)
        mean = 0.5 * (grid.power[here] + grid.power[there])[both]
        danger = 0.5 * (grid.hazard[here] + grid.hazard[there])[both]
        parts.append((index[here][both], index[there][both], mean * time + climb, danger * time))
    rows, columns, energy, hazard = (np.concatenate([p[i] for p in parts]) for i in range(4))
    return rows, columns, energy, hazard


def _sum(nodes: np.ndarray, rows: FloatArray, columns: FloatArray, values: FloatArray, n: int) -> float:
    """Sum over the legs of a way."""
    key = rows * n + columns
    order = np.argsort(key)
    at = np.searchsorted(key, nodes[:-1] * n + nodes[1:], sorter=order)
    return float(values[order[at]].sum())


def cheapest(found: Sequence[Way], risk: float) -> Way:
    """The cheapest way whose risk is within the bound.

    Raises
    ------
    InputRefused
        None is; says the least risk that there is.
    """
    safe = [w for w in found if w.risk <= risk]
    if not safe:
        least = min(w.risk for w in found)
        raise InputRefused("simulate.route.risk", f"no way keeps the risk below {risk:g}", f"the safest has {least:.2g}")
    return min(safe, key=lambda w: w.energy)
