"""Refits in a stack are the single fits, one by one; what fails says so."""

import dataclasses

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.errors import NotConverged
from nearlift.fit import batched
from nearlift.fit.held_quantity import at_exponents
from nearlift.fit.least_squares import fit, minimise
from nearlift.fit.refit import refit
from nearlift.likelihood.budget import Component
from nearlift.likelihood.problem import Problem
from nearlift.results import Noise

from .simulated import campaign

MODEL = catalogue.model("sanchez_cuevas_free_exponent")
PARTS = (
    Component(name="datum", on="height", standard=1e-4, distribution="normal", scope="boundary"),
    Component(name="gain", on="gain", standard=0.003, distribution="normal", scope="throttle"),
)


def fitted(*, moved: float = 0.0):
    """Forty stops; `moved` makes every trial's height its own."""
    data = campaign(3, visits=4)
    if moved:
        data = dataclasses.replace(
            data, z_hat=data.z_hat * np.exp(moved * np.random.default_rng(1).normal(size=data.n))
        )
    return fit(MODEL, data, PARTS, Noise(relative=0.004, height_m=1e-4, force_N=2e-4))


def resampled(problem: Problem, theta: np.ndarray, m: int) -> np.ndarray:
    rng = np.random.default_rng(2)
    root = np.linalg.cholesky(problem.covariance.dense())
    level, _ = problem.log_levels(theta)
    return (
        problem.log_ratio(theta)
        + level[problem.data.level]
        + rng.normal(size=(m, problem.data.n)) @ root.T
    )


def single(problem: Problem, log_lift: np.ndarray, start: np.ndarray) -> np.ndarray:
    """By scipy, one campaign, each throttle's level as one more unknown."""
    from scipy.optimize import least_squares

    white = np.linalg.inv(np.linalg.cholesky(problem.covariance.dense()))
    level = np.eye(len(problem.data.levels))[problem.data.level]
    p = len(start)

    def residuals(x: np.ndarray) -> np.ndarray:
        return white @ (log_lift - problem.log_ratio(x[:p]) - level @ x[p:])

    first = np.r_[start, problem.log_levels(start)[0]]
    found = least_squares(
        residuals, first, jac="3-point", x_scale=np.abs(first), xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    return np.r_[found.x[:p], 2 * found.cost]


@pytest.mark.parametrize("moved", [0.0, 0.02], ids=["stations", "every trial at its own height"])
def test_refits_are_the_single_fits(moved: float):
    found = fitted(moved=moved)
    assert bool(moved) == (len(np.unique(found.problem.data.z_hat)) == found.problem.data.n)
    scale = np.sqrt(np.diag(found.covariance))
    log_lift = resampled(found.problem, found.theta, 30)
    stack = refit(found.problem, found.theta, scale, log_lift=log_lift)
    assert stack.converged.all()
    for row, chi2, lifts in zip(stack.good()[:4], stack.chi2, log_lift, strict=False):
        alone = single(found.problem, lifts, found.theta)
        # a search by chi2 alone cannot tell apart what lies within the rounding of a sum of n
        # squares
        np.testing.assert_array_less(
            np.abs(row - alone[:2]),
            np.sqrt(found.problem.data.n * np.finfo(float).eps * alone[2]) * scale,
        )
        assert chi2 == pytest.approx(alone[2], rel=1e-9)
        other = minimise(
            dataclasses.replace(
                found.problem, data=dataclasses.replace(found.problem.data, lift_N=np.exp(lifts))
            ),
            found.theta,
        )
        np.testing.assert_array_less(np.abs(row - other), 2 * batched.STILL * scale)
    spread = stack.good().std(axis=0)
    # 30 refits tell a standard deviation to 13 %: four of that
    assert spread == pytest.approx(scale, rel=0.52)


def test_slopes_are_derivatives_of_the_log_ratio():
    """Against five-point differences, which are good to 1e-9 of a derivative."""
    found = fitted()
    problem, theta = found.problem, found.theta
    for i, slope in enumerate(problem.slopes(theta)):
        h = np.eye(len(theta))[i] * 1e-3 * abs(theta[i])
        one, two = (
            (problem.log_ratio(theta + k * h) - problem.log_ratio(theta - k * h)) for k in (1, 2)
        )
        np.testing.assert_allclose(slope, (8 * one - two) / (12 * h[i]), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(
        problem.slopes(np.tile(theta, (3, 1)), np.full((3, 1), 1e-4)),
        problem.slopes(theta, 1e-4) + np.zeros((3, 1, 1)),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class Raised(Problem):
    """The same trials, the model's ratio raised to a fixed exponent."""

    exponent: float = 1.0

    def log_ratio(self, *given, **named):
        return self.exponent * super().log_ratio(*given, **named)

    def slopes(self, *given, **named):
        return self.exponent * super().slopes(*given, **named)


def test_all_exponents_at_once_are_each_alone():
    problem = fitted().problem
    plain = dataclasses.replace(problem, model=catalogue.model("sanchez_cuevas"))
    theta = minimise(plain, np.array([2.0]))
    for found in at_exponents(plain, theta, [0.6, 1.0, 1.2]):
        fields = {f.name: getattr(plain, f.name) for f in dataclasses.fields(plain)}
        alone = Raised(**fields, exponent=found.n)
        assert found.value == pytest.approx(minimise(alone, theta)[0], rel=1e-6)
        assert found.chi2 == pytest.approx(float(alone.chi2(np.array([found.value]))), rel=1e-10)


def test_a_search_that_gives_up_is_no_estimate():
    """A trough that runs on for ever: no step is the last one."""
    found = batched.minimise(
        lambda x, rows: (
            np.exp(-x) * np.where(rows, 1.0, 0.0)[:, None]
            + np.where(rows, 0.0, 1.0)[:, None] * (x - 1)
        ),
        np.array([[0.5], [0.5]]),
        (np.array([-1e9]), np.array([1e9])),
        np.array([1e-6]),
        np.array([True]),
    )
    assert found.converged.tolist() == [True, False]
    with pytest.raises(NotConverged, match="1 of 2 did not converge"):
        found.good()


def test_a_bound_is_a_minimum_and_no_value_is_none():
    found = batched.minimise(
        lambda x, rows: np.where(rows[:, None] == 0, x - 3.0, np.nan),
        np.zeros((2, 1)),
        (np.array([-1.0]), np.array([2.0])),
        np.array([1.0]),
        np.array([True]),
    )
    assert found.theta[0] == pytest.approx([2.0])
    assert found.chi2[0] == pytest.approx(1.0)
    assert found.converged.tolist() == [True, False]
