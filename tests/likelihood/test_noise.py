"""Noise: its likelihood against a dense calculation, its sizes against what trials were given, its
order, its priors.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.unit.simulated import STATIONS, THROTTLES, campaign

from nearlift import catalogue
from nearlift.fit import least_squares
from nearlift.likelihood import noise, semiseparable, variance_components
from nearlift.likelihood.covariates import derive
from nearlift.likelihood.problem import Likelihood, height_slope
from nearlift.results import Noise, Observations

MODEL, VALUES, THETA = catalogue.model("sanchez_cuevas"), {"K_b": 2.0}, np.array([2.0])


def quiet(data: Observations, u_lift_N: float = 0.0) -> Observations:
    """The trials as if their records told so much and no more."""
    return dataclasses.replace(data, u_lift_N=np.full(data.n, u_lift_N))


def estimate(data: Observations, **how) -> Noise:
    """Noise about the model's true curve, beside what any model of distance and throttle
    may lack.
    """
    problem = Likelihood(
        model=MODEL,
        data=data,
        covariance=noise.trial_covariance(data, Noise(relative=0.01), np.zeros(data.n)),
    )
    mean = np.hstack([np.eye(len(data.levels))[data.level], problem.jacobian(THETA)])
    slope = how.pop("slope", problem.height_slope(THETA))
    lacking, source = noise.saturated_mean_columns(data)
    return noise.estimate(
        data,
        np.log(data.lift_N) - problem.log_ratio(THETA) + how.pop("added", 0.0),
        mean,
        lacking,
        slope,
        source=source,
        **how,
    )[0]


def test_too_many_cells_have_smooth_curves_for_each_throttle():
    """Where hardly a cell repeats: half waves of nearness, free to differ between throttles."""
    data = campaign(7)
    apart = dataclasses.replace(data, z_hat=data.z_hat * np.linspace(1.0, 1.01, data.n))
    [columns], source = noise.saturated_mean_columns(apart)
    assert "too few revisits" in source
    curves = columns.reshape(data.n, noise.SHAPES, len(data.levels))
    assert np.allclose(curves.sum(axis=2), 0)
    assert np.linalg.matrix_rank(columns) == noise.SHAPES * (len(data.levels) - 1)


def drifting(data: Observations, seed: int, size: float, trials: float) -> Observations:
    """The trials with a gain that wanders by `size` and forgets over so many of them."""
    rng, drift = np.random.default_rng(seed), np.zeros(data.n)
    keep = np.exp(-1 / trials)
    for i in range(data.n):
        drift[i] = keep * drift[i - 1] * (i > 0) + size * rng.normal() * (
            1.0 if i == 0 else np.sqrt(1 - keep**2)
        )
    return dataclasses.replace(data, lift_N=data.lift_N * np.exp(drift))


def shaken(data: Observations, seed: int, size: float) -> Observations:
    """The trials with a gain error that those of a visit have in common."""
    own = np.random.default_rng(seed).normal(0, size, data.visit.max() + 1)
    return dataclasses.replace(data, lift_N=data.lift_N * np.exp(own[data.visit]))


def dense(data, slope, sizes, unknown, free, y):
    """Minus twice the log posterior of the sizes as a textbook has it, all matrices n x n."""
    relative, force_N, height_m, common, *drift = sizes
    scatter = Noise(
        relative=relative, force_N=force_N, height_m=height_m, common=common, drift=tuple(drift)
    )
    v = (
        noise.trial_covariance(data, scatter, slope).dense()
        + unknown[:, free:] @ unknown[:, free:].T
    )
    x = unknown[:, :free]
    inverse = np.linalg.inv(v)
    information = x.T @ inverse @ x
    p = inverse - inverse @ x @ np.linalg.solve(information, x.T @ inverse)
    value = np.linalg.slogdet(v)[1] + np.linalg.slogdet(information)[1] + y @ p @ y
    scales = [
        (0.005, 1),
        (0.002 * np.median(data.lift_N), 1),
        (1e-4, 2),
        (2e-3, 0.25),
        *variance_components.DRIFT_PRIORS,
    ]
    for s, (c, nu) in zip(sizes, scales, strict=False):
        value += (nu + 1) * np.log(1 + s**2 / (nu * c**2)) - 2 * np.log(s)
    return value


def test_the_likelihood_and_its_slope_are_those_of_the_dense_calculation():
    data = campaign(1, visits=3)
    rng = np.random.default_rng(0)
    unknown, y = (
        np.hstack([rng.standard_normal((data.n, 5)), 0.01 * rng.standard_normal((data.n, 7))]),
        0.01 * rng.standard_normal(data.n),
    )
    slope = height_slope(MODEL, data, VALUES)
    model = variance_components.VarianceComponents(data, slope, unknown, 5, 0.0)
    assert list(model.priors) == [
        "relative",
        "force_N",
        "height_m",
        "common",
        "drift0",
        "drift1",
        "drift2",
    ]
    sizes = [0.004, 3e-4, 2e-4, 0.001, 0.002, 0.003, 0.001]
    unit = np.array([1, np.median(data.lift_N), 1, 1, 1, 1, 1])
    x = np.log(sizes / unit)
    found = model.at(x, y[model.order])

    def deviance(x):
        return dense(data, slope, np.exp(x) * unit, unknown, 5, y)

    other = x + rng.normal(0, 0.5, 7)
    assert model.at(other, y[model.order]).deviance - found.deviance == pytest.approx(
        deviance(other) - deviance(x), rel=1e-8
    )
    differences = [(deviance(x + h) - deviance(x - h)) / 2e-4 for h in 1e-4 * np.eye(7)]
    np.testing.assert_allclose(found.gradient, differences, rtol=1e-5, atol=1e-5)


def test_what_others_say_of_a_trial_is_what_leaving_it_out_says():
    """The error of predicting a trial from all others, over its standard deviation, by which
    outliers are judged.
    """
    data = campaign(1, visits=2)
    rng = np.random.default_rng(3)
    mean, y = np.eye(len(data.levels))[data.level], 0.01 * rng.standard_normal(data.n)
    slope = height_slope(MODEL, data, VALUES)
    model = variance_components.VarianceComponents(data, slope, mean, len(data.levels), 0.0)
    x = np.log([0.004, 3e-4, 2e-4, 0.001, 0.002, 0.003][: len(model.priors)])
    found = model.at(x, y[model.order])
    sizes = np.exp(x) * np.array([1, np.median(data.lift_N), 1, 1, 1, 1])[: len(x)]
    scatter = Noise(
        relative=sizes[0],
        force_N=sizes[1],
        height_m=sizes[2],
        common=sizes[3],
        drift=tuple(sizes[4:]),
    )
    v = noise.trial_covariance(data, scatter, slope).dense()
    for i in (0, 17, data.n - 1):
        rest = np.arange(data.n) != i
        inverse = np.linalg.inv(v[np.ix_(rest, rest)])
        given = np.linalg.solve(
            mean[rest].T @ inverse @ mean[rest], mean[rest].T @ inverse @ y[rest]
        )
        weight = v[i, rest] @ inverse
        error = y[i] - mean[i] @ given - weight @ (y[rest] - mean[rest] @ given)
        gap = mean[i] - weight @ mean[rest]
        variance = (
            v[i, i]
            - weight @ v[rest, i]
            + gap @ np.linalg.solve(mean[rest].T @ inverse @ mean[rest], gap)
        )
        assert found.weighed[i] / found.precision[i] == pytest.approx(error, rel=1e-8)
        assert 1 / found.precision[i] == pytest.approx(variance, rel=1e-8)


def test_sizes_are_those_that_trials_were_given():
    """Mean logarithms over campaigns, each within 3.5 standard errors, and a prior's
    share beside.
    """
    stations = (1.05, 1.1, 1.2, 1.3, 1.5, 3.0, 6.0, 11.0)
    truth = {"relative": 0.004, "force_N": 1e-3, "height_m": 3e-3, "common": 0.004}
    found = []
    for seed in range(12):
        data = campaign(seed, stations=stations, visits=15, relative=0.004, force=1e-3, height=3e-3)
        told = estimate(shaken(quiet(data), seed, 0.004))
        found.append([np.log(getattr(told, name) / size) for name, size in truth.items()])
    off, error = np.mean(found, axis=0), np.std(found, axis=0, ddof=1) / np.sqrt(len(found))
    assert np.all(np.abs(off) < 3.5 * error + 0.05), dict(zip(truth, off, strict=True))


@pytest.mark.parametrize("trials", [3.0, 30.0, 60.0])
def test_a_drift_is_found_whatever_its_length(trials):
    """Not only at the ladder's rungs. What forgets within three trials and what is each trial's own
    are hardly told apart; their sum is.
    """
    squares, whole = [], []
    for seed in range(6):
        told = estimate(
            drifting(
                quiet(campaign(seed, visits=20, relative=0.003, force=0.0, height=0.0)),
                seed,
                0.006,
                trials,
            )
        )
        squares.append(np.sum(np.square(told.drift)) + told.common**2)
        whole.append(squares[-1] + told.relative**2)
    # 400 trials are as many as 7 to 130 independent ones, six times over: their variance is known
    # to 7 to 25 %
    assert np.sqrt(np.mean(squares)) == pytest.approx(0.006, rel=0.3)
    assert np.sqrt(np.mean(whole)) == pytest.approx(np.hypot(0.003, 0.006), rel=0.2)


def test_few_visits_do_not_make_heights_scatter():
    """160 trials: a height error of a tenth of a millimetre is not made out to be one of
    several.
    """
    ratios = []
    for seed in range(12):
        ratios.append(estimate(campaign(seed, visits=4, height=1e-4)).height_m / 1e-4)
    assert np.median(ratios) < 2
    assert max(ratios) < 5


def test_structure_is_not_noise():
    """A bump in one cell and a wrong curve leave the scatter as it was."""
    data = quiet(campaign(4, visits=10))
    bump = (
        0.05 * ((data.z_hat == STATIONS[2]) & (data.throttle == THROTTLES[1])) + 0.03 / data.z_hat
    )
    bent = dataclasses.replace(data, lift_N=data.lift_N * np.exp(bump))
    assert estimate(bent).relative == pytest.approx(estimate(data).relative, rel=0.05)


def test_what_the_records_explain_is_not_counted_twice():
    data = campaign(4, visits=15, relative=0.0, force=5e-4, height=0.0)
    left, blind = estimate(quiet(data, 5e-4)), estimate(quiet(data))
    assert blind.force_N == pytest.approx(5e-4, rel=0.15)
    assert left.force_N < 2.5e-4
    assert left.relative < 0.0007


def test_an_outlier_does_not_decide():
    data = quiet(campaign(4, visits=10))
    lift = data.lift_N.copy()
    lift[17] *= 1.5
    found, clean = estimate(dataclasses.replace(data, lift_N=lift)), estimate(data)
    # one of 400 moved by some 40 standard deviations counts as 3.5
    assert found.relative == pytest.approx(clean.relative, rel=0.1)
    assert found.common == pytest.approx(clean.common, rel=0.2)


def test_no_trial_decides_between_two_modes():
    """Heights that scatter by a tenth of a millimetre and more of what else a stop brings, or by
    one millimetre: equally likely here.
    """
    data = shaken(campaign(7, visits=4, height=5e-4), 7, 0.002)
    whole = estimate(data)
    sizes = np.exp(whole.modes)
    assert np.all(sizes.min(axis=0)[:2] > 0.9 * sizes.max(axis=0)[:2])
    height, common = sizes[:, 2], sizes[:, 3]
    assert height.max() > 5 * height.min()
    # one share of either mode gives both sizes
    share = (whole.height_m**2 - height[0] ** 2) / (height[1] ** 2 - height[0] ** 2)
    assert 0.2 < share < 0.8
    assert whole.common**2 == pytest.approx((1 - share) * common[0] ** 2 + share * common[1] ** 2)
    likeliest = []
    for i in range(0, data.n, 4):
        rest = estimate(data.take(np.arange(data.n) != i), start=whole)
        assert rest.height_m == pytest.approx(whole.height_m, rel=0.25)
        likeliest.append(np.exp(rest.modes[0][2]))
    assert max(likeliest) > 5 * min(likeliest)
    # nor does an outlier, before it is pulled in
    lift = data.lift_N.copy()
    lift[4] *= 1.1
    assert len(estimate(dataclasses.replace(data, lift_N=lift)).modes) == 2
    # that either may be true is an uncertainty of both sizes
    names = ("height_m", "common")
    variances = [whole.log_covariance[i][i] for i in map(whole.sizes.index, names)]
    assert variances[0] > 0.25
    assert variances[1] > 0.1


def test_two_ways_to_one_mode_count_once():
    model = variance_components.VarianceComponents(
        quiet(campaign(4)), np.zeros(400), np.ones((400, 1)), 1, 0.0
    )
    y = np.random.default_rng(1).normal(0, 0.004, 400)
    far = np.full(len(model.priors), -5.0)
    assert model.modes([far, far - 1.0], y, noise.LAST_STEP)[1] == [1.0]


def test_trials_whose_order_nobody_knows_have_no_drift_and_may_stand_in_any():
    data = dataclasses.replace(campaign(4, visits=4), ordered=False)
    mixed = np.random.default_rng(0).permutation(data.n)
    one, other = estimate(data), estimate(data.take(mixed))
    assert one.drift == other.drift == ()
    for name in ("relative", "force_N", "height_m", "common"):
        assert getattr(other, name) == pytest.approx(getattr(one, name), rel=1e-5)


def test_a_part_of_a_campaign_has_the_drift_of_the_whole():
    data = derive(campaign(4, visits=4), np.ones(160))
    some = np.flatnonzero(data.visit % 3 > 0)
    assert np.array_equal(
        variance_components.ages(data.take(some)), variance_components.ages(data)[some]
    )


def test_trials_that_share_no_visit_have_nothing_in_common():
    data = campaign(4, visits=4)
    told = estimate(dataclasses.replace(data, visit=np.arange(data.n)))
    assert told.common == 0.0
    assert "common" not in told.sizes


def test_priors_are_weak(monkeypatch):
    """Three times as narrow, they move u of a coefficient by less than a fifth where 40
    visits tell.
    """
    data = campaign(4, visits=4)
    usual = least_squares.fit(MODEL, data).estimates["K_b"].u
    monkeypatch.setattr(
        variance_components,
        "PRIORS",
        {name: (0.3 * scale, nu) for name, (scale, nu) in variance_components.PRIORS.items()},
    )
    monkeypatch.setattr(
        variance_components,
        "DRIFT_PRIORS",
        tuple((0.3 * scale, nu) for scale, nu in variance_components.DRIFT_PRIORS),
    )
    assert least_squares.fit(MODEL, data).estimates["K_b"].u == pytest.approx(usual, rel=0.2)


def test_without_revisits_the_scatter_is_about_the_model_and_says_so():
    data = quiet(campaign(4, visits=1, relative=0.005, force=0.0, height=0.0))
    told = estimate(data)
    assert told.source.startswith("scatter about the fitted model (too few revisits)")
    sigma = noise.trial_covariance(data, told, 0 * data.lift_N).sigma
    assert np.sqrt(np.mean(sigma**2)) == pytest.approx(0.005, rel=0.4)
    assert estimate(campaign(4, visits=8)).source.startswith(f"{noise.REPEATS} about cell means")


def test_exact_numbers_still_have_a_covariance():
    data = quiet(campaign(4, relative=0.0, force=0.0, height=0.0))
    told = estimate(data)
    assert told.relative < 1e-4
    assert np.isfinite(
        noise.trial_covariance(data, told, height_slope(MODEL, data, VALUES)).log_det
    )


def test_the_covariance_is_the_sum_of_its_named_parts():
    data = campaign(4, visits=2)
    slope = height_slope(MODEL, data, VALUES)
    scatter = Noise(
        relative=0.004, force_N=3e-4, height_m=2e-4, common=0.001, drift=(0.002, 0.0, 0.003)
    )
    shared = np.stack([0.001 * slope, np.full(data.n, 0.002)], axis=1)
    dense = noise.trial_covariance(data, scatter, slope, shared, 1e-6).dense()
    i, j = np.indices(dense.shape)
    same_visit = data.visit[i] == data.visit[j]
    expected = np.diag(
        (data.u_lift_N / data.lift_N) ** 2 + 0.004**2 + (3e-4 / data.lift_N) ** 2 + 1e-6
    )
    expected += same_visit * (2e-4**2 * np.outer(slope, slope) + 0.001**2)
    expected += 0.002**2 * np.exp(-np.abs(i - j) / 1.5) + 0.003**2 * np.exp(-np.abs(i - j) / 24)
    expected += 1e-6 * np.outer(slope, slope) + 0.002**2
    assert dense == pytest.approx(expected, rel=1e-12, abs=1e-18)


@pytest.mark.parametrize("n", [1, 2, 30])
def test_squares_and_slopes_of_the_determinant_are_those_of_a_dense_covariance(n):
    rng = np.random.default_rng(n)
    variance = rng.uniform(0.5, 2.0, n)
    amplitude = rng.normal(size=(n, 3))
    # a memory of 0 begins anew
    memory = rng.choice([0.0, 1.0, 0.5, 0.9], size=(n, 3))
    memory[0] = 0.0

    def shared(amplitude, k):
        passed = np.eye(n)
        for i in range(n):
            for j in range(i):
                passed[i, j] = passed[j, i] = np.prod(memory[j + 1 : i + 1, k])
        return np.outer(amplitude[:, k], amplitude[:, k]) * passed

    def log_det(factors):
        return np.linalg.slogdet(
            np.diag(variance) + sum(shared(amplitude * factors, k) for k in range(3))
        )[1]

    d, w = semiseparable.factor(variance, amplitude, memory)
    by_variance, by_amplitude = semiseparable.log_det_slopes(d, w, amplitude, memory)
    dense = np.diag(variance) + sum(shared(amplitude, k) for k in range(3))
    assert by_variance == pytest.approx(np.diag(np.linalg.inv(dense)), rel=1e-10)
    step = 1e-5 * np.eye(3)
    by_hand = [(log_det(1 + s) - log_det(1 - s)) / 2e-5 for s in step]
    assert by_amplitude == pytest.approx(by_hand, abs=1e-7)
    x = rng.normal(size=(n, 5))
    expected = [np.trace(x.T @ shared(amplitude, k) @ x) for k in range(3)]
    assert semiseparable.squares(amplitude, memory, x) == pytest.approx(expected, rel=1e-10)
