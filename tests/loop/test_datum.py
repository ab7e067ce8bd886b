"""A stated zero error of the distance in the loop: a parameter of every candidate."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.fit.test_height_error import CEILING, NEAR, datum, near_ceiling
from tests.unit.simulated import GROUND, L_INF, campaign, hsiao, problem

from nearlift import catalogue
from nearlift.declare import compose
from nearlift.effects.ratio import near_wall_saturation
from nearlift.fit.least_squares import fit
from nearlift.loop import coefficients, confirmation
from nearlift.loop.diagnose import decide, diagnose
from nearlift.loop.findings import accepted_explanation
from nearlift.loop.search_problem import Options


def test_visits_left_out_are_predicted_with_the_declared_errors_that_they_share():
    """0.1 mm off under a ceiling at 2.3 mm: to the noise where it is declared, and not without."""
    off, right = near_ceiling(3, off_m=1e-4, visits=15), near_ceiling(3, visits=15)
    declared, undeclared, quiet = (
        np.sqrt(np.mean(confirmation.held_out(searched, None).before ** 2))
        for searched in (
            problem(data, CEILING, parts)
            for data, parts in ((off, (datum(1e-4),)), (off, ()), (right, ()))
        )
    )
    assert declared == pytest.approx(quiet, rel=0.05)
    assert undeclared > 1.2 * declared


def test_an_error_of_each_session_is_estimated_from_its_own_trials():
    data = campaign(4, visits=15, session_gain=0.02)
    gain = dataclasses.replace(datum(0.02), on="gain", scope="session")
    errors = [
        np.sqrt(np.nanmean(confirmation.held_out(searched, None).before ** 2))
        for searched in (
            problem(data, GROUND, (gain,)),
            problem(campaign(4, visits=15)),
        )
    ]
    assert errors[0] == pytest.approx(errors[1], rel=0.1)


@pytest.mark.parametrize("off_m", [0.0, -0.5e-3, 1.2e-3])
def test_under_a_ceiling_the_loop_and_the_exact_fit_agree(off_m):
    data, parts = near_ceiling(3, off_m=off_m, visits=6), (datum(0.5e-3),)
    exact = fit(CEILING, data, parts)
    found = problem(data, CEILING, parts).base_fit
    assert found.vector[1] == pytest.approx(exact.problem.offset_m, abs=3e-5)
    assert found.vector[0] == pytest.approx(exact.theta[0], abs=0.25 * exact.estimates["alpha"].u)


def test_the_accepted_explanation_draws_what_was_measured():
    """Saturation near a ceiling, where the base model lacks a third of the lift at 2.3 mm: to
    first order a datum of 0.1 mm would take the credit, with a curve of its own.
    """

    def saturated(z_hat):
        return near_wall_saturation(hsiao(z_hat), z_hat=z_hat, gap_hat2=0.02, saturation_power=0.68)

    data = campaign(
        1, boundary="ceiling", ratio=saturated, stations=NEAR, visits=8, height=5e-5, datum=1e-4
    )
    searched = problem(data, CEILING, (datum(1e-4),))
    assert "height_offset" not in {e.name for e in searched.effects}
    answer = decide(searched, False, 0.05)
    accepted = accepted_explanation(answer, coefficients.answers(answer))
    assert accepted.effects == ("near_wall_saturation",)
    values = {name: e.value for name, e in accepted.parameters.items()}
    assert abs(values["offset_m"]) < 3e-4
    assert values["alpha"] == pytest.approx(0.125, abs=4 * accepted.parameters["alpha"].u)
    whole = compose(CEILING, *map(catalogue.effect, ("height_offset", *accepted.effects)))
    for z_hat in NEAR[:4]:
        here = data.z_hat == z_hat
        measured = np.mean(data.lift_N[here] / [L_INF[t] for t in data.throttle[here]])
        drawn = whole.evaluate(z_hat, radius_m=data.radius_m, **values)
        assert drawn == pytest.approx(measured, rel=0.01)


def test_a_null_under_a_ceiling_with_a_wrong_datum_is_adequate():
    data = near_ceiling(40, off_m=0.4e-3, visits=6)
    diagnosis = diagnose(data, CEILING, (datum(0.5e-3),), Options())
    findings, quoted = diagnosis.findings, diagnosis.quoted.coefficients["alpha"]
    assert findings.verdict == "adequate"
    assert findings.error.before.held_out_rmse < 1.3 * findings.error.noise_floor
    assert quoted.lo90 - quoted.u < 0.125 < quoted.hi90 + quoted.u
    # the page draws what neither model nor stated errors explain
    assert np.std(diagnosis.residuals["before"]) < 1.3 * findings.error.noise_floor


def test_no_trial_is_moved_through_the_boundary():
    data = near_ceiling(3, off_m=-1.2e-3, visits=6)
    searched = problem(data, CEILING, (datum(2e-3),))
    assert searched.base_fit.vector[1] == pytest.approx(-1.2e-3, abs=0.1e-3)
    low, _ = searched.candidate().bounds
    assert low[1] == pytest.approx(-0.9 * 0.1 * data.radius_m)
