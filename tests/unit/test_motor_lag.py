"""A motor's lag: how a command acts behind it, and which lag a flight tells."""

from __future__ import annotations

import numpy as np
import pytest

from nearlift.reduction import motor_lag
from nearlift.reduction.motor_lag import GRID, LagMoments, estimate, filtered, moments


def test_a_command_acts_behind_its_sample() -> None:
    told = np.array([0.5, 0.5, 0.8, 0.8, 0.8])
    run = np.array([0, 0, 0, 0, 1])
    keep = np.exp(-0.2)
    np.testing.assert_allclose(
        filtered(told, run, 0.01, 0.05), [0.5, 0.5, 0.5, 0.8 - 0.3 * keep, 0.8]
    )
    np.testing.assert_allclose(filtered(told, run, 0.01, 0.0), [0.5, 0.5, 0.5, 0.8, 0.8])


def test_every_lag_is_a_first_order_system_that_each_run_begins_anew() -> None:
    """Sample by sample: x[i + 1] = keep x[i] + (1 - keep) u[i], from the first command of a run."""
    rng = np.random.default_rng(2)
    told, run = rng.uniform(0.4, 0.8, 300), np.repeat([0, 1, 2], [150, 1, 149])
    expected = np.empty((3, 300))
    for row, lag in zip(expected, (0.0, 0.03, 0.2), strict=True):
        keep = np.exp(-0.01 / lag) if lag else 0.0
        row[0] = told[0]
        for i in range(1, 300):
            follows = keep * row[i - 1] + (1 - keep) * told[i - 1]
            row[i] = follows if run[i] == run[i - 1] else told[i]
    found = filtered(told, run, 0.01, np.array([0.0, 0.03, 0.2]))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def steps(lag_s: float, power: float = 1.7) -> list[LagMoments]:
    """Flight whose commands answer nothing."""
    rng = np.random.default_rng(5)
    n, step = 12_000, 0.01
    told = np.repeat(rng.uniform(0.5, 0.7, n // 40), 40)
    run = np.zeros(n, dtype=np.int64)
    lift = filtered(told, run, step, lag_s) ** power * np.exp(0.01 * rng.normal(size=n))
    each = np.stack([filtered(told, run, step, lag) for lag in GRID])
    return moments(lift, each, [rng.normal(size=n)], np.arange(n) // 400 + 1, step)


def test_a_lag_is_found_where_nothing_feeds_back() -> None:
    """The estimate covers the truth, four standard errors wide."""
    found = estimate(steps(0.063))
    assert found is not None
    assert abs(found.value_s - 0.063) < 4 * found.u_s
    assert abs(found.power - 1.7) < 0.05
    assert not found.at_edge


def test_a_lag_beyond_every_motor_lies_at_the_edge() -> None:
    found = estimate(steps(GRID[-1] + 0.1))
    assert found is not None
    assert found.at_edge
    assert found.value_s == pytest.approx(GRID[-1])


def test_a_given_lag_is_kept_and_one_stretch_tells_none() -> None:
    stretches = steps(0.063)
    given = estimate(stretches, given_s=0.08)
    assert given is not None
    assert (given.value_s, given.u_s) == (0.08, 0.0)
    assert estimate(stretches[:1]) is None


def test_what_stands_beside_the_command_twice_tells_nothing_more() -> None:
    """A column that others span leaves lag and power as they are."""
    rng = np.random.default_rng(8)
    n, step = 6_000, 0.01
    told, beside = np.repeat(rng.uniform(0.5, 0.7, n // 40), 40), rng.normal(size=n)
    run, group = np.zeros(n, dtype=np.int64), np.arange(n) // 400 + 1
    lift = filtered(told, run, step, 0.05) ** 1.5 * np.exp(0.01 * rng.normal(size=n))
    each = np.stack([filtered(told, run, step, lag) for lag in GRID])
    once = estimate(moments(lift, each, [beside], group, step))
    twice = estimate(moments(lift, each, [beside, 2 * beside], group, step))
    assert once is not None
    assert twice is not None
    assert twice.value_s == pytest.approx(once.value_s, abs=1e-6)
    assert twice.power == pytest.approx(once.power, rel=1e-6)
    assert motor_lag.FEEDBACK_S / np.sqrt(3) < once.u_s < 2 * motor_lag.FEEDBACK_S
