"""A wrong distance datum, declared so, in the loop: no misfit of visits left out, taken to first
order about its likeliest value where the slope of the curve does not carry it.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.fit.test_height_error import CEILING, datum, near_ceiling

from nearlift import catalogue
from nearlift.fit.least_squares import fit
from nearlift.loop import coefficients, confirmation, separation
from nearlift.loop.diagnose import diagnose, set_up
from nearlift.loop.families import families
from nearlift.loop.noise_floor import prepare
from nearlift.loop.result import result
from nearlift.loop.search import search_to_convergence
from nearlift.loop.search_problem import Options

from .simulated import RADIUS, campaign

GROUND = catalogue.model("sanchez_cuevas")


def test_visits_left_out_are_predicted_with_the_declared_errors_that_they_share():
    """0.1 mm off under a ceiling at 2.3 mm: to the noise where it is declared, and not without."""
    off, right = near_ceiling(3, off_m=1e-4, visits=15), near_ceiling(3, visits=15)
    declared, undeclared, quiet = (
        np.sqrt(np.mean(confirmation.held_out(stage, None).before ** 2))
        for stage in (
            set_up(data, CEILING, parts, Options())[0]
            for data, parts in ((off, (datum(1e-4),)), (off, ()), (right, ()))
        )
    )
    assert declared == pytest.approx(quiet, rel=0.05)
    assert undeclared > 1.2 * declared


def test_an_error_of_each_session_is_estimated_from_its_own_trials():
    data = campaign(4, visits=15, session_gain=0.02)
    gain = dataclasses.replace(datum(0.02), on="gain", scope="session")
    errors = [
        np.sqrt(np.nanmean(confirmation.held_out(stage, None).before ** 2))
        for stage in (
            set_up(data, GROUND, (gain,), Options())[0],
            set_up(campaign(4, visits=15), GROUND, (), Options())[0],
        )
    ]
    assert errors[0] == pytest.approx(errors[1], rel=0.1)


@pytest.mark.parametrize("off_m", [0.0, 0.3e-3, -0.5e-3, 1.2e-3])
def test_under_a_ceiling_the_loop_and_the_exact_fit_agree(off_m):
    data = near_ceiling(3, off_m=off_m, visits=6)
    parts = (datum(0.5e-3),)
    exact = fit(CEILING, data, parts)
    stage = set_up(data, CEILING, parts, Options())[0]
    assert np.array_equal(stage.datum.recorded.lift_N, data.lift_N)
    assert stage.datum.error_m == pytest.approx(exact.problem.offset_m, abs=3e-5)
    assert stage.data.z_hat == pytest.approx(data.z_hat + stage.datum.error_m / RADIUS)
    u = exact.estimates["alpha"].u
    assert stage.base_fit.vector[0] == pytest.approx(exact.theta[0], abs=0.25 * u)


def test_the_trial_before_stands_off_as_far():
    """Else every trial would seem to have moved since, if only by the datum."""
    stage = set_up(near_ceiling(3, off_m=1.2e-3, visits=6), CEILING, (datum(0.5e-3),), Options())[0]
    z_hat, came = stage.data.z_hat, stage.data.covariates["previous_z_hat"]
    assert stage.datum.error_m > 1e-3
    assert np.array_equal(came[1:], np.where(came[1:] > 0, z_hat[:-1], 0.0))
    recorded = dataclasses.replace(stage.datum, error_m=0.0).data
    moves = [
        [f.columns for f in families(data) if f.name == "last move"]
        for data in (stage.data, recorded)
    ]
    assert np.array_equal(np.sign(moves[0][0][:, 0]), np.sign(moves[1][0][:, 0]))


def test_trials_and_places_are_named_by_the_distances_recorded():
    data = near_ceiling(3, off_m=1.2e-3, visits=6)
    stage = set_up(data, CEILING, (datum(0.5e-3),), Options())[0]
    answer = search_to_convergence(stage)
    offered = [p.text for p in separation.menu(stage.as_recorded)]
    assert "more visits at the closest distance, z_hat = 0.1" in offered
    quoted = result(answer, coefficients.answers(answer), None).coefficients["alpha"]
    named = quoted.influence.trial, quoted.influence.visit
    assert all(one.z_hat in data.z_hat for one in named)


def test_where_the_slope_carries_it_trials_stay_as_recorded():
    data = campaign(9, visits=8)
    stage = set_up(data, GROUND, (datum(0.2e-3),), Options())[0]
    assert stage.datum.parts == ()
    assert np.array_equal(stage.data.z_hat, data.z_hat)
    assert np.array_equal(stage.data.lift_N, data.lift_N)


def test_a_search_takes_the_datum_where_its_best_explanation_has_it():
    data = near_ceiling(3, off_m=0.6e-3, visits=6)
    best = set_up(data, CEILING, (datum(0.5e-3),), Options())[0]
    begun = best.base, best.effects, best.parts, best.theta, best.options
    answer = search_to_convergence(prepare(best.datum.at(0.0), *begun))
    assert answer.problem.datum.error_m == pytest.approx(best.datum.error_m, abs=0.25 * 0.5e-3)
    assert best.datum.likeliest(best.base_fit, best.slope) is best.datum


def test_a_null_under_a_ceiling_with_a_wrong_datum_is_adequate():
    for seed in range(4):
        data = near_ceiling(40 + seed, off_m=0.4e-3, visits=6)
        diagnosis = diagnose(data, CEILING, (datum(0.5e-3),), Options())
        findings = diagnosis.findings
        assert findings.verdict == "adequate"
        assert findings.error.before.held_out_rmse < 1.3 * findings.error.noise_floor
        quoted = diagnosis.quoted.coefficients["alpha"]
        assert quoted.lo90 - quoted.u < 0.125 < quoted.hi90 + quoted.u
        # what the page draws is what neither model nor declared errors explain
        assert np.std(diagnosis.residuals["before"]) < 1.3 * findings.error.noise_floor


def test_beyond_three_declared_uncertainties_it_is_no_datum():
    data = near_ceiling(3, off_m=1.5e-3, visits=6)
    assert set_up(data, CEILING, (datum(0.3e-3),), Options())[0].datum.error_m == 0.9e-3


def test_no_trial_is_taken_through_the_boundary():
    """2 mm declared at stations from 2.3 mm on: the rotor stands above the boundary whatever a fit
    says.
    """
    data = near_ceiling(3, off_m=-1.2e-3, visits=6)
    stage = set_up(data, CEILING, (datum(2e-3),), Options())[0]
    assert stage.datum.error_m == pytest.approx(-1.2e-3, abs=0.1e-3)
    assert (stage.datum.at(-1.0).data.z_hat > 0).all()
    assert diagnose(data, CEILING, (datum(2e-3),), Options()).findings.verdict == "adequate"
