"""Stations and nodes give what all trials give: chi2, L_inf, and the minima of resamples."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from tests.unit.simulated import STATIONS, campaign, part

from nearlift import catalogue
from nearlift.fit.least_squares import fit
from nearlift.fit.solver import System, minimise, refine, system_at
from nearlift.likelihood.stations import NODES, Stations
from nearlift.results import Noise

SCATTER = Noise(relative=0.004, force_N=3e-4, height_m=1e-4, common=0.002, drift=(0.001,))


def fitted(name="sanchez_cuevas", apart=False, free_air=False, kink=0.0):
    """A fit; trials at repeated stations, or `apart`, each at its own distance, the last in free
    air; and an effect of each trial's own.
    """
    data, model = campaign(1), catalogue.model(name)
    if apart:
        data = dataclasses.replace(data, z_hat=data.z_hat * np.linspace(1, 1.01, data.n)[::-1])
    if free_air:
        data.z_hat[-2:] = np.inf
    if kink:
        smooth = model.evaluate

        @functools.wraps(smooth)
        def evaluate(z_hat, /, **values):
            return smooth(z_hat, **values) * (1 + kink * np.abs(np.minimum(z_hat, 9) - 2))

        model = dataclasses.replace(model, evaluate=evaluate)
    parts = (part("height", 2e-4, "boundary"), part("gain", 0.004, "session"))
    found = fit(model, data, parts, SCATTER)
    shift = 0.01 * np.random.default_rng(1).normal(size=data.n)
    return found, dataclasses.replace(found.problem, shift=shift)


def stations_of(found, problem):
    return Stations.from_problem(problem, found.theta, np.sqrt(np.diag(found.covariance)))


@pytest.mark.parametrize(
    ("count", "setting"),
    [
        (len(STATIONS), {}),
        (len(STATIONS), {"name": "sanchez_cuevas_free_exponent"}),
        (len(STATIONS), {"name": "cheeseman_bennett_fixed"}),
        (NODES, {"apart": True}),
        (NODES, {"apart": True, "name": "sanchez_cuevas_free_exponent"}),
        (NODES + 1, {"apart": True, "free_air": True}),
        # what no polynomial follows is evaluated at every trial
        (160, {"apart": True, "kink": 1e-6}),
    ],
)
def test_chi2_and_levels_are_those_of_all_trials(count, setting):
    found, problem = fitted(**setting)
    stations = stations_of(found, problem)
    assert stations.at.data.n == count
    spread = np.sqrt(np.diag(found.covariance))
    theta = found.theta + 3 * spread * np.random.default_rng(2).standard_normal((7, len(spread)))
    np.testing.assert_allclose(stations.chi2(theta), problem.chi2(theta), rtol=1e-9)
    levels = problem.best_levels(np.log(problem.data.lift_N) - problem.log_ratio(theta))
    np.testing.assert_allclose(stations.log_levels(theta), levels, rtol=1e-10)


@pytest.mark.parametrize("apart", [False, True])
def test_no_value_is_an_infinite_chi2(apart):
    stations = stations_of(*fitted(apart=apart))
    assert stations.chi2(np.array([[2.0], [1e9]]))[1] == np.inf


@pytest.mark.parametrize("apart", [False, True])
def test_resamples_have_the_minima_that_all_trials_give(apart):
    model = catalogue.model("sanchez_cuevas_free_exponent")
    found, problem = fitted(model.name, apart)
    rng = np.random.default_rng(2)
    y = np.log(problem.data.lift_N) + rng.normal(0, 0.004, (40, problem.data.n))
    white = problem.project(y)
    by_trial = System(
        lambda theta, rows: white[rows] - problem.project(problem.log_ratio(theta)),
        lambda theta, _: problem.derivatives(theta),
    )
    stations = stations_of(found, problem)
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
