"""Ways through a corridor: what they cost, what they risk, and what is refused."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from nearlift.errors import InputRefused
from nearlift.simulation import route

RADIUS = 0.023
PILOT = route.Pilot(radius_m=RADIUS, half_width_m=0.055, speed_m_s=0.5, induced_m_s=4.0)
CORRIDOR = route.Corridor(length_m=1.0, height_m=0.4)
LONG = route.Corridor(length_m=4.0, height_m=0.4)
FAR = {"start": (0.0, 0.2), "goal": (4.0, 0.2)}
GROUND = route.Nearness(power=lambda z: 1 - 0.3 / z**2, hazard=lambda z: np.exp(-6 * (z - 0.5)), lowest_z_hat=1.0)
CEILING = route.Nearness(power=np.ones_like, hazard=lambda z: np.exp(-4 * (z - 1.0)), lowest_z_hat=1.0)
ENDS = {"start": (0.0, 0.2), "goal": (1.0, 0.2)}


def test_without_boundaries_the_way_is_straight_and_costs_one():
    free = route.Nearness(power=np.ones_like, hazard=np.zeros_like, lowest_z_hat=1.0)
    grid = route.field(CORRIDOR, PILOT, {"ground": free, "ceiling": free})
    (way,) = route.ways(grid, PILOT, **ENDS)
    assert way.energy == pytest.approx(1.0, abs=1e-9)
    assert way.risk == 0.0
    assert np.ptp(way.z_m) < 1e-9


def test_energy_and_risk_are_traded_along_the_front():
    grid = route.field(LONG, PILOT, {"ground": GROUND, "ceiling": CEILING})
    found = route.ways(grid, PILOT, **FAR)
    assert len(found) >= 3
    assert all(b.risk < a.risk and b.energy > a.energy for a, b in itertools.pairwise(found))
    cheap, safe = found[0], found[-1]
    assert np.median(cheap.z_m) < 2 * RADIUS < np.median(safe.z_m)
    best = route.cheapest(found, 0.01)
    assert best.risk <= 0.01
    assert all(w.energy >= best.energy for w in found if w.risk <= 0.01)
    with pytest.raises(InputRefused, match=r"no way keeps the risk below 1e-30\n.*the safest has"):
        route.cheapest(found, 1e-30)


def test_energy_and_risk_of_a_way_are_those_of_its_points():
    grid = route.field(LONG, PILOT, {"ground": GROUND, "ceiling": CEILING})
    way = route.ways(grid, PILOT, **FAR)[-1]
    at = [np.searchsorted(grid.x_m, way.x_m - 1e-9), np.searchsorted(grid.z_m, way.z_m - 1e-9)]
    time = np.hypot(np.diff(way.x_m), np.diff(way.z_m)) / PILOT.speed_m_s
    power, hazard = (0.5 * (v[tuple(at)][1:] + v[tuple(at)][:-1]) for v in (grid.power, grid.hazard))
    climb = np.maximum(np.diff(way.z_m), 0).sum() / (2 * PILOT.induced_m_s)
    assert way.energy == pytest.approx(((power * time).sum() + climb) / (4.0 / PILOT.speed_m_s))
    assert way.risk == pytest.approx(-math.expm1(-(hazard * time).sum()))


def test_boxes_are_flown_around_and_raise_the_floor():
    corridor = route.Corridor(length_m=1.0, height_m=0.5, boxes=[(0.4, 0.6, 0.0, 0.25)])
    grid = route.field(corridor, PILOT, {"ground": GROUND, "ceiling": CEILING})
    for way in route.ways(grid, PILOT, start=(0.0, 0.1), goal=(1.0, 0.1)):
        over = (way.x_m > 0.4 - PILOT.half_width_m) & (way.x_m < 0.6 + PILOT.half_width_m)
        assert (way.z_m[over] >= 0.25 + RADIUS * GROUND.lowest_z_hat - 1e-9).all()
    i, low, high = int(np.abs(grid.x_m - 0.5).argmin()), int(np.abs(grid.z_m - 0.3).argmin()), int(np.abs(grid.z_m - 0.05).argmin())
    assert grid.power[i, low] == pytest.approx(float(GROUND.power((grid.z_m[low] - 0.25) / RADIUS)))
    assert not grid.free[i, high]


def test_refusals():
    blocked = route.Corridor(length_m=1.0, height_m=0.4, boxes=[(0.4, 0.6, 0.0, 0.39)])
    grid = route.field(blocked, PILOT, {"ground": GROUND, "ceiling": CEILING})
    with pytest.raises(InputRefused, match=r"no way joins start and goal"):
        route.ways(grid, PILOT, **ENDS)
    with pytest.raises(InputRefused, match=r"simulate.route.goal: \(0.5, 0.2\) m is in or too near an obstacle"):
        route.ways(grid, PILOT, start=(0.0, 0.2), goal=(0.5, 0.2))
    with pytest.raises(InputRefused, match=r"simulate.route.start: .*\n.*between 0.03"):
        route.ways(grid, PILOT, start=(0.0, 0.0), goal=(1.0, 0.2))


def test_a_boundary_without_a_model_is_given_a_berth():
    grid = route.field(CORRIDOR, PILOT, {"ground": GROUND})
    assert not grid.free[:, grid.z_m > 0.4 - (route.BERTH - 0.1) * RADIUS].any()


def test_hazard_from_crash_rates():
    z_hat, flights, time = np.array([0.8, 1.0, 1.2, 1.4, 1.6]), 1000, 120.0
    hazard = route.hazard_of(z_hat, np.array([1000, 500, 50, 0, 0]), flights, time)
    assert hazard(np.array([1.0]))[0] == pytest.approx(-math.log(0.5) / time)
    fine = hazard(np.linspace(0.8, 4, 200))
    assert (np.diff(fine) <= 0).all()
    # where none crashed the fall goes on, and never above half a crash among the flights
    assert hazard(np.array([1.4]))[0] <= 0.5 / flights / time * 1.001
    assert hazard(np.array([1.6]))[0] < 0.7 * hazard(np.array([1.4]))[0]
    none = route.hazard_of(z_hat, np.zeros(5), flights, time)
    assert none(np.array([0.9, 3.0])) == pytest.approx(0.5 / flights / time, rel=1e-3)
