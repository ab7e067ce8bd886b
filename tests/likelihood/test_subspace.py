"""Bases of columns where a factorisation of them fails."""

import numpy as np
import pytest

from nearlift.likelihood.subspace import left_singular


def test_singular_vectors_are_found_where_divide_and_conquer_fails(monkeypatch):
    columns = np.random.default_rng(1).standard_normal((40, 6)) @ np.diag([9, 5, 3, 1, 1e-3, 0])
    u, length = left_singular(columns)

    def fails(*_, **__):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr(np.linalg, "svd", fails)
    again, same = left_singular(columns)
    assert same == pytest.approx(length, abs=1e-12)
    assert np.abs(np.sum(u * again, axis=0))[:5] == pytest.approx(1)
