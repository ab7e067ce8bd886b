"""The covariance's three layers against the dense matrix that they stand for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearlift.likelihood.covariance import Covariance


def example(seed, n=23, shared=2, height=1.0):
    rng = np.random.default_rng(seed)
    return Covariance(
        variance=rng.uniform(0.1, 2.0, n),
        visit=rng.integers(0, 6, n),
        per_visit=height * rng.normal(size=n),
        shared=rng.normal(size=(n, shared)),
        common=0.7,
    )


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), shared=st.integers(0, 4), height=st.sampled_from([0.0, 1.0]))
def test_whitening_makes_the_dense_covariance_the_identity(seed, shared, height):
    c = example(seed, shared=shared, height=height)
    w = c.whiten(np.eye(23)).T  # columns are W e_i
    assert w @ c.dense() @ w.T == pytest.approx(np.eye(23), abs=1e-9)


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), shared=st.integers(0, 4))
def test_log_determinant_is_that_of_the_dense_covariance(seed, shared):
    c = example(seed, shared=shared)
    assert c.log_det == pytest.approx(np.linalg.slogdet(c.dense())[1])


def test_whitening_broadcasts_over_leading_axes():
    c = example(1)
    x = np.random.default_rng(2).normal(size=(3, 5, 23))
    assert c.whiten(x)[1, 2] == pytest.approx(c.whiten(x[1, 2]))
