"""Grid of a corridor seen from the side: relative power, hazard, and where one may fly.

The corridor has a floor, a ceiling and boxes. Hazard is crashes per second of a hover at that
height, from the crash rates. Above the highest set-point whose flights crashed it is limited by the
number of flights (half a crash among them); above the highest set-point flown it is kept constant,
since farther away is no riskier and no curve is trusted to fall towards zero. The sides of boxes
are kept clear of by half the vehicle; their effect on lift is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nearlift.declare import Boundary, FloatArray
from nearlift.errors import InputRefused
from nearlift.flight.simulation import energy
from nearlift.flight.simulation.crash_rate import PER_DRAW, estimate, rate_draws
from nearlift.flight.simulation.monte_carlo import Sweep
from nearlift.results import IntArray

#: Nodes per rotor radius.
FINENESS = 2
#: Largest number of nodes: every price of a crash is a search over all of them.
MOST_NODES = 500_000
#: Clearance, in rotor radii, from a boundary without a fitted model.
BERTH = 4.0
#: Basis of the risk at a point, from flown to extrapolated.
BASES = (
    "flights that crashed",
    "flights of which none crashed",
    "the bound of the farthest set-point flown, kept beyond it",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Corridor:
    """Length and height in m; boxes as (x_low, x_high, z_low, z_high)."""

    length_m: float
    height_m: float
    boxes: Sequence[tuple[float, float, float, float]] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Pilot:
    """Size and speed of the vehicle on its way: rotor radius, half its width (the clearance from
    the sides of boxes), and the induced velocity v_i in hover far away; climbing by h costs as much
    as hovering for h / (2 v_i), descending gives nothing back.
    """

    radius_m: float
    half_width_m: float
    speed_m_s: float
    induced_m_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Nearness:
    """Effects of one boundary as functions of z_hat: relative power, hazard in crashes per second,
    and draws of the hazard, (m, n) for n heights: the 5 % point of `low` and the 95 % point of
    `high` bound it.

    Below `lowest_z_hat` nothing was flown or measured, or the two extrapolations of lift give
    different crash rates. `seen_z_hat` is the highest set-point at which a flight crashed,
    `flown_z_hat` the highest flown.
    """

    power: Callable[[FloatArray], FloatArray]
    hazard: Callable[[FloatArray], FloatArray]
    low: Callable[[FloatArray], FloatArray]
    high: Callable[[FloatArray], FloatArray]
    lowest_z_hat: float
    seen_z_hat: float
    flown_z_hat: float


def hazard_between(
    target_z_hat: FloatArray, rate: FloatArray, duration_s: float
) -> Callable[[FloatArray], FloatArray]:
    """Crashes per second as a function of z_hat, from crash rates (t,) or draws of them (m, t) at
    set-points: log-linear between them, constant below the lowest and above the highest. Heights
    (n,) give hazards (n,), or (m, n) for draws.
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


def nearness(
    flown: Sweep,
    held: energy.Held,
    duration_s: float,
    lowest_z_hat: float,
    rng: np.random.Generator,
) -> Nearness:
    """Power and hazard near one boundary, from a sweep's best estimate (row 1), the same with lift
    held below the nearest station (row 2), and the model's draws.

    `lowest_z_hat` is the lowest height measured at which both extrapolations agree.
    """
    z_hat = flown.target_z_hat
    cost = energy.cost(flown.ratio[1], held)[1]
    crashes = flown.crashes[1]
    low, high = (
        np.concatenate(
            [rate_draws(c, PER_DRAW, rng, crash=crash, safe=1.0 - crash) for c in flown.crashed[1:]]
        )
        for crash in (0.0, 1.0)
    )
    # beyond the highest set-point the saving falls as 1 / z^2, as an image's does
    last = 1 - cost[-1]
    return Nearness(
        power=lambda z: np.where(
            z > z_hat[-1],
            1 - last * (z_hat[-1] / np.maximum(z, z_hat[-1])) ** 2,
            np.interp(z, z_hat, cost),
        ),
        hazard=hazard_between(z_hat, estimate(crashes, flown.flights), duration_s),
        low=hazard_between(z_hat, low, duration_s),
        high=hazard_between(z_hat, high, duration_s),
        lowest_z_hat=max(float(z_hat[0]), lowest_z_hat),
        seen_z_hat=float(z_hat[np.flatnonzero(crashes)[-1]]) if crashes.any() else -np.inf,
        flown_z_hat=float(z_hat[-1]),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class CorridorGrid:
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
        """Draws (m, n) of the hazard at nodes (n,), `low` or `high`, summed over boundaries."""
        total: FloatArray = np.zeros((1, len(nodes)))
        for boundary, near in self.near.items():
            at = np.maximum(self.gaps[boundary].ravel()[nodes], near.lowest_z_hat)
            drawn = near.low(at) if which == "low" else near.high(at)
            m = max(len(total), len(drawn))
            total = np.resize(total, (m, len(nodes))) + np.resize(drawn, (m, len(nodes)))
        return total

    def basis(self, nodes: IntArray) -> IntArray:
        """Basis of the risk at nodes: that of the boundary with the larger hazard."""
        basis, most = np.full(len(nodes), 2), np.full(len(nodes), -1.0)
        for boundary, near in self.near.items():
            gap = self.gaps[boundary].ravel()[nodes]
            here = np.where(gap <= near.seen_z_hat, 0, np.where(gap <= near.flown_z_hat, 1, 2))
            hazard = near.hazard(np.maximum(gap, near.lowest_z_hat))
            basis, most = np.where(hazard > most, here, basis), np.maximum(hazard, most)
        return basis


def corridor_grid(
    corridor: Corridor, pilot: Pilot, near: Mapping[Boundary, Nearness]
) -> CorridorGrid:
    """Power and hazard on the grid: powers of floor and ceiling multiply, their hazards add.

    Raises
    ------
    InputRefused
        The corridor has more than MOST_NODES nodes; says how long it may be.
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
    return CorridorGrid(x_m=x, z_m=z, power=power, hazard=hazard, free=free, gaps=gaps, near=near)
