"""Height errors beyond the slope: judged, integrated over, and covering where the slope
does not.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm

from nearlift import catalogue
from nearlift.fit import heights
from nearlift.fit.least_squares import fit
from nearlift.fit.linearised import stand_in
from nearlift.likelihood.budget import Component
from nearlift.results import Noise

from .simulated import RADIUS, campaign, hsiao

CEILING = catalogue.model("hsiao_chirarattananon")
NEAR = (0.1, 0.15, 0.2, 0.3, 0.5, 0.9, 2.0, 10.0)
SCATTER = Noise(relative=0.004, force_N=3e-4, height_m=5e-5)


def datum(standard, distribution="normal", scope="boundary"):
    return Component(
        name="datum", on="height", standard=standard, distribution=distribution, scope=scope
    )


def near_ceiling(seed, *, off_m=0.0, visits=4, height=5e-5):
    return campaign(
        seed,
        boundary="ceiling",
        ratio=hsiao,
        stations=NEAR,
        visits=visits,
        height=height,
        datum=off_m,
    )


def test_the_slope_carries_a_small_datum_and_not_a_large_one():
    data = near_ceiling(1)
    shifts = []
    for standard in (0.02e-3, 0.1e-3, 0.5e-3):
        found = fit(CEILING, data, (datum(standard),), SCATTER)
        (datums,) = [m for m in found.plan.assessments if m.component == "datum"]
        shifts.append(datums.shift)
        assert (
            (datums.treatment == "exact")
            == (datums.shift > heights.LIMIT)
            == (found.marginal is not None)
        )
    assert shifts[0] < 0.01
    assert shifts[2] > 0.5
    # far from the ground the curve is straight enough
    assert (
        fit(catalogue.model("sanchez_cuevas"), campaign(1), (datum(0.2e-3),), SCATTER).marginal
        is None
    )


def test_second_order_over_first_is_the_curves_own():
    """At one station only the ratio of the even to the odd part is the curve's: (f(z+s) + f(z-s) -
    2 f(z)) / (f(z+s) - f(z-s)).
    """
    data = near_ceiling(1)
    found = fit(CEILING, data, (datum(2e-5),), SCATTER)
    even = heights._even(found.problem, found.theta, 2e-5)
    z, s = data.z_hat, 2e-5 / RADIUS
    expected = (
        np.log(hsiao(z + s, found.theta[0])) + np.log(hsiao(z - s, found.theta[0]))
    ) / 2 - np.log(hsiao(z, found.theta[0]))
    assert even == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("distribution", ["normal", "uniform"])
def test_the_integral_is_that_of_a_dense_grid(distribution):
    data, standard = near_ceiling(2, off_m=0.3e-3), 0.3e-3
    found = fit(CEILING, data, (datum(standard, distribution),), SCATTER)
    assert found.marginal is not None
    alpha = found.theta[0] + np.linspace(-6, 6, 301) * found.estimates["alpha"].u
    offset = np.linspace(0.0, standard * 3**0.5 * (1 - 1e-9), 801)
    log = (
        np.array([found.problem.chi2(alpha[:, None], np.full((len(alpha), 1), d)) for d in offset])
        / -2
    )
    if distribution == "normal":
        log += norm.logpdf(offset, scale=standard)[:, None]
    weight = np.exp(log - log.max())
    own = weight.sum(axis=0) / weight.sum()
    mean = own @ alpha
    assert found.theta[0] == pytest.approx(mean, abs=0.02 * found.estimates["alpha"].u)
    assert found.estimates["alpha"].u == pytest.approx(np.sqrt(own @ (alpha - mean) ** 2), rel=0.02)
    assert [found.estimates["alpha"].lo90, found.estimates["alpha"].hi90] == pytest.approx(
        [np.interp(p, np.cumsum(own), alpha) for p in (0.05, 0.95)],
        abs=0.05 * found.estimates["alpha"].u,
    )
    along = weight.sum(axis=1) / weight.sum()
    value, u = found.marginal.offset()
    assert value == pytest.approx(along @ offset, rel=0.01)
    assert u == pytest.approx(np.sqrt(along @ (offset - along @ offset) ** 2), rel=0.05)


def test_where_the_slope_suffices_both_ways_agree():
    data = near_ceiling(3)
    parts = (datum(2e-5),)
    slope = fit(CEILING, data, parts, SCATTER, plan=heights.HeightPlan())
    exact = fit(CEILING, data, parts, SCATTER, plan=heights.HeightPlan(shared=parts))
    assert exact.theta == pytest.approx(slope.theta, abs=0.02 * slope.estimates["alpha"].u)
    assert exact.estimates["alpha"].u == pytest.approx(slope.estimates["alpha"].u, rel=0.02)
    assert exact.log_likelihood == pytest.approx(slope.log_likelihood, abs=0.15)
    assert exact.chi2 == pytest.approx(slope.chi2, abs=0.05)
    for throttle, level in slope.levels.items():
        assert exact.levels[throttle].value == pytest.approx(level.value, rel=1e-4)
        assert exact.levels[throttle].u == pytest.approx(level.u, rel=0.02)


def test_the_exact_interval_covers_where_the_slope_does_not():
    """A datum of 0.5 mm under a ceiling at 2.3 mm: 60 campaigns. Of true 90 % intervals fewer than
    46 cover once in 2000.
    """
    parts, hits = (datum(0.5e-3),), {"slope": 0, "exact": 0}
    truth = np.random.default_rng(77).normal(0, 0.5e-3, 60)
    for seed, off in enumerate(truth):
        # the bench would have seen the rotor touch
        data = near_ceiling(1000 + seed, off_m=float(np.clip(off, -1.2e-3, None)), visits=6)
        first = fit(CEILING, data, parts, SCATTER, plan=heights.HeightPlan())
        for name, found in (
            ("slope", first),
            (
                "exact",
                fit(CEILING, data, parts, SCATTER, first.slope, heights.HeightPlan(shared=parts)),
            ),
        ):
            e = found.estimates["alpha"]
            hits[name] += e.lo90 <= 0.125 <= e.hi90
    assert hits["exact"] >= 46
    assert hits["slope"] < 46


def test_the_mean_over_stops_undoes_their_bias():
    """Heights of each stop off by 0.3 mm at 2.3 mm: so many that stations show their mean. The
    slope's alpha is off as it states.
    """
    scatter = dataclasses.replace(SCATTER, height_m=0.3e-3)
    data = near_ceiling(5, visits=20)
    nodes, weights = np.polynomial.hermite_e.hermegauss(15)
    mean = sum(
        w * np.log(hsiao(data.z_hat + x * 0.3e-3 / RADIUS))
        for x, w in zip(nodes, weights / weights.sum(), strict=True)
    )
    data = dataclasses.replace(data, lift_N=0.1 * np.exp(mean))
    slope, averaged = (
        fit(CEILING, data, (), scatter, plan=plan) for plan in (heights.HeightPlan(), None)
    )
    (measure,) = averaged.plan.assessments
    assert (measure.treatment, averaged.problem.blur_m) == ("mean", pytest.approx(0.3e-3))
    assert (slope.theta[0] - 0.125) / slope.estimates["alpha"].u == pytest.approx(
        measure.shift, rel=0.1
    )
    assert abs(averaged.theta[0] - 0.125) < 0.05 * abs(slope.theta[0] - 0.125)


def test_a_scatter_of_heights_that_nobody_knows_is_not_corrected_for():
    scatter = dataclasses.replace(
        SCATTER, height_m=0.3e-3, sizes=("height_m",), log_covariance=((1.0,),)
    )
    found = fit(CEILING, near_ceiling(5, visits=40, height=0.3e-3), (), scatter)
    assert found.problem.blur_m == 0
    assert found.plan.assessments[0].shift > heights.LIMIT
    assert found.plan.assessments[0].treatment == "slope"


@pytest.mark.parametrize(
    "parts",
    [
        (datum(2e-4),),
        (datum(2e-4, "uniform"),),
        (datum(2e-4), datum(3e-4)),
        (datum(2e-4), datum(3e-4, "uniform")),
        (datum(1e-4, "uniform"), datum(3e-4, "uniform")),
    ],
)
def test_the_density_is_that_of_the_sum(parts):
    of, reach = heights.density(parts)
    x = np.linspace(-reach, reach, 20001)
    p = of(x) * (x[1] - x[0])
    assert p.sum() == pytest.approx(1, rel=1e-3)
    assert p @ x**2 == pytest.approx(sum(c.standard**2 for c in parts), rel=1e-2)


def test_a_model_without_coefficients_integrates_too():
    data = campaign(
        1, boundary="sidewall", ratio=lambda z: np.ones_like(z), stations=(0.1, 0.3, 0.6, 2.0)
    )
    found = fit(
        catalogue.model("sidewall_none"),
        data,
        (datum(1e-3),),
        SCATTER,
        plan=heights.HeightPlan(shared=(datum(1e-3),)),
    )
    assert found.theta.shape == (0,)
    assert found.marginal is not None


def test_samplers_may_take_the_slope_about_the_height_found():
    """Same optimum and width as the integral, in the coefficients alone."""
    data = near_ceiling(2, off_m=0.3e-3)
    found = fit(CEILING, data, (datum(0.3e-3),), SCATTER)
    problem = stand_in(found)
    e = found.estimates["alpha"]
    alpha = e.value + np.linspace(-3, 3, 61) * e.u
    rise = problem.chi2(alpha[:, None])
    best = alpha[np.argmin(rise)]
    assert best == pytest.approx(e.value, abs=0.15 * e.u)
    assert np.sqrt(1 / np.polyfit(alpha, rise, 2)[0]) == pytest.approx(e.u, rel=0.05)
    assert stand_in(fit(CEILING, data, (datum(1e-5),), SCATTER)).shift == 0.0
