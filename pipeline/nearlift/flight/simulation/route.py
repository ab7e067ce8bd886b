"""The cheapest way through a corridor that keeps the risk of a crash below a bound.

The corridor is seen from the side: a floor, a ceiling, boxes; the vehicle flies at a constant speed
along it on a grid, up and down at 45 degrees and steeper. Each leg costs energy (power to hover
there over power far away, times time; and climbing) and hazard (crashes per second of a hover at
that height, from the crash rates). Dijkstra's algorithm minimises energy + price x hazard; the
price is raised until the way is safe enough.

Risk is counted where it was flown and nowhere else. Above the highest set-point whose flights
crashed it is a bound that the number of flights sets (half a crash among them), above the highest
set-point flown that bound is kept, since farther away is no riskier: nothing falls on towards zero
because a curve would. Each part of a way says which it is. A way is chosen by the upper end of its
risk's 90 % interval, over the model's draws and the flights, so that few flights make a cautious
way.

What this is not: no trajectory (no acceleration, no tracking error beyond that in the crash rates),
no forward-flight aerodynamics (a ground's effect fades with speed), no third dimension, no moving
obstacle, and no way that only a non-convex part of the front offers. A box's sides are kept clear
of by half the vehicle; what they do to lift is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused
from nearlift.results import IntArray

#: Nodes per rotor radius.
FINENESS = 2
#: Most nodes: every price of a crash is a search over all of them.
MOST_NODES = 500_000
#: A boundary of which no model was fitted is left alone by so many radii.
BERTH = 4.0
#: A risk below this is none: no flight shows it.
NONE = 1e-12
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
        Induced velocity in hover far away; climbing by h costs as much as hovering for h / (2 v_i),
        descending gives nothing back.
    """

    radius_m: float
    half_width_m: float
    speed_m_s: float
    induced_m_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Nearness:
    """What being near one boundary means, as functions of z_hat.

    Attributes
    ----------
    power : callable
        Relative power.
    hazard : callable
        Crashes per second.
    low, high : callable
        Draws of the hazard, (m, n) for n heights: the 5 % point of the one and the 95 % point of
        the other bound it.
    lowest_z_hat : float
        The lowest height flown: no set-point below was flown, nothing below was measured, and the
        vehicle does not touch.
    seen_z_hat, flown_z_hat : float
        Highest set-point at which a flight crashed, and highest flown.
    """

    power: Callable[[FloatArray], FloatArray]
    hazard: Callable[[FloatArray], FloatArray]
    low: Callable[[FloatArray], FloatArray]
    high: Callable[[FloatArray], FloatArray]
    lowest_z_hat: float
    seen_z_hat: float
    flown_z_hat: float


#: What the risk at a point rests on, by how far it reaches beyond what was flown.
BASES = (
    "flights that crashed",
    "flights of which none crashed",
    "the bound of the farthest set-point flown, kept beyond it",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """A way: its points, energy relative to the straight distance flown far from boundaries, and
    its risk of a crash.

    Attributes
    ----------
    basis : int array (n,)
        What the risk at each point rests on, an index of `BASES`.
    lo90, hi90 : float
        Of the risk, over the model's draws and the flights; the upper end of a way on which none
        crashed is nearly 3 / flights' worth.
    """

    price: float
    x_m: FloatArray
    z_m: FloatArray
    basis: IntArray
    energy: float
    risk: float
    lo90: float
    hi90: float


def hazard_of(
    target_z_hat: FloatArray, rate: FloatArray, duration_s: float
) -> Callable[[FloatArray], FloatArray]:
    """Crashes per second as a function of z_hat, from crash rates (t,) or draws of them (m, t) at
    set-points.

    Log-linear between set-points, constant below the lowest and above the highest.

    Returns
    -------
    callable
        Heights (n,) to hazards (n,), or (m, n) for draws.
    """
    safe = np.clip(np.asarray(rate, dtype=float), 1e-300, 1 - 1e-12)
    log_hazard = np.log(-np.log1p(-safe) / duration_s)

    def hazard(z_hat: FloatArray) -> FloatArray:
        z = np.asarray(z_hat, dtype=float)
        i = np.clip(np.searchsorted(target_z_hat, z) - 1, 0, len(target_z_hat) - 2)
        t = np.clip((z - target_z_hat[i]) / (target_z_hat[i + 1] - target_z_hat[i]), 0.0, 1.0)
        result: FloatArray = np.exp((1 - t) * log_hazard[..., i] + t * log_hazard[..., i + 1])
        return result

    return hazard


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """Grid of the corridor: coordinates, relative power, hazard, where one may fly, and the gap to
    each boundary; arrays (columns, rows).
    """

    x_m: FloatArray
    z_m: FloatArray
    power: FloatArray
    hazard: FloatArray
    free: np.ndarray
    gaps: Mapping[Boundary, FloatArray]
    near: Mapping[Boundary, Nearness]

    def draws(self, nodes: IntArray, which: str) -> FloatArray:
        """Draws (m, n) of the hazard at nodes (n,), `low` or `high`: those of the boundaries are
        independent, and add.
        """
        total: FloatArray = np.zeros((1, len(nodes)))
        for boundary, near in self.near.items():
            at = np.maximum(self.gaps[boundary].ravel()[nodes], near.lowest_z_hat)
            own = near.low(at) if which == "low" else near.high(at)
            m = max(len(total), len(own))
            total = np.resize(total, (m, len(nodes))) + np.resize(own, (m, len(nodes)))
        return total

    def basis(self, nodes: IntArray) -> IntArray:
        """What the risk at nodes rests on: the boundary that carries more of it decides."""
        basis, most = np.full(len(nodes), 2), np.full(len(nodes), -1.0)
        for boundary, near in self.near.items():
            gap = self.gaps[boundary].ravel()[nodes]
            own = np.where(gap <= near.seen_z_hat, 0, np.where(gap <= near.flown_z_hat, 1, 2))
            hazard = near.hazard(np.maximum(gap, near.lowest_z_hat))
            basis, most = np.where(hazard > most, own, basis), np.maximum(hazard, most)
        return basis


def field(corridor: Corridor, pilot: Pilot, near: Mapping[Boundary, Nearness]) -> Field:
    """Power and hazard everywhere. The effects of floor and ceiling multiply, and their hazards
    add.

    Raises
    ------
    InputRefused
        The corridor has more nodes than can be searched; says how long it may be.
    """
    step = pilot.radius_m / FINENESS
    columns, rows = (
        max(round(size / step), 2) + 1 for size in (corridor.length_m, corridor.height_m)
    )
    if columns * rows > MOST_NODES:
        raise InputRefused(
            "simulate.route",
            f"a corridor of {corridor.length_m:g} by {corridor.height_m:g} m has"
            f" {columns * rows:.2g} nodes of half a rotor radius",
            f"at this height plan {MOST_NODES / rows * step:.2g} m at a time",
        )
    x, z = np.linspace(0, corridor.length_m, columns), np.linspace(0, corridor.height_m, rows)
    below, above = np.zeros((len(x), len(z))), np.full((len(x), len(z)), corridor.height_m)
    free = np.ones((len(x), len(z)), dtype=bool)
    for x_low, x_high, z_low, z_high in corridor.boxes:
        beside = (x >= x_low - pilot.half_width_m) & (x <= x_high + pilot.half_width_m)
        over, under = z >= z_high, z <= z_low
        below[np.ix_(beside, over)] = np.maximum(below[np.ix_(beside, over)], z_high)
        above[np.ix_(beside, under)] = np.minimum(above[np.ix_(beside, under)], z_low)
        free[np.ix_(beside, ~over & ~under)] = False
    gaps: dict[Boundary, FloatArray] = {
        "ground": (z - below) / pilot.radius_m,
        "ceiling": (above - z) / pilot.radius_m,
    }
    power, hazard = np.ones_like(below), np.zeros_like(below)
    for boundary, gap in gaps.items():
        if boundary in near:
            free &= gap >= near[boundary].lowest_z_hat
            at = np.maximum(gap, near[boundary].lowest_z_hat)
            power *= near[boundary].power(at)
            hazard += near[boundary].hazard(at)
        else:
            free &= gap >= BERTH
    return Field(x_m=x, z_m=z, power=power, hazard=hazard, free=free, gaps=gaps, near=near)


def ways(
    grid: Field,
    pilot: Pilot,
    start: tuple[float, float],
    goal: tuple[float, float],
    prices: FloatArray = PRICES,
) -> list[Way]:
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
            remedy = (
                f"between {column.min():.3g} and {column.max():.3g} m there is room"
                if len(column)
                else "boxes, floor and ceiling leave no room there"
            )
            raise InputRefused(
                f"simulate.route.{name}", f"({x:g}, {z:g}) m is in or too near an obstacle", remedy
            )
        ends.append(i * len(grid.z_m) + k)
    rows, columns, energy, hazard = _legs(grid, pilot)
    n = grid.free.size
    straight = float(np.hypot(goal[0] - start[0], goal[1] - start[1])) / pilot.speed_m_s
    found: list[Way] = []
    for price in prices:
        cost = coo_array(
            (energy / straight + price * hazard, (rows, columns)), shape=(n, n)
        ).tocsr()
        distance, before = shortest(cost, indices=ends[0], return_predecessors=True)
        if not np.isfinite(distance[ends[1]]):
            raise InputRefused(
                "simulate.route",
                "no way joins start and goal",
                "make a gap wider than the lowest set-points flown on either side",
            )
        way = [ends[1]]
        while way[-1] != ends[0]:
            way.append(int(before[way[-1]]))
        nodes = np.array(way[::-1])
        along, up = np.divmod(nodes, len(grid.z_m))
        own_energy, own_hazard = (
            _sum(nodes, rows, columns, energy, n),
            _sum(nodes, rows, columns, hazard, n),
        )
        time = np.hypot(np.diff(grid.x_m[along]), np.diff(grid.z_m[up])) / pilot.speed_m_s
        lo90, hi90 = (
            float(-np.expm1(-np.percentile((0.5 * (h[:, 1:] + h[:, :-1])) @ time, q)))
            for h, q in ((grid.draws(nodes, "low"), 5), (grid.draws(nodes, "high"), 95))
        )
        new = Way(
            price=float(price),
            x_m=grid.x_m[along],
            z_m=grid.z_m[up],
            basis=grid.basis(nodes),
            energy=own_energy / straight,
            risk=float(-np.expm1(-own_hazard)),
            lo90=lo90 if lo90 > NONE else 0.0,
            hi90=hi90,
        )
        if not found or (
            new.risk < found[-1].risk * (1 - 1e-9) and new.energy > found[-1].energy * (1 + 1e-9)
        ):
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


def _sum(
    nodes: np.ndarray, rows: FloatArray, columns: FloatArray, values: FloatArray, n: int
) -> float:
    """Sum over the legs of a way."""
    key = rows * n + columns
    order = np.argsort(key)
    at = np.searchsorted(key, nodes[:-1] * n + nodes[1:], sorter=order)
    return float(values[order[at]].sum())


def cheapest(found: Sequence[Way], risk: float, flights: int) -> Way:
    """The cheapest way that so many flights show to keep within the bound: the upper end of its
    risk's interval does.

    Raises
    ------
    InputRefused
        None does; says the least that was shown, and how many flights would show more if as few of
        them crashed.
    """
    safe = [w for w in found if w.hi90 <= risk]
    if safe:
        return min(safe, key=lambda w: w.energy)
    least = min(found, key=lambda w: w.hi90)
    told = (
        f"the safest has {least.risk:.2g}, at most {least.hi90:.2g} by {flights} flights a"
        " set-point"
    )
    enough = int(np.ceil(1.1 * flights * least.hi90 / risk))
    more = f"; fly about {enough}" if least.lo90 < risk and enough < 1e9 else "; raise the bound"
    raise InputRefused(
        "simulate.route.risk", f"no way is shown to keep the risk below {risk:g}", told + more
    )
