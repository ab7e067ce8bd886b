"""The last steps of a fit: to where the gradient vanishes, however large the misfit, and no farther
than bounds and data allow.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearlift.fit import batched

X = np.linspace(0.2, 2.0, 40)
FREE = (np.full(2, -np.inf), np.full(2, np.inf))


def curve(misfit: float):
    """a exp(-b x) fitted to what it cannot be: residuals of `misfit` times a cosine, whose
    curvature slows Gauss and Newton's steps down.
    """
    target = 3 * np.exp(-1.5 * X) + misfit * np.cos(5 * X)

    def linearised(theta, rows):
        a, b = theta[:, :1], theta[:, 1:]
        e = np.exp(-b * X)
        return target - a * e, -np.stack([e, -a * X * e], axis=1)

    return linearised


def gradient(linearised, theta):
    """In units of the sizes of what cancels in it."""
    r, slopes = linearised(theta, np.arange(len(theta)))
    target = linearised(np.zeros((1, 2)), np.arange(1))[0]
    return np.abs(slopes @ r[:, :, None])[..., 0] / (
        np.linalg.norm(slopes, axis=2) * np.linalg.norm(target)
    )


@given(st.floats(0.0, 1.5), st.floats(-1e-4, 1e-4), st.floats(-1e-4, 1e-4))
def test_the_gradient_vanishes_wherever_a_search_stopped(misfit, a, b):
    linearised = curve(misfit)
    rough = np.array([[3.0, 1.5]])
    for _ in range(60):
        r, slopes = linearised(rough, np.arange(1))
        rough = rough + 0.5 * np.linalg.lstsq(slopes[0].T, -r[0], rcond=None)[0]
    starts = rough + np.array([[0.0, 0.0], [a, b]])
    best = batched.settled(linearised, starts, FREE)
    # forty products, each known to rounding
    assert (gradient(linearised, best) < 40 * np.finfo(float).eps).all()
    assert best[0] == pytest.approx(best[1], rel=1e-11)


def test_what_stands_at_a_bound_and_would_leave_stays_and_the_rest_makes_the_best_of_it():
    linearised = curve(0.1)
    best = batched.settled(
        linearised, np.array([[2.0, 1.0]]), (np.array([-np.inf, 0.0]), np.array([np.inf, 1.0]))
    )
    e = np.exp(-X)
    target = linearised(np.zeros((1, 2)), np.arange(1))[0][0]
    assert best[0, 1] == 1.0
    # linear in what is left
    assert best[0, 0] == pytest.approx(e @ target / (e @ e), rel=1e-12)


def test_a_direction_that_the_data_do_not_determine_stays_where_it_was():
    def linearised(theta, rows):
        return 1.0 - (theta.sum(axis=1)[:, None] * X), -np.broadcast_to(X, (len(theta), 2, len(X)))

    best = batched.settled(linearised, np.array([[0.5, 0.1]]), FREE)
    assert best.sum() == pytest.approx(X.sum() / (X @ X), rel=1e-12)
    assert best[0, 0] - best[0, 1] == pytest.approx(0.4, rel=1e-12)


def test_a_problem_without_a_value_is_left_alone():
    linearised = curve(0.1)

    def broken(theta, rows):
        r, slopes = linearised(theta, rows)
        return np.where(rows[:, None] == 0, np.nan, r), slopes

    start = np.array([[3.0, 1.5], [3.0, 1.5]])
    best = batched.settled(broken, start, FREE)
    assert (best[0] == start[0]).all()
    assert (best[1] != start[1]).all()
