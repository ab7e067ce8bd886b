"""Priors of an effect's size as the search uses them, and the slope of a curve with an effect."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.simulated import campaign, problem

from nearlift import catalogue
from nearlift.declare.parameter import Parameter, Prior
from nearlift.likelihood.problem import height_slope
from nearlift.loop.candidate import moments


@pytest.mark.parametrize(
    "prior",
    [
        Prior(distribution="norm", loc=0.2, scale=0.5),
        Prior(distribution="uniform", loc=-1.0, scale=3.0),
        Prior(distribution="beta", loc=1.0, scale=2.0, shape=(2.0, 5.0)),
    ],
    ids=lambda prior: prior.distribution,
)
def test_moments_are_mean_and_standard_deviation(prior):
    size = Parameter(
        name="size", unit="1", value=0.0, bounds=(-9.0, 9.0), prior=prior, meaning="a size"
    )
    truth = prior.frozen()
    assert moments(size) == pytest.approx((truth.mean(), truth.std()))


def test_the_slope_is_that_of_the_curve_about_which_the_noise_was_estimated():
    """Near its pole the base model is far steeper than the curve that an effect has flattened."""
    bare = problem(campaign(5))
    assert np.array_equal(
        bare.slope, height_slope(bare.base, bare.data, bare.base.named(bare.theta))
    )
    candidate = bare.candidate(catalogue.effect("near_wall_saturation"))
    vector = np.array([1.01 * bare.theta[0], 3.0, 0.8])
    about = replace(bare, about=(candidate, vector), theta=vector[:1])
    data, step = bare.data, 1e-7

    def log_ratio(moved_m):
        return candidate.log_ratio(
            vector, replace(data, z_hat=data.z_hat + moved_m / data.radius_m)
        )

    expected = (log_ratio(step) - log_ratio(-step)) / (2 * step)
    near = np.isfinite(data.z_hat)
    assert about.slope[near] == pytest.approx(expected[near], rel=1e-5, abs=1e-6)
    nearest = data.z_hat == data.z_hat.min()
    steeper = height_slope(bare.base, data, bare.base.named(vector[:1]))
    assert np.all(np.abs(about.slope[nearest]) < 0.8 * np.abs(steeper[nearest]))
    assert np.array_equal(about.height_slope(data.take(nearest)), about.slope[nearest])
