"""The GUM budget: shares that add to the estimator's variance, and each line against brute force.
What would halve an uncertainty: the number printed, tried out.
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
from nearlift.likelihood.budget import Component
from nearlift.results import Noise
from nearlift.rounding import plain, signed

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


def budget(found):
    lines = information.lines(found.problem, found.gain, found.parts, found.noise, found.slope)
    return {line.component: line for line in lines}


def test_the_shares_add_to_the_variance_of_the_estimator():
    found = fitted()
    lines = budget(found)
    assert lines.keys() >= {p.name for p in PARTS} | set(information.SCATTER_NAMES.values())
    variance = sum(line.variance for line in lines.values())
    assert variance == pytest.approx(np.diag(found.covariance), rel=1e-8)
    assert np.sqrt(variance) == pytest.approx([e.u for e in found.estimates.values()], rel=1e-8)
    for line in lines.values():
        # sensitivity times input is the contribution, signed where the input is one number
        assert np.abs(line.sensitivity) * line.standard == pytest.approx(
            np.sqrt(line.variance), rel=1e-9
        )
    assert found.gain @ found.problem.covariance.dense() @ found.gain.T == pytest.approx(
        found.covariance, rel=1e-8
    )


def test_the_joint_covariance_is_the_inverse_of_the_dense_information():
    found = fitted()
    problem, jacobian = found.problem, found.problem.jacobian(found.theta)
    joint = information.joint_information(problem, jacobian)
    own = dataclasses.replace(problem.covariance, shared=np.zeros((problem.data.n, 0))).dense()
    design = np.hstack([problem.covariance.shared, problem.data.level_design, jacobian])
    stated = np.zeros(design.shape[1])
    stated[joint.shared] = 1.0
    dense = np.linalg.inv(design.T @ np.linalg.solve(own, design) + np.diag(stated))
    assert joint.covariance == pytest.approx(dense, rel=1e-6, abs=1e-12)
    gain = dense @ np.linalg.solve(own, design).T
    assert joint.gain == pytest.approx(gain[joint.parameters], abs=1e-7)
    assert joint.level_gain == pytest.approx(gain[joint.levels], abs=1e-7)


def test_u_without_a_source_is_that_of_a_fit_that_knows_it():
    found = fitted()
    lines = budget(found)
    without = information.u_without(
        found.problem,
        found.problem.jacobian(found.theta),
        list(lines.values()),
        np.sqrt(np.diag(found.covariance)),
    )
    assert without.keys() == lines.keys()

    def u(parts, scatter):
        problem = assemble(MODEL, found.problem.data, parts, scatter, found.theta, found.slope)
        white = problem.project(problem.jacobian(found.theta).T)
        return np.sqrt(np.diag(np.linalg.inv(white @ white.T)))

    for known in PARTS:
        assert without[known.name] == pytest.approx(
            u(tuple(p for p in PARTS if p is not known), SCATTER), rel=1e-8
        ), known.name
    for size, name in information.SCATTER_NAMES.items():
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
    lines = budget(dataclasses.replace(found, problem=problem))
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
        assert theta.std(axis=0) == pytest.approx(np.sqrt(line.variance), rel=0.1, abs=1e-6), name
    # L_inf takes it
    assert lines["gain by throttle"].variance == pytest.approx(np.zeros(2), abs=1e-12)


def test_the_sensitivity_to_a_datum_is_what_moving_it_does():
    found = fitted(parts=(part("height", 1e-4, "boundary"),))
    line = budget(found)["height by boundary"]
    step_m = 1e-6
    problem = found.problem
    moved = dataclasses.replace(problem, offset_m=step_m).log_ratio(found.theta)
    moved = moved - problem.log_ratio(found.theta)
    assert line.sensitivity == pytest.approx(found.gain @ moved / step_m, rel=1e-3)
    assert line.unit == "m"


def test_welch_and_satterthwaite():
    """Independent parts: the textbook's formula. One part estimated with the other: their
    covariance enters.
    """
    lines = [
        dataclasses.replace(line, dof=np.array([5.0, 5.0]) if line.kind == "A" else line.dof)
        for line in budget(fitted(parts=(part("height", 1e-4, "boundary"),))).values()
    ]
    u2 = np.array([line.variance for line in lines])
    dof = np.array([np.broadcast_to(line.dof, 2) for line in lines])
    expected = u2.sum(axis=0) ** 2 / (u2**2 / dof).sum(axis=0)
    assert information.effective_dof(lines, SCATTER) == pytest.approx(expected, rel=1e-9)
    spread = np.array([[0.1, -0.06], [-0.06, 0.1]])
    estimated = dataclasses.replace(
        SCATTER, sizes=("relative", "common"), log_covariance=tuple(map(tuple, spread))
    )
    by_name = {line.component: line for line in lines}
    v = np.array([by_name.pop(information.SCATTER_NAMES[n]).variance for n in estimated.sizes])
    rest = sum(2 * line.variance**2 / line.dof for line in by_name.values())
    expected = 2 * u2.sum(axis=0) ** 2 / (4 * np.einsum("ip,ij,jp->p", v, spread, v) + rest)
    assert information.effective_dof(lines, estimated) == pytest.approx(expected)


def test_numbers_without_scatter_get_the_least_scatter_assumed():
    data = campaign(3, visits=2)
    data = dataclasses.replace(data, u_lift_N=np.zeros(data.n))
    found = fit(catalogue.model("sanchez_cuevas"), data, (), Noise(relative=0.0))
    lines = budget(found)
    assert list(lines) == ["least scatter assumed"]
    assert lines["least scatter assumed"].variance == pytest.approx(
        np.diag(found.covariance), rel=1e-6
    )


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


SMALL = Noise(relative=0.002, force_N=1e-4)


def datum(standard):
    return Component(name="distance datum", on="height", standard=standard, scope="boundary")


def few(model="sanchez_cuevas", parts=(), visits=4, **kind):
    return fit(
        catalogue.model(model),
        campaign(3, visits=visits, **kind),
        parts,
        SMALL,
        offset_m=0.0,
    )


def test_the_datum_that_would_halve_u_does():
    found = few(parts=(datum(1e-3),), visits=30)
    knowledge = information.halvings(found)["K_b"].knowledge
    one = next(r for r in knowledge if r.quantity == "distance datum")
    assert one.unit == "mm"
    assert "K_b correlates with the distance datum (r = " in one.text
    assert (
        f"Knowing the distance datum independently to {plain(one.needed, 2)} mm would halve u(K_b)"
        in one.text
    )
    # the same trials with that measurement added to the declared datum
    better = (1e-3**-2 + (one.needed / 1000) ** -2) ** -0.5
    again = fit(
        found.model,
        found.problem.data,
        (datum(better),),
        SMALL,
        found.slope,
        0.0,
    )
    assert again.estimates["K_b"].u == pytest.approx(found.estimates["K_b"].u / 2, rel=0.02)
    exact = fit(found.model, found.problem.data, (), SMALL, found.slope, 0.0)
    assert one.u_best == pytest.approx(exact.estimates["K_b"].u, rel=0.02)


def test_what_cannot_halve_it_says_how_far_it_would_go():
    found = few(parts=(datum(0.1e-3),), visits=2)
    (one,) = [
        r for r in information.halvings(found)["K_b"].knowledge if r.quantity == "distance datum"
    ]
    assert np.isnan(one.needed)
    assert (
        f"With exact distance datum, u(K_b) would be {one.u_best:.2g} instead of {one.u:.2g}"
        in one.text
    )
    assert "K_b correlates with the distance datum" in one.text


def test_a_coefficient_known_from_elsewhere():
    found = few("sanchez_cuevas_free_exponent")
    (one,) = [r for r in information.halvings(found)["K_b"].knowledge if r.quantity == "n"]
    r = found.covariance[0, 1] / np.sqrt(np.prod(np.diag(found.covariance)))
    assert f"(r = {signed(r, 2)})" in one.text
    whole = np.linalg.inv(found.covariance) + np.diag([0, one.needed**-2])
    assert np.linalg.inv(whole)[0, 0] ** 0.5 == pytest.approx(
        found.estimates["K_b"].u / 2, rel=1e-4
    )


def test_so_many_repeats_halve_it():
    found = few(parts=(datum(0.02e-3),))
    repeats = information.halvings(found)["K_b"].repeats
    assert repeats.times > 4
    n = round(repeats.times)
    data = found.problem.data
    many = dataclasses.replace(
        data.take(np.tile(np.arange(data.n), n)),
        visit=np.concatenate([data.visit + k * 1000 for k in range(n)]),
    )
    again = fit(found.model, many, (datum(0.02e-3),), SMALL, np.tile(found.slope, n), 0.0)
    assert again.estimates["K_b"].u == pytest.approx(found.estimates["K_b"].u / 2, rel=0.06)
    assert (
        repeats.text
        == f"{plain(repeats.times, 3)} times the trials, in the same design, would halve u(K_b)"
    )


def test_no_number_of_repeats_undoes_a_bent_line():
    """A session's gain by distance would average, the cell's one line never does."""
    line = Component(
        name="load cell linearity",
        on="linearity",
        standard=0.05,
        scope="campaign",
        range_N=1.0,
    )
    gain = Component(
        name="gain at each station",
        on="gain",
        standard=0.01,
        scope="distance",
    )
    found = few(parts=(line, gain), visits=30)
    repeats = information.halvings(found)["K_b"].repeats
    assert repeats.times == np.inf
    assert "No number of repeats would halve u(K_b)" in repeats.text


def test_nothing_is_said_of_what_is_not_determined():
    assert information.halvings(few(stations=(2.0,))) == {}
