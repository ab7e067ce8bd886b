"""Cheapest way through a corridor whose risk of a crash stays below a bound.

The vehicle flies at a constant speed along the corridor's grid, up and down at 45 degrees and
steeper. Each leg costs energy (power to hover there over power far away, times time; and climbing)
and hazard. Dijkstra's algorithm minimises energy + price x hazard at each of a range of prices. Of
these ways the cheapest is chosen whose risk is within the bound at the upper end of its 90 %
interval (over the model's draws and the flights), so that few flights make a cautious way.

Left out: trajectories (acceleration, tracking error beyond that in the crash rates), forward-flight
aerodynamics (a ground's effect fades with speed), the third dimension, moving obstacles, and ways
on a non-convex part of the front.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused
from nearlift.flight.simulation.corridor import (
    BASES,
    Corridor,
    CorridorGrid,
    Nearness,
    Pilot,
    corridor_grid,
)
from nearlift.flight.simulation.craft import Craft
from nearlift.manifest.flight import Route
from nearlift.results import IntArray

#: Risk below which the lower end of an interval is stated as 0: no flight shows it.
NONE = 1e-12
#: Prices of a crash for the front, in energies of the straight way flown far from boundaries.
PRICES = np.concatenate([[0.0], np.geomspace(1e-2, 1e5, 36)])
#: Moves: along, up and down; (columns, rows).
MOVES = ((1, 0), (1, 1), (1, -1), (1, 2), (1, -2), (0, 1), (0, -1), (-1, 0), (-1, 1), (-1, -1))


@dataclass(frozen=True, slots=True, kw_only=True)
class WayCost:
    """Energy of a way, relative to the straight distance flown far from boundaries, and its risk of
    a crash, with its 90 % interval over the model's draws and the flights; where no flight crashed
    the upper end corresponds to nearly 3 / flights.
    """

    price: float
    energy: float
    risk: float
    lo90: float
    hi90: float
    chosen: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Way:
    """A way through the corridor by its points (n,); `basis` is that of the risk at each, an index
    of `BASES`.
    """

    x_m: FloatArray
    z_m: FloatArray
    basis: IntArray
    cost: WayCost


def ways(
    grid: CorridorGrid,
    pilot: Pilot,
    start: tuple[float, float],
    goal: tuple[float, float],
) -> list[Way]:
    """Front of energy and risk: the best way for each price of a crash, by falling risk.

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
    key = rows * n + columns
    order = np.argsort(key)
    straight = float(np.hypot(goal[0] - start[0], goal[1] - start[1])) / pilot.speed_m_s
    front: list[Way] = []
    for price in PRICES:
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
        leg = order[np.searchsorted(key, nodes[:-1] * n + nodes[1:], sorter=order)]
        spent, danger = float(energy[leg].sum()), float(hazard[leg].sum())
        time = np.hypot(np.diff(grid.x_m[along]), np.diff(grid.z_m[up])) / pilot.speed_m_s
        lo90, hi90 = (
            float(-np.expm1(-np.percentile((0.5 * (h[:, 1:] + h[:, :-1])) @ time, q)))
            for h, q in ((grid.draws(nodes, "low"), 5), (grid.draws(nodes, "high"), 95))
        )
        new = WayCost(
            price=float(price),
            energy=spent / straight,
            risk=float(-np.expm1(-danger)),
            lo90=lo90 if lo90 > NONE else 0.0,
            hi90=hi90,
        )
        last = front[-1].cost if front else None
        if last is None or (
            new.risk < last.risk * (1 - 1e-9) and new.energy > last.energy * (1 + 1e-9)
        ):
            x_m, z_m = grid.x_m[along], grid.z_m[up]
            front.append(Way(x_m=x_m, z_m=z_m, basis=grid.basis(nodes), cost=new))
    return front


def _legs(
    grid: CorridorGrid, pilot: Pilot
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
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


def cheapest(front: Sequence[Way], risk: float, flights: int) -> Way:
    """Cheapest way of which the upper end of the risk's 90 % interval is within the bound.

    Raises
    ------
    InputRefused
        There is none; says the lowest upper end, and how many flights might lower it to the bound.
    """
    safe = [w for w in front if w.cost.hi90 <= risk]
    if safe:
        return min(safe, key=lambda w: w.cost.energy)
    least = min((w.cost for w in front), key=lambda cost: cost.hi90)
    shown = (
        f"the safest has {least.risk:.2g}, at most {least.hi90:.2g} by {flights} flights a"
        " set-point"
    )
    enough = int(np.ceil(1.1 * flights * least.hi90 / risk))
    more = f"; fly about {enough}" if least.lo90 < risk and enough < 1e9 else "; raise the bound"
    raise InputRefused(
        "simulate.route.risk", f"no way is shown to keep the risk below {risk:g}", shown + more
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class RouteResult:
    """The manifest's corridor, the ways through it, and the one chosen; `share_by_basis` is the
    share of the chosen way's points by the basis of their risk (`corridor.BASES`).
    """

    length_m: float
    height_m: float
    boxes_m: tuple[tuple[float, ...], ...]
    start_m: tuple[float, float]
    goal_m: tuple[float, float]
    speed_m_s: float
    risk_bound: float
    flights: int
    boundaries: tuple[Boundary, ...]
    lowest_z_hat: Mapping[Boundary, float]
    ways: tuple[WayCost, ...]
    energy: float
    risk: float
    lo90: float
    hi90: float
    share_by_basis: Mapping[str, float]


def planned_route(
    asked: Route,
    craft: Craft,
    rotor_spacing_m: float,
    near: Mapping[Boundary, Nearness],
    flights: int,
) -> tuple[RouteResult, list[dict[str, object]]]:
    """The route's entry in safety.json, and the rows of routes.parquet.

    Raises
    ------
    InputRefused
        As `corridor_grid`, `ways` and `cheapest`.
    """
    boxes = tuple((*box.x, *box.z) for box in asked.obstacles)
    disks = craft.rotors * math.pi * craft.radius_m**2
    pilot = Pilot(
        radius_m=craft.radius_m,
        half_width_m=craft.radius_m + rotor_spacing_m / 2,
        speed_m_s=asked.speed,
        induced_m_s=math.sqrt(craft.weight_N / (2 * craft.density_kg_m3 * disks)),
    )
    corridor = Corridor(length_m=asked.length, height_m=asked.height, boxes=boxes)
    front = ways(corridor_grid(corridor, pilot, near), pilot, asked.start, asked.goal)
    best = cheapest(front, asked.risk, flights)
    costs = tuple(replace(w.cost, chosen=w is best) for w in front)
    rows = [
        {
            "way": i,
            **asdict(cost),
            "risk_from": BASES[basis],
            "x_m": float(x),
            "z_m": float(z),
        }
        for i, (w, cost) in enumerate(zip(front, costs, strict=True))
        for x, z, basis in zip(w.x_m, w.z_m, w.basis, strict=True)
    ]
    return RouteResult(
        length_m=asked.length,
        height_m=asked.height,
        boxes_m=boxes,
        start_m=asked.start,
        goal_m=asked.goal,
        speed_m_s=asked.speed,
        risk_bound=asked.risk,
        flights=flights,
        boundaries=tuple(near),
        lowest_z_hat={b: n.lowest_z_hat for b, n in near.items()},
        ways=costs,
        energy=best.cost.energy,
        risk=best.cost.risk,
        lo90=best.cost.lo90,
        hi90=best.cost.hi90,
        share_by_basis={basis: float(np.mean(best.basis == i)) for i, basis in enumerate(BASES)},
    ), rows
