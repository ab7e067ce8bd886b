"""The posterior against closed forms and brute force, and chain against grid.

False-alarm rates are given where there are any.
"""

import re

import numpy as np
import pytest
from scipy import stats
from tests.unit import simulated

from nearlift import catalogue
from nearlift.declare import Check, LiftModel, Parameter, Source, normal, uniform
from nearlift.errors import NotConverged
from nearlift.fit import posterior
from nearlift.fit.density import Density, TruncatedPrior
from nearlift.fit.least_squares import fit
from nearlift.fit.summary import compare_with_prior
from nearlift.results import Noise

NOISE = Noise(relative=0.005, force_N=3e-4, height_m=1e-4)


BELIEVED, FLAT = normal(0.0, 1.0), uniform(-10, 10)


def line(prior=BELIEVED, bounds=(-10.0, 10.0)):
    """log ratio = a / z_hat^2: linear in its one parameter, so least squares and posterior have
    closed forms.
    """
    return LiftModel(
        name="line",
        title="line",
        formula="a",
        evaluate=lambda z_hat, /, *, a: np.exp(a / np.square(z_hat)),
        parameters=(
            Parameter(name="a", unit="1", value=0.1, bounds=bounds, prior=prior, meaning="slope"),
        ),
        source=Source("none", doubts=("all of it",)),
        checks=(Check(x=1.0, expected=np.exp(0.1)),),
        boundary="ground",
    )


def density(model="sanchez_cuevas", seed=1, dof=np.inf, **more):
    model = catalogue.model(model) if isinstance(model, str) else model
    found = fit(model, simulated.campaign(seed, boundary=model.boundary, **more), scatter=NOISE)
    return Density(problem=found.problem, centre=found.theta, dof=dof), found


def test_the_likelihood_integrates_l_inf_out():
    """By brute force: the n-dimensional normal density integrated over the level of the only
    throttle, flat in its logarithm.
    """
    data = simulated.campaign(3, stations=(1.2, 2.0, 6.0), visits=2)
    data = data.take(data.throttle == 0.25)
    found = fit(line(), data, scatter=NOISE)
    target = Density(problem=found.problem, centre=found.theta)
    covariance, log_lift = found.problem.covariance.dense(), np.log(data.lift_N)
    theta = found.theta + 0.01
    rest = log_lift - found.problem.log_ratio(theta)
    levels = np.linspace(-0.03, 0.03, 4001) + found.problem.best_levels(rest)
    rest = rest - levels[:, None]
    each = stats.multivariate_normal(np.zeros(data.n), covariance).logpdf(rest) - log_lift.sum()
    brute = np.log(np.exp(each - each.max()).sum() * (levels[1] - levels[0])) + each.max()
    assert target.log_likelihood(theta[None, :])[0] == pytest.approx(brute, abs=1e-5)


@pytest.mark.parametrize("dof", [np.inf, 9.0])
def test_a_linear_model_has_the_intervals_of_least_squares(dof):
    """With a flat prior, t at the noise's degrees of freedom, exactly: the tolerance is 5 standard
    errors of a quantile from 4000 draws.
    """
    target, found = density(line(FLAT), dof=dof)
    drawn = posterior.sample(target, 1).theta[:, :, 0].ravel()
    u = np.sqrt(found.covariance[0, 0])
    law = stats.t(dof) if np.isfinite(dof) else stats.norm()
    for p in (0.05, 0.5, 0.95):
        share = np.mean(drawn < found.theta[0] + u * law.ppf(p))
        assert abs(share - p) < 5 * np.sqrt(p * (1 - p) / 4000)


@pytest.mark.parametrize("dof", [np.inf, 9.0])
def test_the_evidence_is_the_integral(dof):
    target, found = density(line(), dof=dof)
    u = np.sqrt(found.covariance[0, 0])
    a = np.linspace(-400, 400, 400_001)[:, None] * u * 0.1 + found.theta
    log = target(a)
    brute = np.log(np.exp(log - log.max()).sum() * (a[1, 0] - a[0, 0])) + log.max()
    drawn = posterior.sample(target, 2)
    assert drawn.u_log_evidence < 1e-6
    assert drawn.log_evidence == pytest.approx(brute, abs=1e-4)
    # what few degrees of freedom do to the shape, they do not do to the integral over a flat prior
    flat = Density(problem=target.problem, centre=found.theta, dof=dof)
    likelihood = flat.log_likelihood(a)
    normal_integral = float(found.problem.log_likelihood(found.theta)) + np.log(
        u * np.sqrt(2 * np.pi)
    )
    levels, log_det = found.problem.levels_log_det
    integral = (
        np.log(np.exp(likelihood - likelihood.max()).sum() * (a[1, 0] - a[0, 0])) + likelihood.max()
    )
    assert integral == pytest.approx(
        normal_integral + 0.5 * levels * np.log(2 * np.pi) - 0.5 * log_det, abs=2e-3
    )


def test_levels_given_the_parameters_are_those_of_least_squares():
    target, found = density(line(FLAT))
    drawn = posterior.sample(target, 3)
    for i, (throttle, level) in enumerate(found.levels.items()):
        each = drawn.levels_N[:, :, i].ravel()
        assert abs(each.mean() - level.value) < 5 * level.u / np.sqrt(4000), throttle
        assert each.std() == pytest.approx(level.u, rel=5 / np.sqrt(2 * 4000))


def test_the_posterior_is_the_prior_where_the_data_are_blind():
    """All trials at one distance: L_inf takes everything. 5 standard errors of a quantile."""
    target, _ = density("sanchez_cuevas", stations=(1.5,), visits=12)
    found = posterior.sample(target, 1)
    prior = target.priors[0]
    assert abs(
        np.mean(found.theta[:, :, 0].ravel() < prior.quantile(0.5)) - 0.5
    ) < 5 * 0.5 / np.sqrt(4000)
    ratio, words = compare_with_prior(prior, found.theta[:, :, 0].ravel())
    assert ratio == pytest.approx(1.0, abs=0.1)
    assert (
        "the data say nothing about K_b: its interval is the prior's (normal, mean 2, sd 4), not a"
        " result" in words
    )


def test_a_posterior_at_a_bound_is_said_to_be():
    target, _ = density(
        "hsiao_chirarattananon",
        ratio=lambda z: 0.5 + 0.5 * np.sqrt(np.maximum(1 - 0.03 / z**2, 0)),
        stations=(0.3, 0.5, 1.0, 4.0),
    )
    found = posterior.sample(target, 1)
    assert found.theta.min() >= 0
    _, words = compare_with_prior(target.priors[0], found.theta[:, :, 0].ravel())
    assert re.search(r"\b(9\d|100) % of the posterior of alpha lies against its bound 0", words)


def test_a_model_without_parameters_has_levels_and_evidence():
    target, found = density("cheeseman_bennett_fixed")
    drawn = posterior.sample(target, 1, ess=400)
    assert drawn.sampler == "none"
    assert drawn.theta.shape == (4, 100, 0)
    assert drawn.levels_N.shape == (4, 100, len(found.levels))
    assert drawn.log_evidence == pytest.approx(float(target(np.zeros((1, 0)))[0]))


def test_the_same_seed_gives_the_same_draws_and_another_does_not():
    target, _ = density("sanchez_cuevas")
    one, same, other = (posterior.sample(target, s, "ground", ess=400).theta for s in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert not np.array_equal(one, other)


def test_priors_are_cut_off_at_the_bounds_and_integrate_to_one():
    parameter = Parameter(
        name="a", unit="1", value=0.0, bounds=(-0.5, 3.0), prior=normal(0.0, 1.0), meaning="m"
    )
    prior = TruncatedPrior(parameter=parameter)
    x = np.linspace(-0.5, 3.0, 20_001)
    assert np.trapezoid(np.exp(prior.log_density(x)), x) == pytest.approx(1.0, abs=1e-6)
    assert np.isneginf(prior.log_density(np.array([-0.51, 3.01]))).all()
    assert prior.width90 == pytest.approx(
        np.diff(stats.truncnorm(-0.5, 3.0).ppf([0.05, 0.95]))[0], rel=1e-9
    )


@pytest.mark.parametrize(
    ("model", "more"),
    [
        ("sanchez_cuevas", {}),
        ("sanchez_cuevas_free_exponent", {}),
        ("power_law", {"dof": 9.0}),
        (
            "sidewall_decay",
            {
                "ratio": lambda z: 1 - 0.015 * np.exp(-z / 0.33),
                "stations": (0.1, 0.2, 0.35, 0.6, 1.2, 3.0, 8.0),
                "visits": 2,
            },
        ),
    ],
)
def test_chain_and_grid_agree_and_deliver_what_was_asked(model, more):
    """Bent and long-tailed shapes among them. Draws of the grid have five standard errors."""
    target, _ = density(model, seed=5, **more)
    chain = posterior.sample(target, 1, ess=2000)
    drawn = posterior.sample(target, 1, ess=2000, chain=False)
    assert (chain.sampler, drawn.sampler) == ("emcee", "grid")
    assert [c.by for c in chain.checks] == ["grid"]
    assert chain.checks[0].apart < posterior.APART
    assert not chain.checks[0].unfit
    assert chain.ess.min() >= 2000
    assert chain.ess_tail.min() >= 1000
    assert 0.15 < chain.acceptance < 0.8
    assert chain.tau.min() > 1
    assert chain.log_evidence == drawn.log_evidence
    for i in range(len(drawn.names)):
        mean, sd = drawn.exact.moments(i)
        assert abs(drawn.theta[:, :, i].ravel().mean() - mean) < 5 * sd / np.sqrt(2000)
        for p, end in zip((0.05, 0.95), drawn.exact.quantiles(i, [0.05, 0.95]), strict=True):
            share = np.mean(drawn.theta[:, :, i].ravel() < end)
            assert abs(share - p) < 5 * np.sqrt(p * (1 - p) / 2000)


@pytest.mark.parametrize("dof", [np.inf, 5.0])
@pytest.mark.parametrize("model", ["sanchez_cuevas", "sanchez_cuevas_free_exponent", "power_law"])
def test_the_peak_is_where_the_grid_is_densest(model, dof):
    """To the sixteenth of a standard uncertainty that it is rounded to, in each of two
    directions.
    """
    target, _ = density(model, seed=5, dof=dof)
    exact = posterior.grid(target)
    densest = exact.theta[np.argmax(exact.mass)]
    away = (target.peak - densest) / np.sqrt(np.diag(target.spread))
    assert np.abs(away).max() < 1 / 16 + 12 / 192


class Lopsided(Density):
    """A defect: the walkers have another density than the grid."""

    def __call__(self, theta):
        # walkers come by the count of half an ensemble, points of a grid by the hundred
        return super().__call__(theta) + (20.0 * theta[:, 0] if 1 < len(theta) <= 40 else 0.0)


def test_a_disagreement_of_chain_and_grid_is_an_error():
    target, found = density("sanchez_cuevas")
    wrong = Lopsided(problem=target.problem, centre=found.theta)
    steps = []
    with pytest.raises(
        NotConverged,
        match=r"(?s)emcee and the grid disagree: \d+ % of K_b lie below .* errors apart",
    ):
        posterior.sample(wrong, 1, ess=1000, progress=steps.append)
    # continued to twice the length before it is refused
    assert steps[-1] >= 4 * posterior.BLOCK_STEPS
    assert steps == list(range(posterior.BLOCK_STEPS, steps[-1] + 1, posterior.BLOCK_STEPS))


def test_too_few_steps_are_refused_with_the_number_that_is_enough():
    target, _ = density("sanchez_cuevas_free_exponent")
    with pytest.raises(
        NotConverged,
        match=r"(?s)200 steps of 50 walkers, tau = \d.*run at least \d+: `steps = \d+` in \[fit\]",
    ) as refusal:
        posterior.sample(target, 1, ess=2000, steps=200)
    enough = int(refusal.value.remedy.split()[3].rstrip(":"))
    assert 200 < enough < 5000
    assert refusal.value.exit_code == 5
    found = posterior.sample(target, 1, ess=2000, steps=2 * enough)
    assert found.ess.min() >= 2000


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
def test_the_effective_size_is_that_of_an_autoregression(memory):
    """(1 - r) / (1 + r) of the number; a quantity that is constant counts in full."""
    rng, n = np.random.default_rng(3), 4000
    noise = np.sqrt(1 - memory**2) * rng.standard_normal((n, 4))
    steps = np.zeros((n, 4, 2))
    for i in range(1, n):
        steps[i, :, 0] = memory * steps[i - 1, :, 0] + noise[i]
    expected = 4 * n * (1 - memory) / (1 + memory)
    assert posterior.effective_draws(steps) == pytest.approx([expected, 4 * n], rel=0.15)


def test_walkers_find_nowhere_to_start():
    target, found = density("sanchez_cuevas")

    class Nowhere(Density):
        def __call__(self, theta):
            return np.full(len(theta), -np.inf)

    with pytest.raises(NotConverged, match="no place near the fit has a finite density"):
        posterior.start(
            Nowhere(problem=target.problem, centre=found.theta), np.random.default_rng(1), 32
        )


def test_an_interrupted_chain_prints_nothing(capsys):
    target, _ = density()
    calls = iter([0] * 3)

    class Interrupted:
        centre, peak, problem = target.centre, target.peak, target.problem
        spread = staticmethod(target.spread)

        def __call__(self, theta):
            if next(calls, None) is None:
                raise KeyboardInterrupt
            return target(theta)

    with pytest.raises(KeyboardInterrupt):
        posterior.run_chain(Interrupted(), lambda _: np.random.default_rng(1), ess=200, most=1000)
    assert capsys.readouterr() == ("", "")
