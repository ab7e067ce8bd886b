"""Deletion diagnostics: the closed form against dense algebra and against fits without
the trial.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.fit.deletion import influence
from nearlift.fit.least_squares import fit
from nearlift.results import Noise

from .simulated import campaign
from .test_predictive import CASES, SCATTER


def estimated(found, keep):
    """The coefficients from some of the trials by dense least squares about the fit's own optimum,
    the covariance as it is.
    """
    problem = found.problem
    data, covariance = problem.data, problem.covariance.dense()[np.ix_(keep, keep)]
    x = np.hstack([np.eye(len(data.levels))[data.level], problem.jacobian(found.theta)])[keep]
    y = (np.log(data.lift_N) - problem.log_ratio(found.theta))[keep]
    return np.linalg.lstsq(
        x.T @ np.linalg.solve(covariance, x), x.T @ np.linalg.solve(covariance, y), rcond=None
    )[0][len(data.levels) :]


@pytest.mark.parametrize("case", [name for name in CASES if name != "none"])
def test_the_closed_form_is_dense_least_squares_without_the_trial_or_the_visit(case):
    name, kind, parts = CASES[case]
    about = 2e-4 if case == "height error" else 0.0
    data = campaign(3, visits=3, **kind)
    found = fit(catalogue.model(name), data, parts, SCATTER, offset_m=about)
    moved, data = influence(found), found.problem.data
    u = np.sqrt(np.diag(found.covariance))
    whole = estimated(found, np.ones(data.n, dtype=bool))
    for i in (0, 17, 60):
        without = estimated(found, np.arange(data.n) != i)
        np.testing.assert_allclose(
            moved.of_trial[i] / u, (without - whole) / u, rtol=1e-5, atol=1e-7
        )
    for v in (0, 5, 11):
        apart = data.visit != moved.visit[v]
        without = estimated(found, apart)
        np.testing.assert_allclose(
            moved.of_visit[v] / u, (without - whole) / u, rtol=1e-5, atol=1e-7
        )


@pytest.mark.parametrize("size", [0.0, 0.03, -0.05])
def test_the_closed_form_is_a_fit_without_the_trial(size):
    """The curve is bent, so a trial that moves K_b by several u is foretold to a tenth of that, an
    ordinary one to a hundredth of u.
    """
    data = campaign(3, visits=4)
    nearest = int(np.argmin(data.z_hat + (data.throttle < 0.9)))
    data = replace(data, lift_N=data.lift_N * np.where(np.arange(data.n) == nearest, 1 + size, 1.0))
    model = catalogue.model("sanchez_cuevas")
    found = fit(model, data, (), SCATTER, offset_m=0.0)
    rest = np.arange(data.n) != nearest
    again = fit(model, data.take(rest), (), SCATTER, found.slope[rest], 0.0)
    shift, u = again.theta[0] - found.theta[0], found.estimates["K_b"].u
    assert influence(found).of_trial[nearest, 0] == pytest.approx(shift, rel=0.1, abs=0.01 * u)


def test_deletion_residuals_are_standard_normal_under_the_declared_scatter():
    """40 campaigns of 160 trials: the mean square of 6400 residuals is 1 within 0.09, five standard
    errors.
    """
    squares = []
    for seed in range(40):
        data = campaign(seed, height=1e-4)
        scatter = Noise(relative=0.004, force_N=3e-4, height_m=1e-4)
        data = replace(data, u_lift_N=np.zeros(data.n))
        squares.append(
            influence(
                fit(catalogue.model("sanchez_cuevas"), data, (), scatter, offset_m=0.0)
            ).residual
            ** 2
        )
    assert np.mean(squares) == pytest.approx(1.0, abs=0.09)


def test_what_the_others_do_not_determine_has_no_influence_to_tell():
    data = campaign(3, visits=4)
    alone = np.arange(data.n) == 7
    data = replace(data, throttle=np.where(alone, 0.6, data.throttle))
    moved = influence(fit(catalogue.model("sanchez_cuevas"), data, (), SCATTER, offset_m=0.0))
    assert np.isnan(moved.residual[alone]).all()
    assert np.isnan(moved.of_trial[alone]).all()
    assert np.isfinite(moved.residual[~alone]).all()
