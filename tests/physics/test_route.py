"""Ways through a corridor: what they cost, what they risk, and what is refused."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from nearlift.errors import InputRefused
from nearlift.flight.simulation import corridor, crash_rate, route

RADIUS = 0.023
PILOT = corridor.Pilot(radius_m=RADIUS, half_width_m=0.055, speed_m_s=0.5, induced_m_s=4.0)
CORRIDOR = corridor.Corridor(length_m=1.0, height_m=0.4)
LONG = corridor.Corridor(length_m=4.0, height_m=0.4)
FAR = {"start": (0.0, 0.2), "goal": (4.0, 0.2)}


def nearness(power, hazard, spread=0.2, seen=2.0):
    """Known to a factor of exp(+-spread) by 21 draws; flown up to 4 radii."""
    factor = np.exp(spread * np.linspace(-1, 1, 21))[:, None]
    drawn = lambda z: factor * hazard(z)  # noqa: E731
    return corridor.Nearness(
        power=power,
        hazard=hazard,
        low=drawn,
        high=drawn,
        lowest_z_hat=1.0,
        seen_z_hat=seen,
        flown_z_hat=4.0,
    )


GROUND = nearness(lambda z: 1 - 0.3 / z**2, lambda z: np.exp(-6 * (z - 0.5)))
CEILING = nearness(np.ones_like, lambda z: np.exp(-4 * (z - 1.0)))
ENDS = {"start": (0.0, 0.2), "goal": (1.0, 0.2)}


def test_without_boundaries_the_way_is_straight_and_costs_one():
    free = nearness(np.ones_like, np.zeros_like)
    grid = corridor.corridor_grid(CORRIDOR, PILOT, {"ground": free, "ceiling": free})
    (way,) = route.ways(grid, PILOT, **ENDS)
    assert way.cost.energy == pytest.approx(1.0, abs=1e-9)
    assert way.cost.risk == 0.0
    assert np.ptp(way.z_m) < 1e-9


def test_energy_and_risk_are_traded_along_the_front():
    grid = corridor.corridor_grid(LONG, PILOT, {"ground": GROUND, "ceiling": CEILING})
    found = route.ways(grid, PILOT, **FAR)
    assert len(found) >= 3
    assert all(
        b.cost.risk < a.cost.risk and b.cost.energy > a.cost.energy
        for a, b in itertools.pairwise(found)
    )
    cheap, safe = found[0], found[-1]
    assert np.median(cheap.z_m) < 2 * RADIUS < np.median(safe.z_m)
    best = route.cheapest(found, 0.01, 1000)
    assert best.cost.hi90 <= 0.01
    assert all(w.cost.energy >= best.cost.energy for w in found if w.cost.hi90 <= 0.01)
    with pytest.raises(
        InputRefused,
        match=(
            r"no way is shown to keep the risk below 1e-30\n.*the safest has .* at most .* by 1000"
            r" flights"
        ),
    ):
        route.cheapest(found, 1e-30, 1000)


def test_a_way_is_chosen_by_what_is_shown_and_not_by_the_estimate():
    """The same corridor known to a factor of e^3: the way that the estimate would allow is no
    longer chosen.
    """
    ways = {
        spread: route.ways(
            corridor.corridor_grid(
                LONG,
                PILOT,
                {"ground": nearness(GROUND.power, GROUND.hazard, spread)} | {"ceiling": CEILING},
            ),
            PILOT,
            **FAR,
        )
        for spread in (0.0, 3.0)
    }
    sure, unsure = (route.cheapest(found, 0.01, 1000) for found in ways.values())
    assert unsure.cost.energy > sure.cost.energy
    assert unsure.cost.risk < sure.cost.risk <= 0.01
    assert unsure.cost.lo90 < unsure.cost.risk < unsure.cost.hi90 <= 0.01
    assert sure.cost.lo90 == pytest.approx(sure.cost.risk)


def test_every_point_says_what_its_risk_rests_on():
    grid = corridor.corridor_grid(CORRIDOR, PILOT, {"ground": GROUND, "ceiling": CEILING})
    far = nearness(np.ones_like, np.zeros_like)
    for z_hat, basis in ((1.5, 0), (3.0, 1), (5.0, 2)):
        k = int(np.abs(grid.z_m - z_hat * RADIUS).argmin())
        assert (
            corridor.corridor_grid(CORRIDOR, PILOT, {"ground": GROUND, "ceiling": far}).basis(
                np.array([k])
            )[0]
            == basis
        )
    # near the ceiling the ceiling's risk is the larger, and decides
    top = int(np.abs(grid.z_m - (0.4 - 1.5 * RADIUS)).argmin())
    assert grid.basis(np.array([top]))[0] == 0
    for way in route.ways(grid, PILOT, **ENDS):
        assert len(way.basis) == len(way.z_m)


def test_energy_and_risk_of_a_way_are_those_of_its_points():
    grid = corridor.corridor_grid(LONG, PILOT, {"ground": GROUND, "ceiling": CEILING})
    way = route.ways(grid, PILOT, **FAR)[-1]
    at = [np.searchsorted(grid.x_m, way.x_m - 1e-9), np.searchsorted(grid.z_m, way.z_m - 1e-9)]
    time = np.hypot(np.diff(way.x_m), np.diff(way.z_m)) / PILOT.speed_m_s
    power, hazard = (
        0.5 * (v[tuple(at)][1:] + v[tuple(at)][:-1]) for v in (grid.power, grid.hazard)
    )
    climb = np.maximum(np.diff(way.z_m), 0).sum() / (2 * PILOT.induced_m_s)
    assert way.cost.energy == pytest.approx(
        ((power * time).sum() + climb) / (4.0 / PILOT.speed_m_s)
    )
    assert way.cost.risk == pytest.approx(-math.expm1(-(hazard * time).sum()))


def test_boxes_are_flown_around_and_raise_the_floor():
    boxed = corridor.Corridor(length_m=1.0, height_m=0.5, boxes=[(0.4, 0.6, 0.0, 0.25)])
    grid = corridor.corridor_grid(boxed, PILOT, {"ground": GROUND, "ceiling": CEILING})
    for way in route.ways(grid, PILOT, start=(0.0, 0.1), goal=(1.0, 0.1)):
        over = (way.x_m > 0.4 - PILOT.half_width_m) & (way.x_m < 0.6 + PILOT.half_width_m)
        assert (way.z_m[over] >= 0.25 + RADIUS * GROUND.lowest_z_hat - 1e-9).all()
    i, low, high = (
        int(np.abs(grid.x_m - 0.5).argmin()),
        int(np.abs(grid.z_m - 0.3).argmin()),
        int(np.abs(grid.z_m - 0.05).argmin()),
    )
    assert grid.power[i, low] == pytest.approx(float(GROUND.power((grid.z_m[low] - 0.25) / RADIUS)))
    assert not grid.free[i, high]


def test_refusals():
    blocked = corridor.Corridor(length_m=1.0, height_m=0.4, boxes=[(0.4, 0.6, 0.0, 0.39)])
    grid = corridor.corridor_grid(blocked, PILOT, {"ground": GROUND, "ceiling": CEILING})
    with pytest.raises(InputRefused, match=r"no way joins start and goal"):
        route.ways(grid, PILOT, **ENDS)
    with pytest.raises(
        InputRefused, match=r"simulate.route.goal: \(0.5, 0.2\) m is in or too near an obstacle"
    ):
        route.ways(grid, PILOT, start=(0.0, 0.2), goal=(0.5, 0.2))
    with pytest.raises(InputRefused, match=r"simulate.route.start: .*\n.*between 0.03"):
        route.ways(grid, PILOT, start=(0.0, 0.0), goal=(1.0, 0.2))
    low = corridor.corridor_grid(
        corridor.Corridor(length_m=1.0, height_m=0.04),
        PILOT,
        {"ground": GROUND, "ceiling": CEILING},
    )
    with pytest.raises(InputRefused, match="boxes, floor and ceiling leave no room there"):
        route.ways(low, PILOT, start=(0.0, 0.02), goal=(1.0, 0.02))
    with pytest.raises(
        InputRefused,
        match=(
            r"1000 by 100 m has 7.6e\+08 nodes of half a rotor radius\n  at this height plan 0.66 m"
            r" at a time"
        ),
    ):
        corridor.corridor_grid(
            corridor.Corridor(length_m=1000.0, height_m=100.0), PILOT, {"ground": GROUND}
        )


def test_a_boundary_without_a_model_is_given_a_berth():
    grid = corridor.corridor_grid(CORRIDOR, PILOT, {"ground": GROUND})
    assert not grid.free[:, grid.z_m > 0.4 - (corridor.BERTH - 0.1) * RADIUS].any()


def test_hazard_from_crash_rates():
    z_hat, flights, time = np.array([0.8, 1.0, 1.2, 1.4, 1.6]), 1000, 120.0
    crashes = np.array([1000, 500, 50, 0, 0])
    hazard = corridor.hazard_between(z_hat, crash_rate.estimate(crashes, flights), time)
    assert hazard(np.array([1.0]))[0] == pytest.approx(-math.log(0.5) / time, rel=1e-3)
    fine = hazard(np.linspace(0.8, 4, 200))
    assert (np.diff(fine) <= 1e-15).all()
    # where none crashed it stays at half a crash, however far away: nothing falls on because a
    # curve would
    assert hazard(np.array([1.4, 1.6, 5.0])) == pytest.approx(0.5 / (flights + 1) / time, rel=1e-3)
    drawn = corridor.hazard_between(
        z_hat, np.array([[0.5, 0.4, 0.3, 0.2, 0.1], [0.1, 0.1, 0.1, 0.1, 0.0]]), time
    )(np.array([0.8, 1.1]))
    assert drawn.shape == (2, 2)
    assert drawn[1] == pytest.approx(-math.log(0.9) / time)
