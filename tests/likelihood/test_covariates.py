"""What effects need of trials in which something was logged with gaps, never changed, or is not
there.
"""

import dataclasses

import numpy as np
import pytest
from tests.unit.simulated import campaign, findings

from nearlift import catalogue
from nearlift.effects.gain import density
from nearlift.fit.least_squares import fit
from nearlift.likelihood.covariates import derive, missing, unlogged
from nearlift.loop.diagnose import USUAL, set_up
from nearlift.loop.search_problem import Options

DENSITY = catalogue.effect("air_density")
#: One whose own covariate is such as nobody misses in others.
OF_HUMIDITY = dataclasses.replace(DENSITY, varies_with="humidity")
#: Humidity logged: as it was, with a gap, as one value, not at all.
LOGS = {
    "whole": lambda h: h,
    "gap": lambda h: np.where(np.arange(len(h)) == 5, np.nan, h),
    "constant": lambda h: np.full_like(h, 0.4),
    "never": lambda h: np.full_like(h, np.nan),
}


@pytest.fixture
def logged(request):
    data = campaign(1)
    rng = np.random.default_rng(1)
    air = {
        "temperature_K": 293 + 3 * rng.standard_normal(data.n),
        "pressure_Pa": 1e5 + 300 * rng.standard_normal(data.n),
        "humidity": LOGS[request.param](rng.uniform(0.3, 0.6, data.n)),
    }
    return dataclasses.replace(data, covariates={**data.covariates, **air})


@pytest.mark.parametrize("logged", LOGS, indirect=True)
def test_density_is_told_whatever_is_known_of_humidity(logged):
    known = derive(logged, logged.lift_N)
    assert missing(DENSITY, known) == ()
    if np.isfinite(logged.covariates["humidity"]).all():
        assert "humidity" in known.covariates
        return
    values = logged.covariates["humidity"][np.isfinite(logged.covariates["humidity"])]
    some = np.median(values) if len(values) else 0.5
    assert "humidity" not in known.covariates
    assert known.geometry["humidity"] == pytest.approx(some)


@pytest.mark.parametrize("logged", ["gap"], indirect=True)
def test_a_gap_takes_no_name_from_what_is_there(logged):
    air = {n: logged.covariates[n] for n in ("temperature_K", "pressure_Pa")}
    lift = logged.lift_N * density(**air, humidity=0.45) / density(293, 1e5, 0.45)
    found = findings(dataclasses.replace(logged, lift_N=lift), catalogue.model("sanchez_cuevas"))
    assert [e["name"] for e in found["effects"]] == ["air_density"]


@pytest.mark.parametrize(
    ("logged", "lacking"),
    [("whole", ()), ("gap", ("humidity",)), ("constant", ("humidity",)), ("never", ("humidity",))],
    indirect=["logged"],
)
def test_what_an_effect_varies_with_has_no_stand_in(logged, lacking):
    assert missing(OF_HUMIDITY, derive(logged, logged.lift_N)) == lacking


@pytest.mark.parametrize("logged", ["whole"], indirect=True)
def test_what_is_logged_is_not_asked_for(logged):
    assert unlogged(DENSITY, logged) == ()
    without = {k: v for k, v in logged.covariates.items() if k != "pressure_Pa"}
    assert unlogged(DENSITY, dataclasses.replace(logged, covariates=without)) == ("pressure",)


def test_what_the_trial_before_held_is_the_lift_of_the_model_there():
    """Not its own lift, whose noise would explain its neighbour's, and not L_inf alone."""
    data = campaign(1)
    level, ratio = np.linspace(0.2, 0.4, data.n), 1 + 0.2 * np.exp(-data.z_hat)
    before = derive(data, level, ratio).covariates["previous_lift_N"]
    first = np.r_[True, data.session[1:] != data.session[:-1]]
    assert np.all(before[first] == 0)
    assert np.array_equal(before[~first], (level * ratio)[:-1][~first[1:]])


def test_a_diagnosis_takes_that_lift_from_its_base_fit():
    base = catalogue.model("sanchez_cuevas")
    stage = set_up(campaign(1), base, (), Options())[0]
    known = stage.data.covariates
    first_fit = fit(base, stage.data, (), USUAL, offset_m=0.0)
    held = known["lift_inf_N"] * np.exp(stage.candidate().log_ratio(first_fit.theta))
    first = np.r_[True, stage.data.session[1:] != stage.data.session[:-1]]
    assert known["previous_lift_N"][~first] == pytest.approx(held[:-1][~first[1:]], rel=1e-12)
