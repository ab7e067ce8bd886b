"""The covariance's three layers against the dense matrix of their sum."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nearlift.likelihood import covariance
from nearlift.likelihood.covariance import Covariance


def example(seed, n=23, shared=2, height=1.0, drifts=0):
    rng = np.random.default_rng(seed)
    visit = rng.integers(0, 6, n)
    return Covariance(
        variance=rng.uniform(0.1, 2.0, n),
        # along a drift visits follow each other
        visit=np.sort(visit) if drifts else visit,
        per_visit=height * rng.normal(size=n),
        shared=rng.normal(size=(n, shared)),
        common=0.7,
        drift=rng.uniform(0.5, 1.0, drifts),
        age=np.sort(rng.uniform(0, 5, (n, drifts)), axis=0),
    )


@settings(max_examples=25)
@given(
    seed=st.integers(0, 10_000),
    shared=st.integers(0, 4),
    height=st.sampled_from([0.0, 1.0]),
    drifts=st.integers(0, 2),
)
def test_whitening_makes_the_dense_covariance_the_identity(seed, shared, height, drifts):
    c = example(seed, shared=shared, height=height, drifts=drifts)
    w = c.whiten(np.eye(23)).T  # columns are W e_i
    assert w @ c.dense() @ w.T == pytest.approx(np.eye(23), abs=1e-9)
    assert c.unwhiten(np.eye(23)) == pytest.approx(w, abs=1e-12)
    assert c.log_det == pytest.approx(np.linalg.slogdet(c.dense())[1])


def test_blocks_of_visits_and_the_recursion_whiten_alike(monkeypatch):
    c, x = example(3), np.random.default_rng(2).normal(size=(4, 23))
    assert c._sparse is not None
    monkeypatch.setattr(covariance, "MAX_BLOCK", 0)
    recursion = example(3)
    assert recursion._sparse is None
    assert c.whiten(x) == pytest.approx(recursion.whiten(x), rel=1e-12, abs=1e-12)
    assert c.log_det == pytest.approx(recursion.log_det, rel=1e-12)
