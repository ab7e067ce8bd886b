"""Batched Levenberg-Marquardt against lmfit and scipy, and the last steps: to where the gradient
vanishes, however large the misfit, and no farther than bounds and data allow.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from tests.unit.simulated import GEOMETRY, campaign

from nearlift import catalogue
from nearlift.fit import solver
from nearlift.fit.held_quantity import at_exponents
from nearlift.fit.information import parameter_covariance
from nearlift.fit.least_squares import fit
from nearlift.likelihood.problem import Likelihood
from nearlift.results import Noise

X = np.linspace(0.2, 2.0, 40)
FREE = (np.full(2, -np.inf), np.full(2, np.inf))


def curve(misfit: float):
    """a exp(-b x) fitted to what it cannot be: residuals of `misfit` times a cosine, whose
    curvature slows Gauss and Newton's steps down.
    """
    target = 3 * np.exp(-1.5 * X) + misfit * np.cos(5 * X)

    def residuals(theta, rows):
        return target - theta[:, :1] * np.exp(-theta[:, 1:] * X)

    def derivatives(theta, rows):
        e = np.exp(-theta[:, 1:] * X)
        return -np.stack([e, -theta[:, :1] * X * e], axis=1)

    return solver.System(residuals, derivatives)


ONE = np.arange(1)


def gradient(system, theta):
    """In units of the sizes of what cancels in it."""
    r, slopes = (f(theta, np.arange(len(theta))) for f in system)
    target = system.residuals(np.zeros((1, 2)), ONE)
    return np.abs(slopes @ r[:, :, None])[..., 0] / (
        np.linalg.norm(slopes, axis=2) * np.linalg.norm(target)
    )


@given(st.floats(0.0, 1.5), st.floats(-1e-4, 1e-4), st.floats(-1e-4, 1e-4))
def test_the_gradient_vanishes_wherever_a_search_stopped(misfit, a, b):
    system = curve(misfit)
    rough = np.array([[3.0, 1.5]])
    for _ in range(60):
        r, slopes = (f(rough, ONE)[0] for f in system)
        rough = rough + 0.5 * np.linalg.lstsq(slopes.T, -r, rcond=None)[0]
    starts = rough + np.array([[0.0, 0.0], [a, b]])
    best = solver.refine(system, starts, FREE)
    # forty products, each known to rounding
    assert (gradient(system, best) < 40 * np.finfo(float).eps).all()
    assert best[0] == pytest.approx(best[1], rel=1e-11)


def test_what_stands_at_a_bound_and_would_leave_stays_and_the_rest_makes_the_best_of_it():
    system = curve(0.1)
    best = solver.refine(
        system, np.array([[2.0, 1.0]]), (np.array([-np.inf, 0.0]), np.array([np.inf, 1.0]))
    )
    e = np.exp(-X)
    target = system.residuals(np.zeros((1, 2)), ONE)[0]
    assert best[0, 1] == 1.0
    # linear in what is left
    assert best[0, 0] == pytest.approx(e @ target / (e @ e), rel=1e-12)


def test_a_direction_that_the_data_do_not_determine_stays_where_it_was():
    system = solver.System(
        lambda theta, rows: 1.0 - theta.sum(axis=1)[:, None] * X,
        lambda theta, rows: -np.broadcast_to(X, (len(theta), 2, len(X))),
    )
    best = solver.refine(system, np.array([[0.5, 0.1]]), FREE)
    assert best.sum() == pytest.approx(X.sum() / (X @ X), rel=1e-12)
    assert best[0, 0] - best[0, 1] == pytest.approx(0.4, rel=1e-12)


def test_a_problem_without_a_value_is_left_alone():
    system = curve(0.1)

    def broken(theta, rows):
        return np.where(rows[:, None] == 0, np.nan, system.residuals(theta, rows))

    start = np.array([[3.0, 1.5], [3.0, 1.5]])
    best = solver.refine(system._replace(residuals=broken), start, FREE)
    assert (best[0] == start[0]).all()
    assert (best[1] != start[1]).all()


SCATTER = Noise(relative=0.004, height_m=1e-4, force_N=2e-4)


SQUARE = tuple((x, y) for x in (-2.0, 2.0) for y in (-2.0, 2.0))
KNOWN = {**GEOMETRY, "layout_hat": SQUARE, "gap_hat": 12.0, "rotors": 4}
MODELS = [m for m in catalogue.models() if m.parameters and set(m.needs) <= KNOWN.keys()]


@pytest.mark.parametrize("model", MODELS, ids=lambda m: m.name)
def test_the_batched_search_ends_where_lmfit_does(model):
    low, high = model.valid_z_hat
    z_hat = np.geomspace(max(1.05 * low, 0.3), min(high, 8.0), 12)
    known = {n: KNOWN[n] for n in model.needs}
    centre = {p.name: p.value for p in model.parameters}
    data = campaign(
        3,
        boundary=model.boundary,
        stations=tuple(z_hat),
        ratio=lambda z: model.evaluate(z, **centre, **known),
    )
    data = dataclasses.replace(data, geometry=KNOWN)
    found = fit(model, data, (), SCATTER, quoted=True)
    batched, _ = solver.solve(found.problem)
    assert batched == pytest.approx(found.theta, rel=1e-9, abs=1e-9)
    stderr = [p.stderr for p in found.lmfit.params.values()]
    assert stderr == pytest.approx(np.sqrt(np.diag(found.covariance)), rel=1e-3)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Raised(Likelihood):
    """The same trials, the model's ratio raised to a fixed exponent."""

    exponent: float = 1.0

    def log_ratio(self, *given, **named):
        return self.exponent * super().log_ratio(*given, **named)

    def slopes(self, *given, **named):
        return self.exponent * super().slopes(*given, **named)


@pytest.mark.parametrize("model", ["sanchez_cuevas", "power_law"])
def test_all_exponents_at_once_are_each_alone(model):
    made = fit(catalogue.model(model), campaign(3, visits=4), (), SCATTER)
    problem, exponents = made.problem, [0.6, 1.0, 1.2]
    answers = at_exponents(problem, made.theta, exponents)
    assert [n for n, _, _ in answers] == exponents
    for n, value, u in answers:
        fields = {f.name: getattr(problem, f.name) for f in dataclasses.fields(problem)}
        alone = Raised(**fields, exponent=n)
        best = solver.solve(alone, quoted=True)[0]
        assert value == pytest.approx(best[0], rel=1e-6)
        covariance, _ = parameter_covariance(problem.project(n * problem.slopes(best)))
        assert u == pytest.approx(np.sqrt(covariance[0, 0]), rel=1e-3)


def test_a_search_that_gives_up_is_no_estimate():
    """A trough that runs on for ever: no step is the last one."""

    trough = solver.System(
        lambda x, rows: np.where(rows[:, None] == 0, x - 1, np.exp(-x)),
        lambda x, rows: np.where(rows[:, None] == 0, 1.0, -np.exp(-x))[:, None],
    )
    found = solver.minimise(
        trough,
        np.array([[0.5], [0.5]]),
        (np.array([-1e9]), np.array([1e9])),
        np.array([1e-6]),
    )
    assert found.converged.tolist() == [True, False]


def test_a_bound_is_a_minimum_and_no_value_is_none():
    found = solver.minimise(
        solver.System(
            lambda x, rows: np.where(rows[:, None] == 0, x - 3.0, np.nan),
            lambda x, rows: np.ones((len(x), 1, 1)),
        ),
        np.zeros((2, 1)),
        (np.array([-1.0]), np.array([2.0])),
        np.array([1.0]),
    )
    assert found.theta[0] == pytest.approx([2.0])
    assert found.chi2[0] == pytest.approx(1.0)
    assert found.converged.tolist() == [True, False]


def test_bounded_minima_of_many_linear_problems_are_scipys():
    """Correlated parameters, all of them at a bound at first and most in the end: a step that would
    leave by one is taken without that parameter.
    """
    rng = np.random.default_rng(3)
    mix = rng.standard_normal((200, 8, 5)) + 2 * rng.standard_normal((200, 8, 1))
    target = mix @ np.array([3.0, -2.0, 0.5, -0.5, 2.0]) + rng.standard_normal((200, 8))
    bounds = (np.full(5, -1.0), np.full(5, 1.0))
    system = solver.System(
        lambda x, rows: (mix[rows] @ x[:, :, None])[..., 0] - target[rows],
        lambda x, rows: mix[rows].swapaxes(1, 2),
    )
    found = solver.minimise(system, rng.choice([-1.0, 1.0], (200, 5)), bounds, enough=1e-3)
    best = [2 * lsq_linear(a, y, bounds, tol=1e-12).cost for a, y in zip(mix, target, strict=True)]
    assert found.converged.all()
    assert found.chi2 == pytest.approx(best, abs=1e-6)
