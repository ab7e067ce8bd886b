"""Slow noise in batch means: the odds against white noise by matrices written out, and how often
white noise is looked at twice.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg

from nearlift.declare import FloatArray
from nearlift.reduction import slow_noise


def covariance(m: int, time: float, share: float) -> FloatArray:
    """Of Hann means that overlap by half: white noise and noise that remembers for `time`, in
    half batches; each of variance one.
    """
    white = np.eye(m) + (np.eye(m, k=1) + np.eye(m, k=-1)) / 6
    slow = scipy.linalg.toeplitz(slow_noise._exponential(m, time)[0])
    return (1 - share) * white + share * slow


def drawn(c: FloatArray, count: int, seed: int) -> FloatArray:
    return np.random.default_rng(seed).standard_normal((count, len(c))) @ np.linalg.cholesky(c).T


@pytest.mark.parametrize("degree", [slow_noise.CONSTANT, slow_noise.LINE])
def test_the_odds_are_those_of_restricted_likelihoods(degree: int) -> None:
    m = 12
    means = drawn(covariance(m, 4.0, 0.8), 1, 3)[0]
    # any basis of what a polynomial leaves
    k = scipy.linalg.null_space(np.vander(np.arange(m), degree + 1).T)
    y, dof = k.T @ means, m - degree - 1

    def restricted(time: float, share: float) -> tuple[float, float]:
        c = k.T @ covariance(m, time, share) @ k
        return y @ np.linalg.solve(c, y), np.linalg.slogdet(c)[1]

    log_odds, variance = slow_noise._weigh(means, degree)
    square0, log_det0 = restricted(1.0, 0.0)
    for i, j in np.ndindex(log_odds.shape):
        time, share = (m + 1) * slow_noise.TIMES[i], slow_noise.SHARES[j]
        square, log_det = restricted(time, share)
        expected = -0.5 * (dof * np.log(square / square0) + log_det - log_det0)
        assert log_odds[i, j] == pytest.approx(expected, rel=1e-6, abs=1e-8)
        # white noise of half batches has 4/3 of the variance of a mean, over their number
        of_mean = share * slow_noise._exponential(m, time)[1] + (1 - share) * 4 / 3 / (m + 1)
        assert variance[i, j] == pytest.approx(square / dof * of_mean, rel=1e-6)


@pytest.mark.parametrize("m", [31, 63])
def test_one_white_record_in_forty_is_looked_at_twice(m: int) -> None:
    """Of 4000, within six standard deviations; and a level and a ramp change nothing."""
    white = drawn(covariance(m, 1.0, 0.0), 4000, 1)
    first = [slow_noise.suspected(means) for means in white]
    assert abs(np.mean(first) - 1 / 40) < 6 * np.sqrt(1 / 40 / 4000)
    ramp = 3.0 + np.linspace(0.0, 5.0, m)
    assert [slow_noise.suspected(means) for means in white[:200] + ramp] == first[:200]


def test_slow_noise_is_looked_at_twice() -> None:
    slow = drawn(covariance(63, 64 * slow_noise.TYPICAL_TIME, 1.0), 400, 2)
    assert np.mean([slow_noise.suspected(means) for means in slow]) > 0.95
    assert not slow_noise.suspected(slow[0, : slow_noise.FEWEST_MEANS - 1])
