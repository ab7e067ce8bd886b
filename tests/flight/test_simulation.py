"""Simulated flights: tables, gusts, schemes, groups, and independence of blocks and workers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from nearlift import catalogue
from nearlift.errors import InputRefused, ManifestError
from nearlift.flight import paper
from nearlift.flight.paper import CRAZYFLIE_AS_PRINTED, DISTURBANCE, GAINS
from nearlift.flight.simulation import normals, tabulate
from nearlift.flight.vehicle import Craft, Gains, Groups
from nearlift.run.workers import open_executor

KEY = 20210401
NO_BOUNDARY = tabulate([np.ones_like], 0.5)


def test_the_table_is_the_model():
    model = catalogue.model("sanchez_cuevas")
    curves = tabulate([lambda z: model(z, **paper.GEOMETRY)], 0.5)
    z_hat = np.linspace(0.5, 15, 999)
    assert curves.at(z_hat)[0] == pytest.approx(model(z_hat, **paper.GEOMETRY), abs=1e-4)
    assert curves.at(np.array([0.1]))[0, 0] == pytest.approx(model(0.5, **paper.GEOMETRY))
    singular = catalogue.model("cheeseman_bennett_fixed")
    with pytest.raises(InputRefused, match=r"L / L_inf has no value at z_hat = 0.2"):
        tabulate([lambda z: singular(z)], 0.1)


def test_runge_kutta_and_fine_euler_crash_alike():
    """With a step of 1/64 hold explicit Euler agrees with Runge-Kutta flight by flight, but for a
    few.
    """
    how = paper.simulation("converged", "ground", 60, KEY)
    fine = replace(how, runge_kutta=False, steps_per_hold=64)
    one, two = (h.ended(NO_BOUNDARY, [0.8, 0.9, 1.0]) >= 0 for h in (how, fine))
    assert (one != two).mean() < 0.05


@pytest.mark.parametrize("workers", ["threads:3", "processes:2"])
def test_workers_blocks_and_order_change_nothing(workers):
    how, targets = paper.simulation("paper", "ground", 170, KEY), [0.8, 1.0, 1.2]
    alone = how.ended(NO_BOUNDARY, targets)
    with open_executor(workers) as pool:
        assert np.array_equal(replace(how, spread=pool.map).ended(NO_BOUNDARY, targets), alone)

    def from_behind(fly_block, firsts):
        done = {first: fly_block(first) for first in reversed(list(firsts))}
        return [done[first] for first in sorted(done)]

    assert np.array_equal(replace(how, spread=from_behind).ended(NO_BOUNDARY, targets), alone)
    # more flights do not change the first ones
    assert np.array_equal(replace(how, flights=60).ended(NO_BOUNDARY, targets), alone[:, :60])


def test_supply_and_slow_gusts_crash_more():
    how = paper.simulation("converged", "ground", 300, KEY)
    steady, sagging = (how.ended(NO_BOUNDARY, 1.0, 0, [0.0, -0.2]) >= 0).sum(axis=1)
    assert sagging > steady + 30
    how = paper.simulation("paper", "ground", 200, KEY)
    slow = replace(how.groups, correlation=3 * how.groups.hold)
    crashed = (replace(how, groups=slow).ended(NO_BOUNDARY, 1.5) >= 0).mean()
    assert crashed > (how.ended(NO_BOUNDARY, 1.5) >= 0).mean() + 0.1


def test_a_trace_is_the_flight_that_was_counted():
    how = paper.simulation("paper", "ground", 60, KEY)
    ended = how.ended(NO_BOUNDARY, 1.0)
    crashing, living = int(np.flatnonzero(ended >= 0)[0]), int(np.flatnonzero(ended < 0)[0])
    heights = how.trace(NO_BOUNDARY, 1.0, 0, crashing)
    assert np.isnan(heights[ended[crashing] + 2 :]).all()
    assert heights[ended[crashing] + 1] <= 0 < heights[ended[crashing]]
    assert np.nanmin(how.trace(NO_BOUNDARY, 1.0, 0, living)) > 0


def test_gusts_of_flights_and_keys_are_independent_normals_addressed_by_number():
    assert np.array_equal(normals(1, 2, 5), normals(1, 2, 1000)[:5])
    across = np.array([normals(1, f, 500) for f in range(200)])
    assert stats.kstest(across[:, 0], "norm").pvalue > 1e-4
    correlation = np.corrcoef(across)[np.triu_indices(200, 1)]
    assert abs(correlation).max() < 0.3  # 19 900 pairs at sd 0.045: 6.7 sigma
    assert not np.intersect1d(normals(1, 0, 500), normals(2, 0, 500)).size


# ---- groups and gains


def test_groups_are_the_paper_s():
    groups = Groups.scaled(CRAZYFLIE_AS_PRINTED, GAINS["ceiling"], DISTURBANCE, 120.0)
    scale = 4 * 1.6 * 1.2 / 0.027
    assert groups.alpha == pytest.approx(316 * math.sqrt(scale * 0.023**6 / 9.8))
    assert groups.beta == pytest.approx(316 * math.sqrt(scale * 0.023**5))
    assert groups.gamma == pytest.approx(31.6 * math.sqrt(scale * 0.023**7 / 9.8**2))
    assert (groups.delta, round(groups.hold, 2)) == (1.0, 2.06)
    back = groups.gains(CRAZYFLIE_AS_PRINTED)
    assert (back.kP, back.kD, back.kI) == pytest.approx((316, 316, 31.6))


def test_two_vehicles_with_equal_groups_crash_alike_and_others_do_not():
    """A vehicle of three times the size and ten times the mass, its gains and gusts carried over:
    the same flights crash.
    """
    groups = paper.groups("ground")
    big = Craft(radius_m=0.07, mass_kg=0.4, gravity_m_s2=9.81, density_kg_m3=1.1, C_L=2.5, rotors=4)
    carried = Groups.scaled(
        big, groups.gains(big), groups.disturbance(big), groups.duration * big.time_s
    )
    unscaled = Groups.scaled(big, GAINS["ground"], DISTURBANCE, 120.0)
    how = paper.simulation("paper", "ground", 150, KEY)
    one, two, other = (
        replace(how, groups=g).ended(NO_BOUNDARY, [0.9, 1.0, 1.1, 1.2]) >= 0
        for g in (groups, carried, unscaled)
    )
    assert (one != two).mean() < 0.01  # rounding may part a flight that grazes the ground
    assert (one.mean(axis=1) < other.mean(axis=1))[1:].all()
    assert carried.alpha == pytest.approx(groups.alpha)


@pytest.mark.parametrize(
    ("gains", "boundary"),
    [
        (GAINS["ceiling"], "ground"),
        (GAINS["ground"], "ceiling"),
        (Gains(kP=-316, kD=316, kI=-31.6), "ground"),
        (Gains(kP=0, kD=-316, kI=0), "ground"),
    ],
)
def test_unstable_gains_are_refused(gains, boundary):
    words = rf"gains.{boundary}: kP = .* do not bring .*\n.*negative above a ground"
    with pytest.raises(ManifestError, match=words):
        gains.refuse_unstable(CRAZYFLIE_AS_PRINTED, boundary)


def test_the_paper_s_gains_are_stable_with_the_right_sign():
    for boundary, gains in GAINS.items():
        gains.refuse_unstable(CRAZYFLIE_AS_PRINTED, boundary)
    poles = GAINS["ceiling"].poles(CRAZYFLIE_AS_PRINTED, "ceiling")
    assert sorted(poles.real) == pytest.approx([-16.6, -0.945, -0.113], abs=0.05)
