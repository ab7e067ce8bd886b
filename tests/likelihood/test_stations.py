"""Distinct stations give what all trials give: chi2, L_inf, and the minima of resamples."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.unit.simulated import STATIONS, campaign, part

from nearlift import catalogue
from nearlift.fit.least_squares import fit
from nearlift.fit.solver import System, minimise, refine, system_at
from nearlift.likelihood.stations import Stations
from nearlift.results import Noise

SCATTER = Noise(relative=0.004, force_N=3e-4, height_m=1e-4, common=0.002, drift=(0.001,))


def fitted(name="sanchez_cuevas", apart=False):
    """A fit; trials at repeated stations, or `apart`, each at its own distance."""
    data = campaign(1)
    if apart:
        data = dataclasses.replace(data, z_hat=data.z_hat * np.linspace(1, 1.01, data.n)[::-1])
    parts = (part("height", 2e-4, "boundary"), part("gain", 0.004, "session"))
    return fit(catalogue.model(name), data, parts, SCATTER)


@pytest.mark.parametrize(
    ("name", "apart"),
    [
        ("sanchez_cuevas", False),
        ("sanchez_cuevas_free_exponent", False),
        ("cheeseman_bennett_fixed", False),
        ("sanchez_cuevas", True),
    ],
)
def test_chi2_and_levels_are_those_of_all_trials(name, apart):
    found = fitted(name, apart)
    rng = np.random.default_rng(1)
    # an effect of each trial's own
    problem = dataclasses.replace(found.problem, shift=0.01 * rng.normal(size=found.problem.data.n))
    stations = Stations.from_problem(problem)
    assert (stations.triangle is None) == apart
    assert apart or stations.at.data.n == len(STATIONS)
    theta = found.theta + 0.3 * rng.standard_normal((7, len(found.theta)))
    np.testing.assert_allclose(stations.chi2(theta), problem.chi2(theta), rtol=1e-9)
    levels = problem.best_levels(np.log(problem.data.lift_N) - problem.log_ratio(theta))
    np.testing.assert_allclose(stations.log_levels(theta), levels, rtol=1e-10)


def test_no_value_is_an_infinite_chi2():
    stations = Stations.from_problem(fitted().problem)
    assert stations.chi2(np.array([[2.0], [1e9]]))[1] == np.inf


@pytest.mark.parametrize("apart", [False, True])
def test_resamples_have_the_minima_that_all_trials_give(apart):
    model = catalogue.model("sanchez_cuevas_free_exponent")
    found = fitted(model.name, apart)
    problem = found.problem
    rng = np.random.default_rng(2)
    y = np.log(problem.data.lift_N) + rng.normal(0, 0.004, (40, problem.data.n))
    white = problem.project(y)
    by_trial = System(
        lambda theta, rows: white[rows] - problem.project(problem.log_ratio(theta)),
        lambda theta, _: problem.derivatives(theta),
    )
    stations = Stations.from_problem(problem)
    by_station = system_at(stations, stations.target(y))
    start, scale = np.tile(found.theta, (40, 1)), np.sqrt(np.diag(found.covariance))
    one, other = (minimise(s, start, model.bounds, scale) for s in (by_trial, by_station))
    assert one.converged.all()
    assert other.converged.all()
    thetas = [refine(s, m.theta, model.bounds) for s, m in ((by_trial, one), (by_station, other))]
    assert thetas[1] == pytest.approx(thetas[0], rel=1e-9)
    # less what no parameter changes
    fixed = one.chi2 - other.chi2
    shifted = np.clip(start + scale, *model.bounds)
    rows = np.arange(40)
    chi2 = [(s.residuals(shifted, rows) ** 2).sum(axis=1) for s in (by_trial, by_station)]
    assert chi2[0] - chi2[1] == pytest.approx(fixed, rel=1e-9, abs=1e-9)
