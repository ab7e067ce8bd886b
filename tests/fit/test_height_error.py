"""Height errors beyond the slope: found, linearised about, and covering where the slope does not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm
from tests.unit.simulated import campaign, hsiao

from nearlift import catalogue
from nearlift.fit import height_error
from nearlift.fit.least_squares import fit
from nearlift.likelihood.budget import Component
from nearlift.results import Noise

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


def test_an_error_of_each_distance_is_no_offset_common_to_all():
    each = fit(CEILING, near_ceiling(1), (datum(0.5e-3, scope="distance"),), SCATTER)
    assert each.problem.offset_m == 0


def test_the_fit_is_the_integral_on_a_dense_grid():
    data, standard = near_ceiling(2, off_m=0.3e-3), 0.3e-3
    found = fit(CEILING, data, (datum(standard),), SCATTER)
    e, known = found.estimates["alpha"], fit(CEILING, data, (), SCATTER, found.slope).problem
    alpha = found.theta[0] + np.linspace(-6, 6, 301) * e.u
    offset = np.linspace(0.0, standard * 3**0.5, 801)
    moved = [dataclasses.replace(known, offset_m=known.offset_m + d) for d in offset]
    log = np.array([problem.chi2(alpha[:, None]) for problem in moved]) / -2
    log += norm.logpdf(offset, scale=standard)[:, None]
    weight = np.exp(log - log.max())
    dense = weight.sum(axis=0) / weight.sum()
    mean = dense @ alpha
    assert found.theta[0] == pytest.approx(mean, abs=0.05 * e.u)
    assert e.u == pytest.approx(np.sqrt(dense @ (alpha - mean) ** 2), rel=0.03)
    along = weight.sum(axis=1) / weight.sum()
    u = height_error.u_m(found.problem, found.theta, found.slope, standard)
    assert found.problem.offset_m == pytest.approx(along @ offset, abs=0.05 * u)
    assert u == pytest.approx(np.sqrt(along @ (offset - along @ offset) ** 2), rel=0.05)


@pytest.mark.nightly
def test_the_interval_covers_where_the_slope_at_the_recorded_distance_does_not():
    """A datum of 0.5 mm under a ceiling at 2.3 mm: 60 campaigns. Of true 90 % intervals fewer than
    46 cover once in 2000.
    """
    parts, hits = (datum(0.5e-3),), {0.0: 0, None: 0}
    truth = np.random.default_rng(77).normal(0, 0.5e-3, 60)
    for seed, off in enumerate(truth):
        # the bench would have seen the rotor touch
        data = near_ceiling(1000 + seed, off_m=float(np.clip(off, -1.2e-3, None)), visits=6)
        for about in hits:
            e = fit(CEILING, data, parts, SCATTER, offset_m=about).estimates["alpha"]
            hits[about] += e.lo90 <= 0.125 <= e.hi90
    assert hits[None] >= 46
    assert hits[0.0] < 46


@pytest.mark.parametrize("off_m", [-1.2e-3, -0.5e-3, 0.3e-3, 1.2e-3])
def test_a_datum_as_large_as_the_nearest_distance_is_found(off_m):
    """2 mm stated at stations from 2.3 mm on."""
    found = fit(CEILING, near_ceiling(3, off_m=off_m, visits=6), (datum(2e-3),), SCATTER)
    u = height_error.u_m(found.problem, found.theta, found.slope, 2e-3)
    assert found.problem.offset_m == pytest.approx(off_m, abs=4 * u)
    assert found.theta[0] == pytest.approx(0.125, abs=4 * found.estimates["alpha"].u)
