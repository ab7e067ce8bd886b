"""The sequential test of the lift ratio: false alarms per hour and delay as stated, on simulated
readings.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from nearlift.flight.proximity.sequential import run_length, sequential_test

SIGMA, EVERY_S = 0.02, 0.02


def alarm_at(readings, change, sigma, threshold):
    """Number of the reading at which the cumulative sum raises the alarm, from 0; -1: never."""
    total = 0.0
    for i, x in enumerate(readings.tolist()):
        total = max(0.0, total + x - 0.5 * change)
        if total > threshold * sigma:
            return i
    return -1


def test_delay_and_false_alarms_are_those_stated():
    """400 runs each: the mean of an exponential time to within 5 % (a standard deviation), and
    Siegmund's formula is good to some 3 %; 20 % is 3 of them.
    """
    threshold, delay_s = sequential_test(0.02, SIGMA, 0.0, EVERY_S, 200.0)
    rng = np.random.default_rng(3)

    def mean_time(mean, length):
        ends = [
            alarm_at(mean + SIGMA * rng.standard_normal(length), 0.02, SIGMA, threshold)
            for _ in range(400)
        ]
        assert min(ends) >= 0
        return EVERY_S * (1 + np.mean(ends))

    assert mean_time(0.02, 2000) == pytest.approx(delay_s, rel=0.2)
    assert 3600 / mean_time(0.0, 15_000) == pytest.approx(200.0, rel=0.2)


def test_an_offset_at_its_worse_end_keeps_both_promises():
    """What averaging leaves, at its 95 % end towards the alarm where there is no boundary, away
    from it where there is one.
    """
    u, change = 0.003, 0.03
    threshold, delay_s = sequential_test(change, SIGMA, u, EVERY_S, 200.0)
    rng = np.random.default_rng(4)
    for mean, expected in (
        (1.645 * u, 18.0),
        (change - 1.645 * u, delay_s),
    ):
        ends = [
            alarm_at(mean + SIGMA * rng.standard_normal(15_000), change, SIGMA, threshold)
            for _ in range(300)
        ]
        assert min(ends) >= 0
        assert EVERY_S * (1 + np.mean(ends)) == pytest.approx(expected, rel=0.2)


def test_what_averaging_leaves_hides_small_changes_and_slows_the_rest():
    clean, worse = (sequential_test(0.03, SIGMA, u, EVERY_S, 1.0) for u in (0.0, 0.005))
    assert clean[1] < worse[1] < math.inf
    assert sequential_test(0.03, SIGMA, 0.01, EVERY_S, 1.0) == (math.inf, math.inf)
    # a loss of lift is noticed as a gain is, and rarer alarms take longer
    assert sequential_test(-0.03, SIGMA, 0.0, EVERY_S, 1.0) == clean
    assert sequential_test(0.03, SIGMA, 0.0, EVERY_S, 0.01)[1] > clean[1]


def test_run_lengths():
    """Without drift b^2 readings; steep drifts h / m nearly; far below zero never."""
    assert run_length(0.0, 3.0) == pytest.approx((3 + 1.166) ** 2)
    assert run_length(1e-5, 3.0) == pytest.approx(run_length(0.0, 3.0), rel=1e-3)
    assert run_length(5.0, 40.0) == pytest.approx(8.2, abs=0.1)
    assert run_length(-40.0, 10.0) == math.inf
