"""Central differences against derivatives written out, at bounds and of groups of entries."""

import numpy as np
import pytest

from nearlift import derivative

N = np.arange(1.0, 4.0)


def power(x):
    """sum over entries of x_i^2 n^(i + 1), (..., n)."""
    return sum(x[..., i, None] ** 2 * N ** (i + 1) for i in range(x.shape[-1]))


def test_differences_over_distances_are_the_derivative_also_for_many_points():
    x = np.array([[0.5, 2.0], [3.0, -1.0], [0.0, 1.0]])
    change, apart = derivative.central(power, x, np.maximum(np.abs(x), 1e-2))
    expected = 2 * x[..., None] * np.stack([N, N**2])
    assert change / apart[..., None] == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_a_step_ends_at_a_bound():
    change, apart = derivative.central(power, np.array([1.0]), 1.0, high=1.0)
    assert apart == pytest.approx(derivative.STEP)
    assert change[0] / apart == pytest.approx(2 * N, rel=derivative.STEP)


def test_entries_of_a_group_move_together():
    change, apart = derivative.central(power, np.ones(2), 1.0, moved=np.ones((1, 2), dtype=bool))
    assert change[0] / apart[0] == pytest.approx(2 * (N + N**2), rel=1e-7)


def test_a_relative_change():
    assert derivative.at_zero(lambda t: np.exp(3 * t) * N) == pytest.approx(3 * N, rel=1e-7)
