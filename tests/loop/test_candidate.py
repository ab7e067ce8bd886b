"""Priors of an effect's size as the search uses them."""

import pytest

from nearlift.declare.parameter import Parameter, Prior
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
