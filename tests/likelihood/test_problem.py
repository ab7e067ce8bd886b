"""The likelihood: L_inf eliminated in closed form is L_inf fitted, and what cannot matter
does not.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.unit.simulated import RADIUS, campaign, sanchez_cuevas

from nearlift import catalogue
from nearlift.declare import Check, LiftModel, Parameter, Source, uniform
from nearlift.errors import InputRefused
from nearlift.fit.least_squares import assemble
from nearlift.likelihood import budget
from nearlift.likelihood.problem import Likelihood, need, usable, where_finite
from nearlift.results import Noise, Observations

MODEL = catalogue.model("sanchez_cuevas")
FREE = catalogue.model("sanchez_cuevas_free_exponent")
#: Every layer of the covariance at once: own variance, a visit's height, what else its trials
#: share, shared unknowns.
SCATTER = Noise(relative=0.004, force_N=3e-4, height_m=1e-4, common=0.002)
BUDGET = (
    budget.Component(
        name="datum", on="height", standard=2e-4, distribution="normal", scope="boundary"
    ),
    budget.Component(
        name="zero", on="force", standard=5e-4, distribution="normal", scope="session"
    ),
)


def problem(
    model: LiftModel = MODEL, data: Observations | None = None, theta: tuple[float, ...] = (2.0,)
) -> Likelihood:
    return assemble(
        model, campaign(3, visits=3) if data is None else data, BUDGET, SCATTER, np.array(theta)
    )


def with_free_air(data: Observations, station: float) -> Observations:
    """The trials, those at `station` now in free air."""
    return dataclasses.replace(data, z_hat=np.where(data.z_hat == station, np.inf, data.z_hat))


def explicit(p: Likelihood, theta: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Chi2, log L_inf and its covariance by textbook generalised least squares with L_inf as
    ordinary unknowns.
    """
    inverse = np.linalg.inv(p.covariance.dense())
    indicator = (p.data.throttle[:, None] == p.data.levels).astype(float)
    y = np.log(p.data.lift_N) - p.log_ratio(theta)
    normal = indicator.T @ inverse @ indicator
    level = np.linalg.solve(normal, indicator.T @ inverse @ y)
    rest = y - indicator @ level
    return float(rest @ inverse @ rest), level, np.linalg.inv(normal)


def levels(p, theta):
    """Log L_inf of each throttle at one theta."""
    return p.best_levels(np.log(p.data.lift_N) - p.log_ratio(theta))


@pytest.mark.parametrize("K_b", [0.3, 2.0, 3.1])
def test_eliminating_L_inf_is_fitting_it(K_b):
    p, theta = problem(), np.array([K_b])
    chi2, level, covariance = explicit(p, theta)
    assert p.chi2(theta) == pytest.approx(chi2, rel=1e-9)
    assert levels(p, theta) == pytest.approx(level, abs=1e-10)
    assert p.level_covariance == pytest.approx(covariance, rel=1e-8, abs=1e-14)


def test_log_likelihood_is_the_normal_density_of_the_lifts():
    """Of the lifts, not of their logarithms: the Jacobian of the logarithm is in it."""
    p, theta = problem(), np.array([1.8])
    chi2, _, _ = explicit(p, theta)
    log_det = np.linalg.slogdet(p.covariance.dense())[1]
    expected = -0.5 * (chi2 + log_det + p.data.n * np.log(2 * np.pi)) - np.log(p.data.lift_N).sum()
    assert p.log_likelihood(theta) == pytest.approx(expected, rel=1e-10)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000))
def test_order_of_visits_does_not_matter(seed):
    data, theta = campaign(3, visits=3), np.array([1.7])
    visits = np.random.default_rng(seed).permutation(np.unique(data.visit))
    shuffled = data.take(np.concatenate([np.flatnonzero(data.visit == v) for v in visits]))
    one, other = problem(data=data), problem(data=shuffled)
    assert other.chi2(theta) == pytest.approx(one.chi2(theta), rel=1e-10)
    assert other.covariance.log_det == pytest.approx(one.covariance.log_det, rel=1e-12)
    assert levels(other, theta) == pytest.approx(levels(one, theta), abs=1e-12)


def test_jacobian_is_the_derivative_worked_out_by_hand():
    """d log ratio / d K_b = ratio times the body term's coefficient, from the formula and not from
    the library.
    """
    data = campaign(3, visits=2)
    z, b = data.z_hat, data.geometry["diagonal_hat"]
    by_hand = 2 * z / (b**2 + 4 * z**2) ** 1.5 * sanchez_cuevas(z, 1.4)
    assert problem(data=data).jacobian(np.array([1.4])) == pytest.approx(by_hand[:, None], rel=1e-6)


@pytest.mark.parametrize("end", [0, 1])
def test_jacobian_at_a_bound_does_not_look_beyond_it(end):
    """Cheeseman-Bennett's k at either end of its range: one-sided, still within first order of the
    derivative by hand.
    """
    model = catalogue.model("cheeseman_bennett")
    k = model.parameter("k").bounds[end]
    data = campaign(
        3, visits=2, stations=(1.3, 2.0, 4.0, 9.0), ratio=lambda z: 1 / (1 - 1 / (16 * z**2))
    )
    z = data.z_hat
    by_hand = 1 / (16 * z**2) / (1 - k / (16 * z**2))
    assert problem(model, data, (k,)).jacobian(np.array([k])) == pytest.approx(
        by_hand[:, None], rel=2e-2
    )


def test_height_slope_is_per_metre_and_nothing_in_free_air():
    data = campaign(3, visits=2)
    far = np.zeros(data.n, dtype=bool)
    far[:8] = True
    data = dataclasses.replace(data, z_hat=np.where(far, np.inf, data.z_hat))
    slope = problem(data=data).height_slope(np.array([2.0]))
    near = data.z_hat[~far]
    step_m = 1e-6
    by_hand = (
        np.log(sanchez_cuevas(near + step_m / RADIUS))
        - np.log(sanchez_cuevas(near - step_m / RADIUS))
    ) / (2 * step_m)
    assert slope[~far] == pytest.approx(by_hand, rel=1e-5)
    assert (slope[far] == 0).all()


def test_where_a_model_has_no_value_chi2_is_infinite():
    model = catalogue.model("cheeseman_bennett")
    data = campaign(3, stations=(0.4, 1.0, 3.0), ratio=lambda z: 1 / (1 - 0.05 / z**2))
    p = problem(model, data, (1.0,))
    with np.errstate(all="ignore"):
        assert np.isinf(p.chi2(np.array([3.0])))  # the pole of k = 3 stands at z_hat = 0.43
        assert p.log_likelihood(np.array([3.0])) == -np.inf
    assert np.isfinite(p.chi2(np.array([1.0])))


def test_needs_come_from_geometry_the_schedule_or_a_covariate_and_are_asked_for():
    data = campaign(3, visits=2)
    assert need(data, "spacing_hat", "m") == 65 / 23
    assert need(data, "throttle", "m") is data.throttle
    assert need(data, "supply_V", "m") is data.covariates["supply_V"]
    with pytest.raises(
        InputRefused,
        match=(
            r"model m: needs humidity, which this campaign does not know\n  add it to \[vehicle\]"
            r" or to the schedule"
        ),
    ):
        need(data, "humidity", "m")


def bounded(low: float, high: float) -> LiftModel:
    return LiftModel(
        name="bounded",
        title="bounded",
        formula="1 + a / z",
        evaluate=lambda z, /, *, a: 1 + a / np.asarray(z),
        boundary="ground",
        valid_z_hat=(low, high),
        parameters=(
            Parameter(
                name="a",
                unit="1",
                value=0.1,
                bounds=(0.0, 1.0),
                prior=uniform(0.0, 1.0),
                meaning="gain",
            ),
        ),
        source=Source("this test", doubts=("all of it",)),
        checks=(Check(x=1.0, expected=1.1, quoted_by="by hand"),),
    )


def test_usable_leaves_out_the_pole_itself_keeps_the_upper_end_and_free_air():
    data = with_free_air(
        campaign(3, visits=1, stations=(0.5, 0.6, 2.0, 2.1, 9.0), ratio=lambda z: 1 + 0.1 / z), 9.0
    )
    keep = usable(bounded(0.5, 2.0), data)
    assert set(data.z_hat[keep]) == {0.6, 2.0, np.inf}


@pytest.mark.parametrize("lost", [np.inf, -np.inf, np.nan])
def test_a_row_without_a_value_is_nan_throughout_and_never_multiplied(lost):
    """BLAS kernels differ in what they make of inf and nan."""
    matrix, x = np.arange(6.0).reshape(3, 2), np.arange(18.0).reshape(2, 3, 3)
    expected = x @ matrix
    x[1, 1, 2] = lost

    def linear(rows):
        assert np.isfinite(rows).all()
        return rows @ matrix

    found = where_finite(linear, x)
    assert np.isnan(found[1, 1]).all()
    rest = np.arange(6) != 4
    assert np.array_equal(found.reshape(6, 2)[rest], expected.reshape(6, 2)[rest])
