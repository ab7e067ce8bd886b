"""The GUM budget: shares that add to the estimator's variance, and each line against
brute force.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.unit.simulated import GEOMETRY, RADIUS, campaign, part

from nearlift import catalogue
from nearlift.fit import information
from nearlift.fit.estimator import Estimator
from nearlift.fit.least_squares import assemble, fit
from nearlift.fit.solver import minimise, system
from nearlift.results import Noise

MODEL = catalogue.model("sanchez_cuevas_free_exponent")
SCATTER = Noise(
    relative=0.004, force_N=4e-4, height_m=1e-4, common=0.002, drift=(0.001, 0.0, 0.002)
)


PARTS = (
    part("height", 1e-4, "boundary"),
    part("height", 5e-5, "distance"),
    part("gain", 0.004, "session"),
    part("gain", 0.01, "throttle"),
    part("force", 5e-4, "campaign"),
    part("force", 1e-3, "trial"),
    part("gain", 0.02, "sample"),
    part("linearity", 0.5, "campaign", range_N=9.8),
)


def fitted(model=MODEL, parts=PARTS, scatter=SCATTER, **more):
    return fit(model, campaign(5, visits=4, **more), parts, scatter, offset_m=0.0)


def u_without(found):
    lines, u = information.uncertainty_budget(found), np.sqrt(np.diag(found.covariance))
    return information.u_without(found.problem, found.theta, lines, u)


def test_the_shares_add_to_the_variance_of_the_estimator():
    found = fitted()
    lines = information.uncertainty_budget(found)
    assert {line.component for line in lines} >= {p.name for p in PARTS} | set(
        information.NAMES.values()
    )
    assert sum(line.covariance for line in lines) == pytest.approx(found.covariance, rel=1e-8)
    u = np.sqrt(sum(np.diag(line.covariance) for line in lines))
    assert u == pytest.approx([e.u for e in found.estimates.values()], rel=1e-8)
    for line in lines:
        # sensitivity times input is the contribution, signed where the input is one number
        assert np.abs(line.sensitivity) * line.standard == pytest.approx(
            np.sqrt(np.diag(line.covariance)), rel=1e-9
        )
    gain = information.gain(found.problem, found.theta)
    assert gain @ found.problem.covariance.dense() @ gain.T == pytest.approx(
        found.covariance, rel=1e-8
    )


def test_u_without_a_source_is_that_of_a_fit_that_knows_it():
    found = fitted()
    without = u_without(found)
    assert set(without) == {line.component for line in information.uncertainty_budget(found)}

    def u(parts, scatter):
        problem = assemble(MODEL, found.problem.data, parts, scatter, found.theta, found.slope)
        white = problem.project(problem.jacobian(found.theta).T)
        return np.sqrt(np.diag(np.linalg.inv(white @ white.T)))

    for known in PARTS:
        assert without[known.name] == pytest.approx(
            u(tuple(p for p in PARTS if p is not known), SCATTER), rel=1e-8
        ), known.name
    for size, name in information.NAMES.items():
        assert without[name] == pytest.approx(
            u(PARTS, dataclasses.replace(SCATTER, **{size: () if size == "drift" else 0.0})),
            rel=1e-8,
        ), name


def errors(name, rng, data, model, theta, draws):
    """Log lift with one kind of error alone, from what the kind means and not from the covariance,
    (draws, n).
    """
    known = {n: GEOMETRY[n] for n in model.needs}
    values = dict(zip((p.name for p in model.parameters), theta, strict=True))

    def log_ratio(error_m):
        return np.log(model.evaluate(data.z_hat + error_m / RADIUS, **values, **known))

    def by(label):
        index = np.unique(label, return_inverse=True)[1]
        return rng.standard_normal((draws, index.max() + 1))[:, index]

    def wander(trials):
        drift, keep = rng.standard_normal((draws, data.n)), np.exp(-1 / trials)
        for i in range(1, data.n):
            drift[:, i] = keep * drift[:, i - 1] + np.sqrt(1 - keep**2) * drift[:, i]
        return drift

    own, common = rng.standard_normal((draws, data.n)), rng.standard_normal((draws, 1))
    truth = np.log(data.lift_N)
    return {
        "noise within a record": lambda: np.log1p(own * data.u_lift_N / np.exp(truth)),
        "proportional scatter": lambda: own * SCATTER.relative,
        "force scatter": lambda: np.log1p(own * SCATTER.force_N / np.exp(truth)),
        "height scatter": lambda: log_ratio(by(data.visit) * SCATTER.height_m) - log_ratio(0.0),
        "visit-to-visit scatter": lambda: by(data.visit) * SCATTER.common,
        "slow drift": lambda: wander(1.5) * SCATTER.drift[0] + wander(24.0) * SCATTER.drift[2],
        "height by boundary": lambda: log_ratio(common * 1e-4) - log_ratio(0.0),
        "height by distance": lambda: log_ratio(by(data.z_hat) * 5e-5) - log_ratio(0.0),
        "gain by session": lambda: by(data.session) * 0.004,
        "gain by throttle": lambda: by(data.throttle) * 0.01,
        "force by campaign": lambda: np.log1p(common * 5e-4 / np.exp(truth)),
        "force by trial": lambda: np.log1p(own * 1e-3 / np.exp(truth)),
        "gain by sample": lambda: own * 0.02 / np.sqrt(data.n_eff),
        "linearity by campaign": lambda: np.log1p(
            common * 0.5 * (np.exp(truth) / 9.8) ** 2 / np.exp(truth)
        ),
    }[name]()


def test_every_line_is_what_brute_force_makes_of_its_error_alone():
    """2000 campaigns with one kind of error each, refitted: 26 standard deviations within 10 %, 6.3
    standard errors; chance of an alarm 1e-8.
    """
    found = fitted()
    problem = found.problem
    exact = (
        problem.log_ratio(found.theta)
        + np.log(np.array([e.value for e in found.levels.values()]))[problem.data.level]
    )
    data = dataclasses.replace(problem.data, lift_N=np.exp(exact), u_lift_N=problem.data.u_lift_N)
    problem = assemble(MODEL, data, PARTS, SCATTER, found.theta, found.slope)
    rng = np.random.default_rng(11)
    lines = {
        line.component: line
        for line in information.lines(
            problem, information.gain(problem, found.theta), PARTS, SCATTER, found.slope
        )
    }
    for name, line in lines.items():
        noisy = exact + errors(name, rng, data, MODEL, found.theta, 2000)
        white = problem.project(noisy)

        def residuals(theta, rows, white=white):
            return white[rows] - problem.project(problem.log_ratio(theta))

        minima = minimise(
            system(problem)._replace(residuals=residuals),
            np.tile(found.theta, (len(white), 1)),
            MODEL.bounds,
            np.sqrt(np.diag(found.covariance)),
        )
        assert minima.converged.all()
        theta = minima.theta
        assert theta.std(axis=0) == pytest.approx(
            np.sqrt(np.diag(line.covariance)), rel=0.1, abs=1e-6
        ), name
    assert lines["gain by throttle"].covariance == pytest.approx(
        np.zeros((2, 2)), abs=1e-12
    )  # L_inf takes it


def test_the_sensitivity_to_a_datum_is_what_moving_it_does():
    found = fitted(parts=(part("height", 1e-4, "boundary"),))
    line = next(
        a for a in information.uncertainty_budget(found) if a.component == "height by boundary"
    )
    step_m = 1e-6
    problem = found.problem
    moved = problem.moved(step_m).log_ratio(found.theta) - problem.log_ratio(found.theta)
    assert line.sensitivity == pytest.approx(
        information.gain(problem, found.theta) @ moved / step_m, rel=1e-3
    )
    assert line.unit == "m"


def test_welch_and_satterthwaite():
    """Independent parts: the textbook's formula. One part estimated with the other: their
    covariance enters.
    """
    lines = [
        dataclasses.replace(line, dof=np.array([5.0, 5.0]) if line.kind == "A" else line.dof)
        for line in information.uncertainty_budget(
            fitted(parts=(part("height", 1e-4, "boundary"),))
        )
    ]
    plain = information.effective_dof(lines, SCATTER, 2)
    u = np.array([np.sqrt(np.diag(line.covariance)) for line in lines])
    dof = np.array([np.broadcast_to(line.dof, 2) for line in lines])
    assert plain == pytest.approx((u**2).sum(axis=0) ** 2 / (u**4 / dof).sum(axis=0), rel=1e-9)
    spread = np.array([[0.1, -0.06], [-0.06, 0.1]])
    told = dataclasses.replace(
        SCATTER, sizes=("relative", "common"), log_covariance=tuple(map(tuple, spread))
    )
    v = np.array(
        [
            np.diag(next(a for a in lines if a.component == information.NAMES[n]).covariance)
            for n in told.sizes
        ]
    )
    rest = sum(
        2 * np.diag(a.covariance) ** 2 / a.dof
        for a in lines
        if a.component not in [information.NAMES[n] for n in told.sizes]
    )
    expected = 2 * (u**2).sum(axis=0) ** 2 / (4 * np.einsum("ip,ij,jp->p", v, spread, v) + rest)
    assert information.effective_dof(lines, told, 2) == pytest.approx(expected)


def test_a_scatter_that_repeats_tell_has_their_degrees_of_freedom():
    """240 trials in 40 cells leave 200 degrees of freedom, however they are dealt among parts that
    trade places.
    """
    data = campaign(8, visits=6, relative=0.01, force=0.0, height=0.0)
    data = dataclasses.replace(data, u_lift_N=np.zeros(data.n))
    found = fit(catalogue.model("sanchez_cuevas"), data)
    assert 0.5 * 200 < found.effective[0] < 1.2 * 200


def test_numbers_without_scatter_get_the_least_scatter_assumed():
    data = campaign(3, visits=2)
    data = dataclasses.replace(data, u_lift_N=np.zeros(data.n))
    found = fit(catalogue.model("sanchez_cuevas"), data, (), Noise(relative=0.0))
    (line,) = information.uncertainty_budget(found)
    assert line.component == "least scatter assumed"
    assert line.covariance == pytest.approx(found.covariance, rel=1e-6)


def test_a_coefficient_beside_a_free_exponent_is_that_of_a_fit_of_both():
    """Found on a line of exponents, without the fit of both."""
    data, scatter = campaign(3, visits=3, height=0.0), Noise(relative=0.004, force_N=3e-4)
    found = fit(catalogue.model("sanchez_cuevas"), data, (), scatter)
    (condition, value, u), _ = Estimator.from_fit(found)._exponents()
    both = fit(MODEL, data, (), scatter).estimates["K_b"]
    assert condition == "free exponent of the lift ratio"
    assert value == pytest.approx(both.value, rel=1e-4)
    assert u == pytest.approx(both.u, rel=1e-3)
    # which is far from what is known where the exponent is 1
    assert u > 4 * found.estimates["K_b"].u
