"""Flights from the equations alone, in SI units with gusts of their own, beside the product: levels
lie where it states them, and what it advises is survived at the rate that it states.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.campaign.forecasts import Simulate
from nearlift.declare import compose
from nearlift.flight import paper
from nearlift.flight.fitted import conditions, fitted_flights
from nearlift.flight.fitted_lift import FittedLift
from nearlift.flight.vehicle import CRAZYFLIE_AS_PRINTED

KEY = 20210401
R, MASS, G = 0.023, 0.027, 9.8
#: Lift over frequency squared: four rotors, C_L = 1.6, 1.2 kg/m^3.
K = 4 * 1.6 * 1.2 * R**4


def ground(z_hat, spacing_m=0.090, K_b=2.0):
    """Sanchez-Cuevas 2017, eq. 4; four rotors in a square."""
    d2 = (spacing_m / R) ** 2
    adjacent, opposite = d2 + 4 * z_hat**2, 2 * d2 + 4 * z_hat**2
    images = 1 / (16 * z_hat**2) + z_hat / (adjacent * np.sqrt(adjacent))
    return 1 / (1 - images - (0.5 + 2 * K_b) * z_hat / (opposite * np.sqrt(opposite)))


def ceiling(z_hat, alpha=0.125):
    """Hsiao and Chirarattananon 2019."""
    return 0.5 + 0.5 * np.sqrt(1 + alpha / z_hat**2)


@dataclass(frozen=True)
class Vehicle:
    """What flies; `contact` and the bound on its ratio in radii."""

    ratio: Callable[[np.ndarray], np.ndarray]
    side: float = 1.0
    contact: float = 0.0
    bound: float = 0.5
    most_N: float = np.inf


def rate_at(vehicle, z_hat, flights, step_s, seed, order=1):
    """Share of flights of 120 s that touch: a force of 0.015 N held for 0.1 s, the PID of Eq. 5; by
    Euler's scheme or (order 2) by Heun's.
    """
    rng = np.random.default_rng(seed)
    s, z0, most = vehicle.side, z_hat * R, np.sqrt(vehicle.most_N / K)
    f0 = np.sqrt(MASS * G / (K * float(vehicle.ratio(np.array(z_hat)))))
    # height, speed, integral of the error: a row each
    state = np.stack([np.full(flights, x) for x in (z0, 0.0, 0.0)])

    def slope(now, gust):
        error = 316.0 * (now[0] - z0) + 316.0 * now[1] + 31.6 * now[2]
        turning = np.clip(f0 - s * error, 0.0, most)
        lift = K * turning**2 * vehicle.ratio(np.maximum(now[0] / R, vehicle.bound))
        return np.stack([now[1], s * (lift + gust - MASS * G) / MASS, now[0] - z0])

    for _ in range(1200):
        gust = 0.015 * rng.standard_normal(state.shape[1])
        alive = np.ones(state.shape[1], dtype=bool)
        for _ in range(round(0.1 / step_s)):
            k = slope(state, gust)
            if order == 2:
                k = 0.5 * (k + slope(state + step_s * k, gust))
            state = state + step_s * k
            alive &= state[0] > vehicle.contact * R
        if not alive.all():
            # the others fly on
            state = state[:, alive]
    return 1 - state.shape[1] / flights


def lies_within(level, rate, widened=0.5):
    """Whether the level that `rate` (a function of height) has lies in the stated interval, widened
    by a share of itself on either side: a true statement is denied once in a thousand.
    """
    more = max(widened * (level.hi90 - level.lo90), 0.003)
    return rate(level.lo90 - more) > level.risk > rate(level.hi90 + more)


@pytest.mark.parametrize(
    ("boundary", "formula", "side"), [("ground", ground, 1.0), ("ceiling", ceiling, -1.0)]
)
def test_levels_of_the_paper_s_vehicle(boundary, formula, side):
    """Explicit Euler at 0.1 s, 4000 flights against the product's 400."""
    how = paper.preset("paper").monte_carlo(boundary, 400, KEY)
    found, _ = paper.published_flights("paper", how, (0.5, 0.01))
    vehicle = Vehicle(formula, side)
    told = [level for level in found.levels if level.exponent == 1.0]
    assert [level.risk for level in told] == [0.5, 0.01]
    for level in told:
        assert lies_within(level, lambda z: rate_at(vehicle, z, 4000, 0.1, 5))


LIFT = {
    "ground": (
        "sanchez_cuevas",
        {"spacing_hat": 65 / 23, "diagonal_hat": np.sqrt(2) * 65 / 23},
        "K_b",
        2.0,
        1.14,
    ),
    "ceiling": ("hsiao_chirarattananon", {}, "alpha", 0.125, 0.1),
}


def fitted(boundary, contact_m, flights, craft=CRAZYFLIE_AS_PRINTED, **chosen):
    """A vehicle whose fit is known to 1 %, flown."""
    name, arguments, parameter, value, nearest = LIFT[boundary]
    rng = np.random.default_rng(2)
    lift = FittedLift(
        boundary=boundary,
        model=catalogue.model(name),
        arguments=arguments,
        best={parameter: value},
        intervals={},
        number=4,
        draws={parameter: value * (1 + 0.01 * rng.standard_normal(4))},
        source="draws",
        measured_z_hat=(nearest, 11.5),
    )
    asked = Simulate(flights=flights, **chosen)
    how = conditions(asked, boundary, craft, contact_m, KEY, map)
    return fitted_flights(lift, asked, how, "throttle", craft, 3)[0]


@pytest.mark.nightly
@pytest.mark.parametrize(("boundary", "contact_m"), [("ground", 0.024), ("ceiling", 0.002)])
def test_levels_and_advice_of_a_fitted_vehicle_that_touches(boundary, contact_m):
    """The demo's: levels by Heun's scheme with half the product's step. Each is flown 1,000 times,
    however few flights are asked for, and again with other gusts at a rate near its risk.
    """
    found = fitted(boundary, contact_m, 60, risks=[0.5, 0.05])
    assert (found.flights, found.draw_flights) == (1000, 60)
    z = contact_m / R
    formula = (lambda x: ground(x, 0.065)) if boundary == "ground" else ceiling
    vehicle = Vehicle(formula, 1.0 if boundary == "ground" else -1.0, contact=z, bound=z)
    for level in found.levels:
        assert level.agrees
        # as few flights as the product's: the comparison has twice the variance
        assert lies_within(level, lambda z: rate_at(vehicle, z, 1000, 0.025, 6, order=2), 1.0)
        assert level.advised
        # four standard deviations of a rate of 1000 flights, twice
        apart = 4 * np.sqrt(2 * level.risk * (1 - level.risk) / 1000)
        assert level.crashes / 1000 == pytest.approx(level.risk, abs=apart)
        assert level.rate_lo90 < level.crashes / 1000 < level.rate_hi90


def test_a_sagging_supply_sags_without_a_boundary_too(monkeypatch):
    """A ceiling without effect (alpha = 0): with and without it the same flights crash."""
    monkeypatch.setattr("nearlift.flight.fitted.ADVISED_FLIGHTS", 40)
    lift = FittedLift(
        boundary="ceiling",
        model=compose(catalogue.model("hsiao_chirarattananon"), catalogue.effect("supply_sag")),
        arguments={"supply_V": 1.0, "supply_ref_V": 1.0},
        best={"alpha": 0.0, "sag_exponent": 2.0},
        intervals={},
        number=2,
        draws={"alpha": np.zeros(2), "sag_exponent": np.full(2, 2.0)},
        source="draws",
        measured_z_hat=(0.1, 11.5),
        supply_V=(4.0, 3.7),
    )
    asked = Simulate(flights=20, risks=[0.5])
    how = conditions(asked, "ceiling", CRAZYFLIE_AS_PRINTED, 0.002, KEY, map)
    found, rows = fitted_flights(lift, asked, how, "throttle", CRAZYFLIE_AS_PRINTED, 3)
    assert found.droop == pytest.approx((3.7 / 4.0) ** 2 - 1)
    (level,) = found.levels
    assert level.value == level.without_model
    none, form = (
        [r["crashes"] for r in rows if r["member"] == -1 and r["below_nearest"] == below]
        for below in ("", "form")
    )
    assert none == form
    assert sum(none) > 0


@pytest.mark.nightly
def test_a_limit_of_thrust_as_the_equations_alone_have_it(monkeypatch):
    monkeypatch.setattr("nearlift.flight.fitted.ADVISED_FLIGHTS", 100)
    at = {"risks": [0.5], "set_points": {"ground": [1.2, 1.6, 2.0, 2.4, 2.8, 3.2]}}
    free, weak = (
        fitted("ground", 0.024, 100, replace(CRAZYFLIE_AS_PRINTED, most_lift_N=m * MASS * G), **at)
        for m in (9.0, 1.0)
    )
    assert free.levels[0].value < weak.levels[0].value
    vehicle = Vehicle(lambda x: ground(x, 0.065), contact=24 / 23, bound=24 / 23, most_N=MASS * G)
    assert lies_within(weak.levels[0], lambda z: rate_at(vehicle, z, 400, 0.025, 9, order=2))


def test_a_vehicle_that_cannot_lift_itself_comes_down(monkeypatch):
    """Lift limited to 99 % of the weight holds no vehicle up where the ground adds less."""
    monkeypatch.setattr("nearlift.flight.fitted.ADVISED_FLIGHTS", 20)
    weak = replace(CRAZYFLIE_AS_PRINTED, most_lift_N=0.99 * MASS * G)
    at = {"risks": [0.5], "set_points": {"ground": [3.0, 12.0]}}
    (level,) = fitted("ground", 0.024, 20, weak, **at).levels
    assert np.isnan(level.value) or level.value > 3.0
