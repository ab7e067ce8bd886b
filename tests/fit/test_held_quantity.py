"""The held quantity, by the exponent from lift and by logs, on trials whose truth is written out
here.
"""

import dataclasses

import numpy as np
import pytest
from tests.unit.simulated import campaign, hsiao, sanchez_cuevas

from nearlift import catalogue
from nearlift.fit import held_quantity, rotor
from nearlift.fit.least_squares import fit
from nearlift.results import Noise

CEILING = (0.12, 0.15, 0.2, 0.3, 0.4, 0.6, 1.0, 2.0, 6.0, 11.0)
NOISE = Noise(relative=0.004, force_N=3e-4, dof=240.0)


def examined(data, model="sanchez_cuevas"):
    fitted = fit(catalogue.model(model), data, (), NOISE)
    return held_quantity.examine(fitted.problem, fitted.theta, 1.65, "throttle")[0]


def ground(seed):
    return campaign(seed, height=0.0)


def test_the_exponent_that_was_put_in_is_found_near_the_ceiling():
    data = campaign(
        5, boundary="ceiling", ratio=lambda z: hsiao(z) ** (2 / 3), stations=CEILING, height=0.0
    )
    found = examined(data, "hsiao_chirarattananon")
    n = found.exponent_from_lift
    assert n.value == pytest.approx(2 / 3, abs=4 * n.u)
    assert n.u < 0.05
    at = {round(x.n, 2): x for x in found.plausible}
    assert [*at] == [1.0, 0.82, 0.67, 0.6]
    assert at[0.67].value == pytest.approx(0.125, abs=4 * at[0.67].u)
    assert at[1.0].value < at[0.67].value < at[0.6].value
    assert found.supported_exponents is None


def test_a_sidewall_cannot_tell_exponent_from_amplitude():
    data = campaign(
        6,
        boundary="sidewall",
        ratio=lambda z: 1 - 0.05 * np.exp(-z / 0.5),
        stations=CEILING,
        height=0.0,
    )
    found = examined(data, "sidewall_decay")
    # 1 - (1 - x)^n is n x to a few per cent: lift alone says next to nothing of n
    n = found.exponent_from_lift
    assert n is None or not n.u < 1.0
    assert found.plausible[-1].value == pytest.approx(found.plausible[0].value / 0.6, rel=0.05)


def logging(data, slope, spread=0.003):
    """Speed that answers to the change of lift with a power, about 166 Hz at a quarter and 330 Hz
    at nearly full throttle.
    """
    rng = np.random.default_rng(0)
    speed = (
        330
        * np.sqrt(data.throttle / 0.92)
        * sanchez_cuevas(data.z_hat) ** slope
        * np.exp(rng.normal(0, spread, data.n))
    )
    return dataclasses.replace(data, covariates={**data.covariates, "speed_Hz": speed})


def test_a_speed_that_follows_the_load_was_not_held_and_decides_the_exponent():
    data = logging(ground(7), -0.2)
    found = examined(data)
    speed, supply = found.logged
    assert (speed.quantity, supply.quantity) == ("speed_Hz", "supply_V")
    assert speed.response.value == pytest.approx(-0.2, abs=4 * speed.response.u)
    assert not speed.held
    assert speed.spread > 0.005
    low, high = found.supported_exponents
    # n = n_speed / (1 - 2 s): 0.60 to 0.82 over 1.4
    assert low < 0.6 / 1.4 < 0.82 / 1.4 < high
    assert min(x.value for x in found.supported) > found.plausible[0].value
    assert "rotor speed logged was not constant" in found.text
    assert "By theory the logs allow" in found.text


def test_a_held_speed_leaves_the_exponents_of_constant_speed():
    found = examined(logging(ground(8), 0.0))
    speed = found.logged[0]
    assert speed.held
    low, high = speed.exponents
    assert 0.5 < low < 0.6 < 0.82 < high < 0.95


def test_a_speed_that_explains_all_of_the_change_says_nothing_of_the_exponent():
    data = logging(ground(8), 0.5)
    speed = held_quantity.response(data, np.log(sanchez_cuevas(data.z_hat)), "speed_Hz").logged
    assert not speed.held
    assert speed.exponents is None


def test_held_quantities_are_accused_as_often_as_stated():
    """40 schedules at 1 %: more than four accusations is a chance of 4e-5."""
    ratio = np.log(sanchez_cuevas(ground(1).z_hat))
    accused = sum(
        not held_quantity.response(logging(ground(s), 0.0), ratio_of(s), "speed_Hz").logged.held
        for s in range(40)
    )
    assert ratio.max() > 0.05
    assert accused <= 4


def ratio_of(seed):
    return np.log(sanchez_cuevas(ground(seed).z_hat))


def test_power_comes_from_supply_and_current_and_theory_wants_two_thirds():
    data = ground(9)
    covariates = {**data.covariates, "current_A": 2.0 * data.throttle / data.covariates["supply_V"]}
    data = dataclasses.replace(data, covariates=covariates)
    found = examined(data)
    power = next(r for r in found.logged if r.quantity == "power_W")
    assert power.held
    assert power.response.value == pytest.approx(0, abs=1e-9)
    assert found.supported_exponents == pytest.approx((2 / 3, 2 / 3), abs=1e-6)


def test_distance_that_changes_with_the_session_tells_nothing():
    data = logging(ground(10), -0.2)
    data = dataclasses.replace(
        data, session=np.unique(data.z_hat, return_inverse=True)[1].astype(np.int64)
    )
    assert held_quantity.response(data, np.log(sanchez_cuevas(data.z_hat)), "speed_Hz") is None
    speed, u = rotor.logged_speed(data, ())
    assert speed == pytest.approx(330 * np.sqrt(data.levels / 0.92), rel=0.01)
    assert (u > 0).all()
