"""Throttle collapse, on trials whose truth is written out here."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import binom
from tests.unit.simulated import campaign, sanchez_cuevas

from nearlift import catalogue
from nearlift.fit import collapse
from nearlift.fit.least_squares import fit
from nearlift.results import Noise

MODEL = catalogue.model("sanchez_cuevas")
NOISE = Noise(relative=0.004, force_N=3e-4, dof=240.0)


def ground(seed):
    return campaign(seed, height=0.0)


def at_throttle(low, high):
    """A K_b that differs between the lower and the upper throttles."""

    def ratio(z, levels):
        return np.where(levels < 0.6, sanchez_cuevas(z, low), sanchez_cuevas(z, high))

    return ratio


def uneven(seed, low, high):
    data = ground(seed)
    factor = at_throttle(low, high)(data.z_hat, data.throttle) / sanchez_cuevas(data.z_hat)
    return dataclasses.replace(data, lift_N=data.lift_N * factor)


def collapse_of(data):
    return collapse.examine(fit(MODEL, data, (), NOISE))


def test_a_collapse_is_rejected_as_often_as_stated():
    """60 campaigns at 5 %: the count lies in its 99.9 % band unless the library errs."""
    results = [collapse_of(ground(s)) for s in range(60)]
    low, high = binom.interval(0.999, 60, 0.05)
    assert low <= sum(r.test.p_value < 0.05 for r in results) <= high
    # the bound holds the truth, which is 0, over all pairs at once at 95 %: ten misses are a chance
    # of 1 in 3000
    departures = [r.largest_departure for r in results]
    assert sum(abs(d.value) > d.bound95 - abs(d.value) for d in departures) <= 9


def test_a_curve_that_depends_on_throttle_is_seen():
    found = collapse_of(uneven(1, 1.0, 3.0))
    assert found.test.p_value < 1e-4
    values = np.array([e.value for e in found.per_throttle.values()])
    assert values.mean() == pytest.approx(1)
    assert values[:2].max() < 1 < values[2:].min()
    departure = found.largest_departure
    assert departure.between[0] < 0.6 < departure.between[1]
    assert departure.bound95 > abs(departure.value) > 0.1


def test_the_scale_of_each_throttle_is_that_of_a_fit_with_scales():
    """The whitened least-squares problem with one column per throttle, written out."""
    fitted = fit(MODEL, ground(2), (), NOISE)
    problem = fitted.problem
    ratio, level = problem.log_ratio(fitted.theta), np.eye(4)[problem.data.level]
    columns = np.hstack([(level * ratio[:, None])[:, :3], problem.jacobian(fitted.theta)])
    columns[:, :3] -= (level * ratio[:, None])[:, 3:]
    white = problem.project(columns.T).T
    scales = np.linalg.lstsq(white, problem.residuals(fitted.theta), rcond=None)[0][:3]
    values = [e.value for e in collapse_of(ground(2)).per_throttle.values()]
    assert np.array(values) - 1 == pytest.approx([*scales, -scales.sum()], rel=1e-6)


@pytest.mark.parametrize("where", ["one throttle", "one distance"])
def test_what_cannot_be_compared_is_not_tested(where):
    data = ground(4)
    kept = data.throttle == 0.5 if where == "one throttle" else data.z_hat == data.z_hat.min()
    found = collapse_of(data.take(kept))
    assert (found.test, found.largest_departure, found.per_throttle) == (None, None, {})
    assert "cannot test" in found.text
