"""The rotor coefficient and its trend, on trials whose truth is written out here."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import binom
from scipy.stats import t as student_t
from tests.unit.manifests import CRAZYFLIE, RIG
from tests.unit.simulated import RADIUS, campaign

from nearlift import catalogue
from nearlift.campaign import manifest as manifests
from nearlift.errors import ManifestError
from nearlift.fit import rotor
from nearlift.fit.least_squares import fit
from nearlift.results import Noise

MANIFEST = {
    "schema": "nearlift.campaign/1",
    "name": "bench",
    "vehicle": CRAZYFLIE,
    "rig": RIG | {"air_density": "1.2 kg/m^3"},
    "records": {"reader": "means"},
}
NOISE = Noise(relative=0.004, force_N=3e-4, dof=240.0)


def fitted_to(seed):
    data = campaign(seed, height=0.0)
    return fit(catalogue.model("sanchez_cuevas"), data, (), NOISE)


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
    fitted = fitted_to(11)
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
    fitted = fitted_to(12)
    problem = fitted.problem
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
