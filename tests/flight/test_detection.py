"""Height from lift: the inverse, its coverage, folds, and the range of detection."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from nearlift import catalogue
from nearlift.errors import InputRefused
from nearlift.flight import detection
from nearlift.flight.detection import Sensor, change_needed

CRAZYFLIE = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}


def ground(K_b=2.0):
    model = catalogue.model("sanchez_cuevas")
    return lambda z: model(z, K_b=K_b, **CRAZYFLIE)


def wall(a=0.05, lambda_=0.5):
    return lambda z: 1 - a * np.exp(-z / lambda_)


def test_a_sharp_reading_is_turned_round():
    for z_hat in (1.0, 1.5, 2.5):
        found = detection.locate(float(ground()(z_hat)), 5e-4, [ground()], 0.6, 12.0)
        assert found.median == pytest.approx(z_hat, rel=0.02)
        assert found.lo90 <= z_hat
        assert found.hi90 >= z_hat
        assert found.beyond < 1e-6
    # as wide as the reading's error over the model's slope says
    slope = float(ground()(2.51) - ground()(2.49)) / 0.02
    assert found.hi90 - found.lo90 == pytest.approx(2 * 1.645 * 5e-4 / abs(slope), rel=0.15)


@pytest.mark.nightly
def test_intervals_hold_the_height_as_often_as_they_say():
    """Heights from the prior, models from their uncertainty, readings with noise: 90 % intervals of
    300; binomial sd 1.7 %.
    """
    rng = np.random.default_rng(5)
    draws = [ground(k) for k in rng.normal(2, 0.3, 80)]
    low, high, u = 0.8, 6.0, 0.004
    held = 0
    for _ in range(300):
        z_hat = math.exp(rng.uniform(math.log(low), math.log(high)))
        measured = float(ground(rng.normal(2, 0.3))(z_hat)) + u * rng.standard_normal()
        found = detection.locate(measured, u, draws, low, high)
        held += found.lo90 <= z_hat <= found.hi90
    assert 0.82 < held / 300 < 0.97


def test_a_reading_of_one_says_that_there_may_be_nothing():
    close = detection.locate(1.12, 0.003, [ground()], 0.8, 12.0)
    far = detection.locate(1.0, 0.003, [ground()], 0.8, 12.0)
    assert close.beyond < 1e-6
    assert far.beyond > 0.5
    assert far.lo90 > 5


def test_a_reading_far_from_every_height_in_reach_says_that_there_is_nothing():
    """Lift is L_inf to 0.1 % and the nearest that a ground within one radius gives is 7 % more:
    likelihoods below the smallest float.
    """
    found = detection.locate(1.0, 0.001, [lambda z: 1 / (1 - 1 / (16 * z**2))], 0.5, 1.0)
    assert found.beyond == pytest.approx(1.0)
    assert 0.99 < found.lo90 <= found.median <= found.hi90 <= 1.0


def test_the_model_s_uncertainty_widens_the_answer():
    measured = float(ground()(1.5))
    sure = detection.locate(measured, 0.002, [ground()], 0.8, 12.0)
    unsure = detection.locate(
        measured, 0.002, [ground(k) for k in np.linspace(1, 3, 21)], 0.8, 12.0
    )
    assert unsure.hi90 - unsure.lo90 > 2 * (sure.hi90 - sure.lo90)


def test_refusals():
    folded = lambda z: 1 + 0.2 * np.exp(-z) - 0.4 * np.exp(-3 * z)  # noqa: E731
    with pytest.raises(
        InputRefused, match=r"ground x: the model folds at z_hat = 0.8.*two heights\n.*above 0.8"
    ):
        detection.refuse_folds(folded, 0.2, 10.0, "ground x")
    detection.refuse_folds(folded, 1.0, 10.0, "ground x")
    detection.refuse_folds(wall(), 0.02, 10.0, "sidewall")
    with pytest.raises(InputRefused, match="does not change with distance"):
        detection.refuse_folds(np.ones_like, 0.2, 10.0, "wall")
    detection.refuse_folds(np.ones_like, 0.2, 10.0, "a draw at a bound", constant=True)
    with pytest.raises(InputRefused, match=r"no value at z_hat = 0.2"):
        detection.refuse_folds(catalogue.model("cheeseman_bennett_fixed"), 0.1, 10.0, "ground")
    with pytest.raises(InputRefused, match="standard uncertainties from everything"):
        detection.locate(2.0, 0.001, [ground()], 0.8, 12.0)
    with pytest.raises(InputRefused, match="positive standard uncertainty"):
        detection.locate(1.1, 0.0, [ground()], 0.8, 12.0)


def test_hover_throttle_is_a_lift_ratio():
    """Far away the vehicle hovers at 0.5; near the ground at less: the ratio is weight over what
    that throttle lifts far away.
    """
    levels, far = (0.25, 0.5, 0.75), (0.107, 0.2646, 0.409)
    assert detection.ratio_of_hover(0.5, 0.2646, 0.0, levels, far, 0.0) == pytest.approx((1.0, 0.0))
    ratio, u = detection.ratio_of_hover(0.45, 0.2646, 0.03, levels, far, 0.04)
    assert ratio > 1.1
    assert u == pytest.approx(0.05 * ratio)
    # between 0.25 and 0.5 lift goes as throttle to the power 1.307, and so does what 1 % of
    # throttle is worth
    power = math.log(0.2646 / 0.107) / math.log(2)
    assert detection.ratio_of_hover(0.45, 0.2646, 0.0, levels, far, 0.0, 0.0045)[
        1
    ] == pytest.approx(ratio * power * 0.01)
    with pytest.raises(InputRefused, match=r"0.9 is outside 0.25 to 0.75"):
        detection.ratio_of_hover(0.9, 0.2646, 0.0, levels, far, 0.0)


# ---- range


def test_alarms_and_misses_happen_as_often_as_asked():
    """40 000 readings with and without the change that is called noticeable: rates to 4 binomial
    sd.
    """
    rng = np.random.default_rng(2)
    sigma = Sensor(short_per_sqrt_Hz=0.01, floor=0.003).sigma(4.0, payload=0.002)
    assert sigma == pytest.approx(math.sqrt(0.005**2 + 0.003**2 + 0.002**2))
    change = change_needed(sigma, 0.01, 0.1)
    threshold = sigma * stats.norm.isf(0.01)
    noise = sigma * rng.standard_normal(40_000)
    assert (noise > threshold).mean() == pytest.approx(0.01, abs=0.002)
    assert (change + noise < threshold).mean() == pytest.approx(0.1, abs=0.006)


def test_range_is_where_the_model_gives_that_change():
    z_hat = detection.reach(ground(), 0.03, 0.8, 12.0)
    assert float(ground()(z_hat)) - 1 == pytest.approx(0.03, rel=1e-3)
    assert detection.reach(wall(), 0.02, 0.02, 10.0) == pytest.approx(0.5 * math.log(2.5), rel=1e-3)
    assert math.isnan(detection.reach(wall(), 0.06, 0.02, 10.0))
    assert detection.reach(ground(), 1e-9, 0.8, 12.0) == pytest.approx(12.0)


def test_averaging_widens_the_range_until_the_payload_stops_it():
    sensor = Sensor(short_per_sqrt_Hz=0.01, floor=0.0)
    ranges = [
        detection.reach(ground(), change_needed(sensor.sigma(t), 0.01, 0.1), 0.8, 12.0)
        for t in (0.1, 1.0, 10.0)
    ]
    assert ranges == sorted(ranges)
    known, unknown = (
        detection.reach(
            ground(), change_needed(sensor.sigma(100.0, payload=p), 0.01, 0.1), 0.8, 12.0
        )
        for p in (0.0, 0.05)
    )
    assert math.isnan(unknown) or unknown < 0.5 * known


def test_ranges_of_draws_count_the_undetectable():
    best, low, high = detection.reaches(
        [wall(0.05), *(wall(a) for a in np.linspace(0.03, 0.07, 40))], 0.04, 0.02, 10.0
    )
    assert low == 0.0
    assert low < best < high
