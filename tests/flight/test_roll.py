"""Roll beside a wall, and the energy near a boundary."""

from __future__ import annotations

import math

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.flight import energy, roll

CRAZYFLIE = {"weight_N": 0.027 * 9.8, "arm_m": 0.0325, "spacing_hat": 65 / 23}


def wall(a):
    return lambda z: 1 - a * np.exp(-z / 0.5)


def test_roll_has_the_torque_of_the_near_pair():
    rng = np.random.default_rng(0)
    ratios = [wall(a) for a in (0.03, *rng.normal(0.03, 0.003, 200))]
    both = roll.roll_beside_wall(ratios, 0.1, **CRAZYFLIE, inertia_kg_m2=1.6e-5, rng=rng)
    near = both.near_pair_only
    assert near.torque_N_m[0] == pytest.approx(0.03 * math.exp(-0.2) * 0.027 * 9.8 * 0.0325)
    assert near.lo90_N_m[0] < near.torque_N_m[0] < near.hi90_N_m[0]
    assert both.same_law.torque_N_m[0] < near.torque_N_m[0]
    assert near.lo90_deg_s2 < near.acceleration_deg_s2 < near.hi90_deg_s2
    torque_alone = roll.roll_beside_wall(ratios, 0.1, **CRAZYFLIE, inertia_kg_m2=None, rng=rng)
    assert torque_alone.near_pair_only.acceleration_deg_s2 is None


def test_the_interval_of_the_acceleration_includes_the_inertia_s():
    rng = np.random.default_rng(0)
    near = roll.roll_beside_wall(
        [wall(0.03)] * 400, 0.1, **CRAZYFLIE, inertia_kg_m2=1.6e-5, rng=rng
    ).near_pair_only
    half = 0.5 * math.log(near.hi90_deg_s2 / near.lo90_deg_s2)
    assert half == pytest.approx(1.645 * 0.056, rel=0.2)
    assert near.lo90_N_m[0] == pytest.approx(near.hi90_N_m[0])


def test_energy_depends_on_the_held_quantity():
    """gamma at z_hat 0.5 and 0.1: 0.852 and 0.280 as the paper takes it, 0.899 and 0.428 as the
    theory means it.
    """
    gamma = catalogue.model("hsiao_chirarattananon")(np.array([0.5, 0.1]))
    assert energy.paper_cost(gamma) == pytest.approx([0.852, 0.280], abs=5e-4)
    assert energy.cost(gamma, "thrust")[1] == pytest.approx([0.899, 0.428], abs=5e-4)
    # one and the same rotor, described by thrusts at the same power
    assert energy.cost(gamma ** (2 / 3), "power")[1] == pytest.approx(1 / gamma)
    low, best, high = energy.cost(gamma, "rpm")
    assert (low < best).all()
    assert (best < high).all()
