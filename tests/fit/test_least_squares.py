"""Fits of whole campaigns: against an independent optimiser, under symmetries, at the edges, and
what is said about them.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.optimize
import scipy.stats
from tests.unit.simulated import GEOMETRY, L_INF, THROTTLES, campaign, hsiao, sanchez_cuevas

from nearlift import catalogue
from nearlift.declare import Check, LiftModel, Parameter, Source, uniform
from nearlift.errors import NotConverged
from nearlift.fit.information import degeneracies, parameter_covariance
from nearlift.fit.least_squares import LeastSquaresFit, assemble, fit
from nearlift.fit.solver import solve
from nearlift.fit.summary import closeness, summary
from nearlift.likelihood import noise
from nearlift.likelihood.budget import Component
from nearlift.likelihood.problem import Likelihood
from nearlift.results import Noise, Observations

MODEL = catalogue.model("sanchez_cuevas")
CEILING = campaign(4, boundary="ceiling", ratio=hsiao, stations=(0.2, 0.5, 1.0, 2.0, 8.0))
FREE = catalogue.model("sanchez_cuevas_free_exponent")
SCATTER = Noise(relative=0.004, force_N=3e-4, height_m=1e-4)
DATUM = Component(name="datum", on="height", standard=2e-4, distribution="normal", scope="boundary")


def reference(data: Observations, found: LeastSquaresFit) -> tuple[np.ndarray, np.ndarray, float]:
    """K_b and log L_inf fitted together by scipy with the dense covariance: theta, covariance,
    chi2.
    """
    problem = assemble(MODEL, data, (DATUM,), SCATTER, found.theta)
    white = np.linalg.inv(np.linalg.cholesky(problem.covariance.dense()))
    indicator = (data.throttle[:, None] == data.levels).astype(float)

    def residuals(x: np.ndarray) -> np.ndarray:
        return white @ (
            np.log(data.lift_N) - indicator @ x[1:] - np.log(sanchez_cuevas(data.z_hat, x[0]))
        )

    start = np.r_[1.0, np.log([L_INF[t] for t in data.levels])]
    r = scipy.optimize.least_squares(
        residuals,
        start,
        method="lm",
        xtol=1e-14,
        ftol=1e-14,
        gtol=1e-14,
        x_scale=[0.1, 1e-3, 1e-3, 1e-3, 1e-3],
    )
    return r.x, np.linalg.inv(r.jac.T @ r.jac), 2 * r.cost


def test_a_fit_is_that_of_all_unknowns_together():
    data = campaign(3)
    found = fit(MODEL, data, (DATUM,), SCATTER, offset_m=0.0)
    x, covariance, chi2 = reference(data, found)
    assert found.theta == pytest.approx(x[:1], abs=1e-5)
    assert found.estimates["K_b"].u == pytest.approx(covariance[0, 0] ** 0.5, rel=1e-4)
    assert found.chi2 == pytest.approx(chi2, rel=1e-8)
    for i, throttle in enumerate(THROTTLES, 1):
        level = found.levels[throttle]
        assert level.value == pytest.approx(np.exp(x[i]), rel=1e-7)
        assert level.u == pytest.approx(np.exp(x[i]) * covariance[i, i] ** 0.5, rel=1e-4)


@pytest.mark.parametrize("scale", [1e-2, 50.0])
def test_all_forces_times_c_scale_L_inf_and_nothing_else(scale):
    """Scatter estimated again each time: that too must follow the unit of force."""
    data = campaign(3)
    other = dataclasses.replace(data, lift_N=scale * data.lift_N, u_lift_N=scale * data.u_lift_N)
    one, two = fit(MODEL, data, (DATUM,)), fit(MODEL, other, (DATUM,))
    assert two.estimates["K_b"].value == pytest.approx(one.estimates["K_b"].value, rel=1e-4)
    assert two.estimates["K_b"].u == pytest.approx(one.estimates["K_b"].u, rel=1e-3)
    assert two.chi2 == pytest.approx(one.chi2, rel=1e-3)
    assert closeness(two)[0] == pytest.approx(closeness(one)[0], rel=1e-6)
    for throttle in THROTTLES:
        assert two.levels[throttle].value == pytest.approx(
            scale * one.levels[throttle].value, rel=1e-6
        )
        assert two.levels[throttle].u == pytest.approx(scale * one.levels[throttle].u, rel=1e-3)


def test_the_truth_is_found_where_nothing_scatters():
    data = campaign(3, relative=0.0, force=0.0, height=0.0)
    found = fit(FREE, data, (), SCATTER)
    assert found.theta == pytest.approx([2.0, 1.0], abs=1e-6)
    assert found.chi2 == pytest.approx(0.0, abs=1e-8)
    assert {t: level.value for t, level in found.levels.items()} == pytest.approx(L_INF, rel=1e-8)
    assert closeness(found)[1] == pytest.approx(1.0)


def test_numbers_that_papers_quote_are_what_they_say():
    data = campaign(3)
    fitted = fit(MODEL, data, (), SCATTER)
    found = summary(fitted)
    level = np.array([found.L_inf_N[t].value for t in data.throttle])
    ratio = sanchez_cuevas(data.z_hat, fitted.theta[0])
    assert found.rmse == pytest.approx(np.sqrt(np.mean(np.log(data.lift_N / level / ratio) ** 2)))
    assert found.dof == data.n - 4 - 1
    assert found.aic == pytest.approx(2 * 5 - 2 * found.log_likelihood)
    assert found.bic == pytest.approx(5 * np.log(data.n) - 2 * found.log_likelihood)

    def r2(keep: np.ndarray) -> float:
        """Of the means of cells, each cell counting once."""
        cells = sorted({(z, t) for z, t in zip(data.z_hat[keep], data.throttle[keep], strict=True)})
        members = [(data.z_hat == z) & (data.throttle == t) for z, t in cells]
        measured = np.array([(data.lift_N / level - 1)[m].mean() for m in members])
        predicted = np.array([ratio[m][0] - 1 for m in members])
        return 1 - np.sum((measured - predicted) ** 2) / np.sum((measured - measured.mean()) ** 2)

    assert found.r2 == pytest.approx(r2(data.z_hat > 0))
    assert found.r2_near == pytest.approx(r2((data.z_hat > 1) & (data.z_hat < 3)))


def test_r2_near_is_for_the_ground_only():
    ceiling = campaign(3, boundary="ceiling", ratio=hsiao, stations=(0.2, 0.5, 1.0, 2.0, 2.5, 8.0))
    assert closeness(fit(catalogue.model("hsiao_chirarattananon"), ceiling))[2] is None
    assert np.isfinite(closeness(fit(MODEL, campaign(3)))[2])
    # none of its trials is near
    assert np.isnan(closeness(fit(MODEL, campaign(3, stations=(3.5, 5.0, 9.0))))[2])


def test_intervals_know_how_few_repeats_the_scatter_came_from():
    data = campaign(3, visits=2)
    found = fit(MODEL, data)
    e = found.estimates["K_b"]
    # of 18 between visits, 40 within cells and as many combined by Welch and Satterthwaite
    assert 5 < found.effective[0] < 58
    t = scipy.stats.t.ppf(0.95, found.effective[0])
    assert (e.hi90 - e.value, e.value - e.lo90) == pytest.approx((t * e.u, t * e.u))
    given = fit(MODEL, data, (), Noise(relative=0.004)).estimates["K_b"]
    assert (given.hi90 - given.value) / given.u == pytest.approx(1.6448536, rel=1e-6)


LAYOUT = {
    "layout_hat": GEOMETRY["spacing_hat"] / 2 * np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)])
}


@pytest.mark.parametrize("name", ["cheeseman_bennett_fixed", "hayden", "images", "sidewall_none"])
def test_a_model_with_nothing_free_is_compared_all_the_same(name):
    model = catalogue.model(name)
    data = campaign(3, visits=1, boundary=model.boundary)
    found = fit(model, dataclasses.replace(data, geometry={**GEOMETRY, **LAYOUT}), (DATUM,))
    assert (found.theta.shape, found.covariance.shape, found.estimates, degeneracies(found)) == (
        (0,),
        (0, 0),
        {},
        (),
    )
    assert found.dof == data.n - 4
    entry = summary(found)
    assert np.isfinite([entry.chi2, entry.rmse, entry.aic, entry.bic]).all()
    assert all(level.u > 0 for level in found.levels.values())


def test_a_parameter_at_its_bound_says_so():
    """A ceiling that takes lift away: alpha would be negative, and stops at 0."""
    data = campaign(
        3,
        boundary="ceiling",
        ratio=lambda z: 1 - 0.05 * np.exp(-z),
        stations=(0.2, 0.5, 1.0, 2.0, 8.0),
    )
    found = fit(catalogue.model("hsiao_chirarattananon"), data).estimates["alpha"]
    assert found.at_bound
    assert found.value == pytest.approx(0.0, abs=1e-5)
    assert not fit(MODEL, campaign(3)).estimates["K_b"].at_bound


def test_trials_below_a_models_pole_are_left_out_with_the_reason():
    data = campaign(3, stations=(0.2, 0.25, 0.8, 1.5, 3.0, 9.0), ratio=lambda z: 1 + 0.1 / z)
    found = fit(catalogue.model("cheeseman_bennett_fixed"), data)
    assert found.problem.data.n == data.n - 2 * 4 * 4
    assert {e.trial for e in found.excluded} == set(data.trial[data.z_hat <= 0.25])
    assert {e.reason for e in found.excluded} == {
        "z_hat = 0.2 is outside 0.25 < z_hat <= inf where cheeseman_bennett_fixed holds",
        "z_hat = 0.25 is outside 0.25 < z_hat <= inf where cheeseman_bennett_fixed holds",
    }


def pairs(found: LeastSquaresFit) -> dict[tuple[str, str], str]:
    return {d.pair: d.text for d in degeneracies(found)}


def test_degeneracies_are_named():
    """The three that the ground is known for: K_b with the exponent, with the height's datum, and k
    with both.
    """
    fixed, free = fit(MODEL, campaign(3)), fit(FREE, campaign(3))
    text = pairs(fixed)["K_b", "exponent n"]
    assert text.startswith("K_b and an unknown exponent n are confounded: r = −0.9")
    # and what it costs is what a fit with the exponent free pays
    grown = float(text.partition("u(K_b) would be ")[2].split()[0])
    assert grown == pytest.approx(free.estimates["K_b"].u, rel=0.1)
    assert pairs(free)["K_b", "n"].startswith("K_b and n are confounded: r = −0.9")
    assert ("K_b", "exponent n") not in pairs(free)
    near = pairs(fit(MODEL, campaign(3, stations=(2.0, 2.5, 3.0, 4.0, 5.0, 7.0))))
    assert "With a free height offset, u(K_b) would be " in near["K_b", "height offset"]
    assert near["K_b", "height offset"].endswith("mm")
    slow = pairs(fit(catalogue.model("power_law"), campaign(3, stations=(1.5, 2.0, 3.0, 5.0))))
    assert slow["p", "L_inf at 75%"].startswith(
        "p and L_inf at 75% throttle are confounded: r = +0.9"
    )


def test_what_no_trial_determines_is_infinitely_uncertain_and_named():
    """Without the wall's loss its length means nothing; u = 0 would be a lie."""
    data = campaign(
        3,
        boundary="sidewall",
        ratio=lambda z: 0 * z + 1,
        stations=(0.1, 0.3, 0.6, 1.2, 5.0),
        relative=0.0,
        force=0.0,
        height=0.0,
    )
    found = fit(catalogue.model("sidewall_decay"), data, (), SCATTER)
    assert found.theta[0] == pytest.approx(0.0, abs=1e-9)
    assert found.estimates["lambda_"].u == np.inf
    assert np.isfinite(found.estimates["a"].u)
    assert pairs(found)["lambda_", "anything"] == "λ is not identifiable from these trials"


def test_parameter_covariance_parts_what_is_determined_from_what_is_not():
    rng = np.random.default_rng(2)
    a, b = rng.normal(size=(2, 50))
    covariance, determined = parameter_covariance(np.stack([a, 1e6 * b]))
    assert covariance == pytest.approx(
        np.linalg.inv(np.array([[a @ a, 1e6 * a @ b], [1e6 * a @ b, 1e12 * b @ b]])), rel=1e-8
    )
    assert determined.tolist() == [True, True]
    # the second and the third are one unknown under two names
    covariance, determined = parameter_covariance(np.stack([a, b, -2 * b]))
    assert determined.tolist() == [True, False, False]
    assert np.isfinite(covariance).all()


def test_too_few_trials_are_refused_with_the_number_that_would_do():
    data = campaign(3, visits=1)
    text = r"fit of sanchez_cuevas: 6 usable trials for 5 unknowns\n  at least 7 trials are needed"
    with pytest.raises(NotConverged, match=text):
        fit(MODEL, data.take(np.array([0, 1, 2, 3, 4, 5])))
    assert fit(MODEL, data.take(np.arange(8)), (), SCATTER).problem.data.n == 8
    none = campaign(3, stations=(0.1, 0.2), ratio=lambda z: 1 + 0 * z)
    with pytest.raises(
        NotConverged, match="0 usable trials for 1 unknowns\n  at least 3 trials are needed"
    ):
        fit(MODEL, none)


def steep(value: float) -> LiftModel:
    """1 / (1 - k / z): its pole stands at z_hat = k, and its declared range does not know."""
    return LiftModel(
        name="steep",
        title="steep",
        formula="1 / (1 - k / z)",
        evaluate=lambda z, /, *, k: 1 / (1 - k / np.asarray(z)),
        boundary="ground",
        parameters=(
            Parameter(
                name="k",
                unit="1",
                value=value,
                bounds=(0.0, 5.0),
                prior=uniform(0.0, 5.0),
                meaning="place of the pole",
            ),
        ),
        source=Source("this test", doubts=("all of it",)),
        checks=(Check(x=2.0, expected=2.0, arguments={"k": 1.0}, quoted_by="by hand"),),
    )


def test_a_start_beyond_a_pole_is_left_for_one_where_the_model_has_a_value():
    data = campaign(3, ratio=lambda z: 1 / (1 - 0.5 / z), height=0.0)
    problem = assemble(steep(1.45), data, (), SCATTER, np.array([0.5]))
    assert minimum(problem)[0] == pytest.approx(0.5, abs=0.01)
    assert minimum(problem, np.array([1.3]))[0] == pytest.approx(0.5, abs=0.01)


def test_a_model_without_a_value_wherever_it_starts_is_refused_with_the_trials_to_blame():
    model = dataclasses.replace(
        steep(0.5),
        evaluate=lambda z, /, *, k: np.where(np.asarray(z) < 1.2, np.nan, 1 + k),
    )
    data = campaign(3)
    problem = Likelihood(
        model=model, data=data, covariance=noise.trial_covariance(data, SCATTER, np.zeros(data.n))
    )
    text = (
        r"fit of steep: the model has no value at its start, k = 0\.5, for some of the 160 trials,"
        r" nor elsewhere\n  choose another model, or leave out the 16 trials without a value \(z_hat"
        r" from 1\.14 to 1\.14\)"
    )
    with pytest.raises(NotConverged, match=text):
        minimum(problem)


def minimum(problem, start=None):
    """By lmfit, and by Levenberg-Marquardt steps, which agree."""
    both = [solve(problem, start, quoted=quoted)[0] for quoted in (True, False)]
    assert both[0] == pytest.approx(both[1], abs=1e-8)
    return both[0]


def test_an_optimiser_that_gives_up_is_not_believed(monkeypatch):
    import lmfit

    problem = assemble(FREE, campaign(3), (), SCATTER, np.array([2.0, 1.0]))

    real = lmfit.minimize
    monkeypatch.setattr(
        lmfit, "minimize", lambda *args, **options: real(*args, **{**options, "max_nfev": 2})
    )
    text = (
        "fit of sanchez_cuevas_free_exponent: lmfit stopped: .*number of function evaluations.*\n "
        " look at the residuals"
    )
    with pytest.raises(NotConverged, match=text):
        solve(problem, np.array([-3.0, 0.6]), quoted=True)


def test_free_air_trials_inform_L_inf_and_so_the_coefficient():
    data = campaign(5, stations=(1.14, 1.3, 1.5, 1.8, 1e4), visits=6)
    far = data.z_hat == 1e4
    air = dataclasses.replace(data, z_hat=np.where(far, np.inf, data.z_hat))
    without, given = fit(MODEL, data.take(~far), (), SCATTER), fit(MODEL, air, (), SCATTER)
    assert given.problem.data.n == without.problem.data.n + far.sum()
    assert given.excluded == ()
    assert given.estimates["K_b"].u < 0.5 * without.estimates["K_b"].u
    assert abs(given.estimates["K_b"].value - 2.0) < 3 * given.estimates["K_b"].u


def test_chi2_tells_model_error_from_noise():
    """About its degrees of freedom for the true model; far above for a wrong one, whose rmse alone
    would not say whose fault it is.
    """
    data = campaign(3, visits=8)
    right, wrong = fit(MODEL, data), fit(catalogue.model("cheeseman_bennett"), data)
    assert scipy.stats.chi2.sf(right.chi2, right.dof) > 1e-3
    assert scipy.stats.chi2.sf(wrong.chi2, wrong.dof) < 1e-12
