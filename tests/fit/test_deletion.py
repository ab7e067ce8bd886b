"""Deletion in closed form: shifts and predictions are those of dense algebra and of refits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from tests.unit.simulated import campaign, hsiao

from nearlift import catalogue
from nearlift.fit.deletion import DeletionDiagnostics, influence, score
from nearlift.fit.least_squares import fit
from nearlift.likelihood.budget import Component
from nearlift.results import Noise

SCATTER = Noise(relative=0.004, force_N=3e-4, height_m=1e-4, common=0.001)
PARTS = (
    Component(name="datum", on="height", standard=2e-4, distribution="normal", scope="boundary"),
    Component(name="gain", on="gain", standard=0.005, distribution="normal", scope="session"),
)
CASES = {
    "ground": ("sanchez_cuevas", {}, PARTS),
    "two coefficients": ("power_law", {}, PARTS),
    "none": ("cheeseman_bennett_fixed", {}, PARTS),
    "no budget": ("sanchez_cuevas", {}, ()),
    "height error": (
        "hsiao_chirarattananon",
        {
            "boundary": "ceiling",
            "ratio": hsiao,
            "stations": (0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 10.0),
            "datum": 2e-4,
        },
        PARTS,
    ),
}


def brute(found, left_out):
    """The predictive density of the visit's trials given all others, by dense matrices;
    coefficients and levels free (flat).
    """
    problem = found.problem
    data, covariance = problem.data, problem.covariance.dense()
    x = np.eye(len(data.levels))[data.level]
    if len(found.theta):
        x = np.hstack([x, problem.jacobian(found.theta)])
    y = np.log(data.lift_N) - problem.log_ratio(found.theta)
    b, a = data.visit == left_out, data.visit != left_out
    inverse = np.linalg.inv(covariance[np.ix_(a, a)])
    given = np.linalg.inv(x[a].T @ inverse @ x[a])
    best = given @ x[a].T @ inverse @ y[a]
    carry = covariance[np.ix_(b, a)] @ inverse
    error = y[b] - x[b] @ best - carry @ (y[a] - x[a] @ best)
    toll = x[b] - carry @ x[a]
    spread = covariance[np.ix_(b, b)] - carry @ covariance[np.ix_(a, b)] + toll @ given @ toll.T
    return multivariate_normal.logpdf(error, cov=spread), float(error @ error)


def estimated(found, keep):
    """The coefficients from some of the trials by dense least squares about the fit's own optimum,
    the covariance as it is.
    """
    problem = found.problem
    data, covariance = problem.data, problem.covariance.dense()[np.ix_(keep, keep)]
    x = np.hstack([np.eye(len(data.levels))[data.level], problem.jacobian(found.theta)])[keep]
    y = (np.log(data.lift_N) - problem.log_ratio(found.theta))[keep]
    return np.linalg.lstsq(
        x.T @ np.linalg.solve(covariance, x), x.T @ np.linalg.solve(covariance, y), rcond=None
    )[0][len(data.levels) :]


@pytest.mark.parametrize("case", CASES)
def test_the_closed_form_is_dense_prediction_and_dense_least_squares(case):
    """Of visits left out, and of coefficients without a trial or a visit."""
    name, kind, parts = CASES[case]
    about = 2e-4 if case == "height error" else 0.0
    found = fit(
        catalogue.model(name), campaign(3, visits=3, **kind), parts, SCATTER, offset_m=about
    )
    held, data, u = influence(found), found.problem.data, np.sqrt(np.diag(found.covariance))
    assert held.predicted.all()
    assert held.visit.tolist() == sorted(set(data.visit.tolist()))
    for v in (0, 5, 11):
        density, squares = brute(found, v)
        assert held.log_density[v] == pytest.approx(density, abs=1e-6)
        assert held.squares[v] == pytest.approx(squares, rel=1e-6)
    whole = estimated(found, np.ones(data.n, dtype=bool))
    kept = [(held.of_trial[i], np.arange(data.n) != i) for i in (0, 17, 60)]
    kept += [(held.of_visit[v], data.visit != held.visit[v]) for v in (0, 5, 11)]
    for shift, rest in kept:
        expected = (estimated(found, rest) - whole) / u
        np.testing.assert_allclose(shift / u, expected, rtol=1e-5, atol=1e-7)


def test_a_wrong_model_foretells_worse_and_a_needless_parameter_gains_nothing():
    data = campaign(3, visits=8)
    fits = {
        n: fit(catalogue.model(n), data, PARTS, SCATTER)
        for n in (
            "sanchez_cuevas",
            "sanchez_cuevas_free_exponent",
            "cheeseman_bennett",
            "cheeseman_bennett_fixed",
        )
    }
    held = {n: influence(f) for n, f in fits.items()}
    scores = {n: score(h, held["sanchez_cuevas"]) for n, h in held.items()}
    own = scores["sanchez_cuevas"]
    assert (own.d_elpd, own.u_d_elpd, own.d_rmse, own.u_d_rmse) == (0, 0, 0, 0)
    assert own.visits == 80
    for wrong in ("cheeseman_bennett", "cheeseman_bennett_fixed"):
        assert scores[wrong].d_elpd < -5 * scores[wrong].u_d_elpd < 0
        assert scores[wrong].d_rmse > 3 * scores[wrong].u_d_rmse > 0
    assert abs(scores["sanchez_cuevas_free_exponent"].d_elpd) < 3
    # trials scatter by 0.4 % and heights by 0.1 mm
    assert own.rmse == pytest.approx(0.0045, rel=0.2)


def scored(visit, count, **scores):
    """Deletion diagnostics of which only the prediction of visits matters."""
    one = np.ones(len(visit))
    return DeletionDiagnostics(
        of_trial=one[:, None],
        residual=one,
        visit=visit,
        of_visit=one[:, None],
        count=count,
        chi2=one,
        **scores,
    )


def test_the_standard_error_is_the_scatter_between_visits():
    rng = np.random.default_rng(1)
    visit, n = np.arange(50), np.full(50, 4)
    a, b = (
        scored(visit, n, log_density=rng.normal(size=50), squares=rng.chisquare(4, 50))
        for _ in range(2)
    )
    found = score(a, b)
    excess = a.log_density - b.log_density
    assert found.d_elpd == pytest.approx(excess.sum())
    assert found.u_d_elpd == pytest.approx(np.sqrt(50 * excess.var(ddof=1)))
    assert found.rmse == pytest.approx(np.sqrt(a.squares.sum() / 200))
    assert found.d_rmse == pytest.approx(found.rmse - np.sqrt(b.squares.sum() / 200))
    # to first order an rmse is a mean, and its standard error the scatter over the root of the
    # number
    first = (a.squares / (2 * found.rmse) - b.squares / (2 * (found.rmse - found.d_rmse))) / 4
    assert found.u_d_rmse == pytest.approx(first.std(ddof=1) / np.sqrt(50), rel=0.05)


def test_only_visits_that_both_predict_are_compared():
    def held(visits, n=4):
        ones = np.ones(len(visits))
        return scored(np.array(visits), n * ones, log_density=ones, squares=ones)

    assert score(held([1, 2, 3, 5]), held([0, 2, 3, 5])).visits == 3
    assert score(held([1, 2], n=3), held([1, 2])).visits == 0


def test_a_visit_that_nothing_foretells_is_left_out():
    """One throttle was run in one visit only: without it there is no L_inf to predict with."""
    data = campaign(3, visits=3)
    only = (data.throttle == 0.92) & (data.visit != 4)
    found = fit(catalogue.model("sanchez_cuevas"), data.take(~only), (), SCATTER)
    held = influence(found)
    assert held.visit[~held.predicted].tolist() == [4]
    assert score(held, held).skipped == 1


@pytest.mark.parametrize("size", [0.0, 0.03, -0.05])
def test_shifts_are_those_of_a_fit_without_the_trial(size):
    """The curve is bent, so the shift by a trial of several u is predicted to a tenth of it, an
    ordinary one to a hundredth of u.
    """
    data = campaign(3, visits=4)
    nearest = int(np.argmin(data.z_hat + (data.throttle < 0.9)))
    data = replace(data, lift_N=data.lift_N * np.where(np.arange(data.n) == nearest, 1 + size, 1.0))
    model = catalogue.model("sanchez_cuevas")
    found = fit(model, data, (), SCATTER, offset_m=0.0)
    rest = np.arange(data.n) != nearest
    again = fit(model, data.take(rest), (), SCATTER, found.slope[rest], 0.0)
    shift, u = again.theta[0] - found.theta[0], found.estimates["K_b"].u
    assert influence(found).of_trial[nearest, 0] == pytest.approx(shift, rel=0.1, abs=0.01 * u)


def test_what_the_others_do_not_determine_has_no_influence_to_tell():
    data = campaign(3, visits=4)
    alone = np.arange(data.n) == 7
    data = replace(data, throttle=np.where(alone, 0.6, data.throttle))
    moved = influence(fit(catalogue.model("sanchez_cuevas"), data, (), SCATTER, offset_m=0.0))
    assert np.isnan(moved.residual[alone]).all()
    assert np.isnan(moved.of_trial[alone]).all()
    assert np.isfinite(moved.residual[~alone]).all()
