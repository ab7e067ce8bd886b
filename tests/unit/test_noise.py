"""Scatter from repeats: unbiased, beyond what records explain, and (almost) no model's business."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.declare import Check, LiftModel, Source
from nearlift.fitting import noise
from nearlift.fitting.problem import height_slope
from nearlift.results import Noise, Observations

from .simulated import STATIONS, THROTTLES, campaign, sanchez_cuevas

MODEL, VALUES = catalogue.model("sanchez_cuevas"), {"K_b": 2.0}


def quiet(data: Observations, u_lift_N: float = 0.0) -> Observations:
    """The trials as if their records told so much and no more."""
    return dataclasses.replace(data, u_lift_N=np.full(data.n, u_lift_N))


def estimates(many: int, **sizes: float) -> tuple[np.ndarray, float]:
    """Squares of the three components over simulated campaigns, (many, 3), and the degrees of freedom of one."""
    found = [noise.estimate(quiet(campaign(seed, **sizes)), MODEL, VALUES) for seed in range(100, 100 + many)]
    return np.array([(e.relative, e.force_N, e.height_m) for e in found]) ** 2, found[0].dof


def within_chance(values: np.ndarray, truth: float, sigmas: float = 3.5) -> bool:
    """Whether a mean agrees with the truth; wrong once in two thousand."""
    return bool(abs(values.mean() - truth) < sigmas * values.std(ddof=1) / np.sqrt(len(values)))


def test_relative_scatter_is_unbiased_although_cell_means_were_taken_out():
    """With 2 visits half the degrees of freedom are gone: a maximum-likelihood estimate would give half the variance."""
    squares, _ = estimates(30, visits=2, relative=0.005, force=0.0, height=0.0)
    # force and height, which are free too and cannot be negative, may take a little of it
    assert 0.75 * 0.005**2 < squares[:, 0].mean() < 1.05 * 0.005**2


def test_the_three_components_are_told_apart():
    stations = (1.05, 1.1, 1.2, 1.3, 1.5, 3.0, 6.0, 11.0)
    squares, _ = estimates(24, stations=stations, visits=15, relative=0.003, force=4e-4, height=0.5e-3)
    for found, truth in zip(squares.T, np.square([0.003, 4e-4, 0.5e-3]), strict=True):
        assert within_chance(found, truth), (np.sqrt(found.mean()), np.sqrt(truth))


def test_what_the_records_explain_is_not_counted_twice():
    """Trials that scatter only as their own standard errors say leave nothing over."""
    data = campaign(4, visits=15, relative=0.0, force=5e-4, height=0.0)
    left = noise.estimate(quiet(data, 5e-4), MODEL, VALUES)
    blind = noise.estimate(quiet(data), MODEL, VALUES)
    assert blind.force_N == pytest.approx(5e-4, rel=0.1)
    assert left.force_N < 1.5e-4
    assert left.relative < 0.0007


def test_repeats_do_not_ask_the_model():
    """A model that is wrong by 10 % leaves the scatter as it was; the height's part alone goes through its slope."""
    data = campaign(4, visits=8)
    right = noise.estimate(data, MODEL, VALUES)
    wrong = noise.estimate(data, catalogue.model("cheeseman_bennett_fixed"), {})
    assert wrong.relative == pytest.approx(right.relative, rel=0.01)
    assert wrong.force_N == pytest.approx(right.force_N, rel=0.01)
    assert right.source == f"scatter of repeats about cell means ({data.n - len(STATIONS) * len(THROTTLES)} degrees of freedom)"
    assert right.dof == data.n - len(STATIONS) * len(THROTTLES)


def sensitivity(data: Observations) -> np.ndarray:
    """d log ratio / d K_b, (n, 1)."""
    return np.gradient(np.log([sanchez_cuevas(data.z_hat, k) for k in (1.99, 2.0, 2.01)]), 0.01, axis=0)[1][:, None]


def shaken(data: Observations, seed: int, size: float) -> Observations:
    """The trials with a gain error that those of a visit have in common."""
    own = np.random.default_rng(seed).normal(0, size, data.visit.max() + 1)
    return dataclasses.replace(data, lift_N=data.lift_N * np.exp(own[data.visit]))


@pytest.mark.parametrize(("visits", "between"), [(1, 8), (2, 18)])
def test_what_visits_share_is_learnt_about_the_curve_where_distances_were_hardly_visited_again(visits, between):
    """Ten distances, one or two visits each: the mean square over campaigns is what was put in, or a little more, never nothing."""
    sizes = []
    for seed in range(12):
        data = shaken(quiet(campaign(seed, visits=visits, relative=0.003, force=0.0, height=0.0)), seed, 0.006)
        found = noise.estimate(data, MODEL, VALUES, sensitivity(data))
        assert found.between == between
        assert f"({between} degrees of freedom" in found.source
        assert found.serial > 0
        sizes.append(found.serial**2)
    # the root of a mean of 12 such estimates: 8 degrees of freedom each scatter it by 7 %
    assert 0.8 * 0.006 < np.sqrt(np.mean(sizes)) < 1.4 * 0.006


def test_visits_without_one_to_spare_are_said_to_hide_what_they_share():
    """Two visits, one coefficient and a level: nothing is left that could tell."""
    data = campaign(4, stations=(1.14, 2.2), visits=1)
    found = noise.estimate(data, MODEL, VALUES, sensitivity(data))
    assert found.between == 0
    assert noise.UNSEEN in found.source
    often = noise.estimate(campaign(4, visits=8), MODEL, VALUES)
    assert often.between == 70
    assert noise.UNSEEN not in often.source


def test_without_repeats_the_scatter_is_about_the_model_and_says_so():
    data = quiet(campaign(4, visits=1, relative=0.005, force=0.0, height=0.0))
    found = noise.estimate(data, MODEL, VALUES, sensitivity(data))
    assert found.source.startswith("scatter about the fitted model (too few repeats)")
    assert found.dof == data.n - len(THROTTLES) - 1
    # chi-square of 35 degrees of freedom: 0.005 within 30 % but once in a hundred
    assert found.relative == pytest.approx(0.005, rel=0.3)
    assert found.force_N == 0.0


def test_without_repeats_a_model_may_need_what_the_schedule_knows():
    def evaluate(z_hat, /, *, throttle, supply_V):
        return 1 + 0 * throttle * supply_V / np.asarray(z_hat)

    model = LiftModel(
        name="needy",
        title="needy",
        formula="1",
        evaluate=evaluate,
        boundary="ground",
        needs=("throttle", "supply_V"),
        source=Source(citation="this test"),
        checks=(Check(x=1.0, expected=1.0, arguments={"throttle": 0.5, "supply_V": 4.0}, quoted_by="by hand"),),
    )
    assert noise.estimate(campaign(4, visits=1), model, {}).relative > 0


def test_trials_that_share_no_visit_share_nothing():
    data = campaign(4, visits=4, height=1e-3)
    found = noise.estimate(dataclasses.replace(data, visit=np.arange(data.n)), MODEL, VALUES)
    assert found.height_m == found.serial == 0.0
    assert found.between == np.inf


def test_exact_numbers_still_have_a_covariance():
    data = quiet(campaign(4, relative=0.0, force=0.0, height=0.0))
    found = noise.estimate(data, MODEL, VALUES)
    assert found.relative < 1e-5
    covariance = noise.trial_covariance(data, found, height_slope(MODEL, data, VALUES))
    assert np.isfinite(covariance.log_det)


def test_the_covariance_is_the_sum_of_its_named_parts():
    data = campaign(4, visits=2)
    slope = height_slope(MODEL, data, VALUES)
    scatter = Noise(relative=0.004, force_N=3e-4, height_m=2e-4, serial=0.001, serial_length=2.0)
    shared = np.stack([0.001 * slope, np.full(data.n, 0.002)], axis=1)
    dense = noise.trial_covariance(data, scatter, slope, shared, 1e-6).dense()
    i, j = np.indices(dense.shape)
    same_visit = data.visit[i] == data.visit[j]
    expected = np.diag((data.u_lift_N / data.lift_N) ** 2 + 0.004**2 + (3e-4 / data.lift_N) ** 2 + 1e-6)
    expected += same_visit * (2e-4**2 * np.outer(slope, slope) + 0.001**2 * np.exp(-np.abs(i - j) / 2.0))
    expected += 1e-6 * np.outer(slope, slope) + 0.002**2
    assert dense == pytest.approx(expected, rel=1e-12, abs=1e-18)


def test_cells_are_pairs_of_distance_and_throttle():
    data = campaign(4, visits=3)
    label = noise.cells(data)
    pairs = {(z, t): label[(data.z_hat == z) & (data.throttle == t)] for z in data.z_hat for t in THROTTLES}
    assert all(len(set(members.tolist())) == 1 and len(members) == 3 for members in pairs.values())
    assert len(set(label.tolist())) == len(pairs)


def test_the_deviance_in_closed_form_has_the_slope_of_its_differences():
    """Against differences, with unknowns shared by all trials in the covariance."""
    data = quiet(campaign(1, visits=3), 1e-4)
    rng = np.random.default_rng(0)
    mean, centred = rng.standard_normal((data.n, 5)), 0.01 * rng.standard_normal(data.n)
    slope, shared = height_slope(MODEL, data, VALUES), 0.002 * rng.standard_normal((data.n, 3))
    acts = {"serial": np.ones(data.n), "height_m": slope}

    def at(relative, force_N, serial, height_m):
        scatter = Noise(relative=relative**0.5, force_N=force_N**0.5, serial=serial**0.5, height_m=height_m**0.5, serial_length=noise.WHOLE_VISIT)
        return noise._deviance(noise.trial_covariance(data, scatter, slope, shared), mean, centred, acts)

    variances = np.array([2e-5, 1e-7, 1e-5, 1e-8])
    _, by_variance, by_visit = at(*variances)
    found = [by_variance.sum(), by_variance @ data.lift_N**-2.0, *by_visit]
    steps = np.diag(1e-4 * variances)
    differences = [(at(*variances + h)[0] - at(*variances - h)[0]) / (2 * h.sum()) for h in steps]
    np.testing.assert_allclose(found, differences, rtol=1e-4)
