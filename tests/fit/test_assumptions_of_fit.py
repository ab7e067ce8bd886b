"""Throttle collapse, held quantity, rotor coefficient: on trials whose truth is written
out here.
"""

import dataclasses

import numpy as np
import pytest
from scipy.stats import binom
from scipy.stats import t as student_t
from tests.unit.manifests import CRAZYFLIE, RIG
from tests.unit.simulated import GEOMETRY, RADIUS, campaign, hsiao, sanchez_cuevas

from nearlift import catalogue
from nearlift.campaign import manifest as manifests
from nearlift.errors import ManifestError
from nearlift.fit import collapse, held_quantity, rotor
from nearlift.fit.least_squares import assemble, fit
from nearlift.results import Noise

CEILING = (0.12, 0.15, 0.2, 0.3, 0.4, 0.6, 1.0, 2.0, 6.0, 11.0)
MANIFEST = {
    "schema": "nearlift.campaign/1",
    "name": "bench",
    "vehicle": CRAZYFLIE,
    "rig": RIG | {"air_density": "1.2 kg/m^3"},
    "records": {"reader": "means"},
}
NOISE = Noise(relative=0.004, force_N=3e-4, dof=240.0)


def problem_of(data, model="sanchez_cuevas", parts=()):
    fitted = fit(catalogue.model(model), data, parts, NOISE)
    return assemble(catalogue.model(model), data, parts, NOISE, fitted.theta), fitted


def ground(seed, **more):
    return campaign(seed, height=0.0, **more)


def at_throttle(low, high):
    """A K_b that differs between the lower and the upper throttles."""

    def ratio(z, levels):
        return np.where(levels < 0.6, sanchez_cuevas(z, low), sanchez_cuevas(z, high))

    return ratio


def uneven(seed, low, high):
    data = ground(seed)
    factor = at_throttle(low, high)(data.z_hat, data.throttle) / sanchez_cuevas(data.z_hat)
    return dataclasses.replace(data, lift_N=data.lift_N * factor)


def collapse_of(data, model="sanchez_cuevas", parts=()):
    return collapse.examine(problem_of(data, model, parts)[1])


# ---------------------------------------------------------------- collapse


def test_a_collapse_is_rejected_as_often_as_stated():
    """60 campaigns at 5 %: the count lies in its 99.9 % band unless the library errs."""
    results = [collapse_of(ground(s)) for s in range(60)]
    low, high = binom.interval(0.999, 60, 0.05)
    assert low <= sum(r.test.p_value < 0.05 for r in results) <= high
    # the bound holds the truth, which is 0, over all pairs at once at 95 %: ten misses are a chance
    # of 1 in 3000
    departures = [r.largest_departure for r in results]
    assert sum(abs(d.value) > d.bound95 - abs(d.value) for d in departures) <= 9


def test_a_curve_that_depends_on_throttle_is_seen():
    found = collapse_of(uneven(1, 1.0, 3.0))
    assert found.test.p_value < 1e-4
    values = np.array([e.value for e in found.per_throttle.values()])
    assert values.mean() == pytest.approx(1)
    assert values[:2].max() < 1 < values[2:].min()
    departure = found.largest_departure
    assert departure.between[0] < 0.6 < departure.between[1]
    assert departure.bound95 > abs(departure.value) > 0.1


def test_the_scale_of_each_throttle_is_that_of_a_fit_with_scales():
    """The whitened least-squares problem with one column per throttle, written out."""
    problem, fitted = problem_of(ground(2))
    ratio, level = problem.log_ratio(fitted.theta), np.eye(4)[problem.data.level]
    columns = np.hstack([(level * ratio[:, None])[:, :3], problem.jacobian(fitted.theta)])
    columns[:, :3] -= (level * ratio[:, None])[:, 3:]
    white = problem.project(columns.T).T
    scales = np.linalg.lstsq(white, problem.residuals(fitted.theta), rcond=None)[0][:3]
    values = [e.value for e in collapse_of(ground(2)).per_throttle.values()]
    assert np.array(values) - 1 == pytest.approx([*scales, -scales.sum()], rel=1e-6)


@pytest.mark.parametrize("where", ["one throttle", "one distance"])
def test_what_cannot_be_compared_is_not_tested(where):
    data = ground(4)
    kept = data.throttle == 0.5 if where == "one throttle" else data.z_hat == data.z_hat.min()
    found = collapse_of(data.take(kept))
    assert (found.test, found.largest_departure, found.per_throttle) == (None, None, {})
    assert "cannot test" in found.text


# ---------------------------------------------------------------- held quantity


def test_the_exponent_that_was_put_in_is_found_near_the_ceiling():
    data = campaign(
        5, boundary="ceiling", ratio=lambda z: hsiao(z) ** (2 / 3), stations=CEILING, height=0.0
    )
    problem, fitted = problem_of(data, "hsiao_chirarattananon")
    found, _ = held_quantity.examine(problem, fitted.theta, 1.65, "throttle")
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
    problem, fitted = problem_of(data, "sidewall_decay")
    found, _ = held_quantity.examine(problem, fitted.theta, 1.65, "throttle")
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
    problem, fitted = problem_of(data)
    found, _ = held_quantity.examine(problem, fitted.theta, 1.65, "throttle")
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
    problem, fitted = problem_of(logging(ground(8), 0.0))
    found, _ = held_quantity.examine(problem, fitted.theta, 1.65, "throttle")
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
    problem, fitted = problem_of(data)
    found, _ = held_quantity.examine(problem, fitted.theta, 1.65, "throttle")
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


# ---------------------------------------------------------------- rotor


def test_c_l_follows_from_its_definition():
    # Bitcraze's table: 24.4 gf at 15924 rpm, four rotors of 23 mm
    assert rotor.coefficient(
        24.4e-3 * 9.8, 15924 / 60, air_density=1.2, radius_m=0.023, rotors=4
    ) == pytest.approx(2.53, abs=0.01)


def test_a_trend_with_speed_is_found_and_a_constant_is_kept():
    speed = np.array([180.0, 265.0, 342.0, 390.0])
    covariance = np.diag([2e-3**2] * 4)
    rng = np.random.default_rng(1)
    noise = rng.multivariate_normal(np.zeros(4), covariance, 400)
    rising = [
        rotor.trend(np.log(2.4 * (speed / 300) ** 0.1) + e, covariance, np.log(speed))
        for e in noise
    ]
    flat = [rotor.trend(np.log(np.full(4, 2.4)) + e, covariance, np.log(speed)) for e in noise]
    assert np.median([r.p_trend for r in rising]) < 1e-6
    assert np.mean([r.exponent.value for r in rising]) == pytest.approx(
        0.1, abs=4 * rising[0].exponent.u / 20
    )
    # 99.9 % band of 5 % of 400: a widened interval rejects less than it says, never more
    assert sum(f.p_trend < 0.05 for f in flat) <= binom.interval(0.999, 400, 0.05)[1]
    assert rotor.trend(np.log([2.4]), covariance[:1, :1], np.log(speed[:1])).p_trend is None


def test_scatter_about_the_power_law_widens_its_interval():
    speed, covariance = np.log([180.0, 265.0, 342.0, 390.0]), np.diag([1e-3**2] * 4)
    found = rotor.trend(np.log([2.4, 2.6, 2.4, 2.6]), covariance, speed)
    assert found.excess > 20
    assert found.exponent.hi90 - found.exponent.value == pytest.approx(
        student_t.ppf(0.95, 2) * found.exponent.u
    )
    assert found.p_trend > 0.05


def test_a_throttle_map_gives_c_l_and_outside_of_it_nothing():
    points = [["20 percent", "9600 rpm"], ["50 percent", "15924 rpm"], ["80 percent", "21461 rpm"]]
    given = manifests.parse(
        {
            **MANIFEST,
            "vehicle": {
                **MANIFEST["vehicle"],
                "throttle_map": {"points": points, "uncertainty": "1 percent"},
            },
        }
    )
    speed = given.vehicle.throttle_map.speed_Hz(np.array([0.1, 0.5, 0.65, 0.92]))
    assert speed[1:3] == pytest.approx([265.4, 311.5], abs=0.1)
    assert np.isnan(speed[[0, 3]]).all()
    _, fitted = problem_of(ground(11))
    found = rotor.examine(given, fitted, ())
    assert list(found.per_throttle) == [0.25, 0.5, 0.75]
    entry = found.per_throttle[0.5]
    level = fitted.levels[0.5]
    assert entry.value == pytest.approx(level.value / (4 * 1.2 * 265.4**2 * RADIUS**4), rel=1e-4)
    # twice the speed's uncertainty, and L_inf's
    assert entry.u / entry.value == pytest.approx(np.hypot(0.02, level.u / level.value), rel=1e-3)
    assert "from the paper's 1.6" in found.text


def test_a_map_that_does_not_ascend_is_refused():
    points = [["50 percent", "15924 rpm"], ["25 percent", "10885 rpm"]]
    with pytest.raises(ManifestError, match=r"points: must ascend"):
        manifests.parse(
            {**MANIFEST, "vehicle": {**MANIFEST["vehicle"], "throttle_map": {"points": points}}}
        )


def test_what_is_lacking_is_said():
    problem, fitted = problem_of(ground(12))
    assert "log rpm in trials.csv" in rotor.examine(manifests.parse(MANIFEST), fitted, ()).text
    rig = {k: v for k, v in MANIFEST["rig"].items() if k != "air_density"}
    known = {"points": [["25 percent", "10885 rpm"], ["92 percent", "23500 rpm"]]}
    bare = manifests.parse(
        {**MANIFEST, "rig": rig, "vehicle": {**MANIFEST["vehicle"], "throttle_map": known}}
    )
    found = rotor.examine(bare, fitted, ())
    assert found.air_density == pytest.approx(1.2, rel=0.05)
    cold = dataclasses.replace(problem.data, covariates={})
    blind = dataclasses.replace(fitted, problem=dataclasses.replace(problem, data=cold))
    found = rotor.examine(bare, blind, ())
    assert found.missing == ("air_density",)
    assert GEOMETRY["spacing_hat"] == pytest.approx(problem.data.geometry["spacing_hat"])
