"""Rank uniformity of posteriors over campaigns simulated from records: `make calibrate`, or pytest -m calibration.

NEARLIFT_RANKS_N campaigns of each kind (200). A right engine fails here once in a thousand for each boundary.
"""

import os

import numpy as np
import pytest
from scipy.stats import binom
from tests.calibration.ranks import MODELS, from_repeats, half, rank, true, uniformity

pytestmark = pytest.mark.calibration
N = int(os.environ.get("NEARLIFT_RANKS_N", "200"))
ALARM = 1e-3


def ranks(boundary, **how):
    found = [rank(boundary, seed, **how) for seed in range(70_000, 70_000 + N)]
    shares, inside = np.array([r.share for r in found]), sum(r.inside90 for r in found)
    told = how["noise"].__name__
    count = np.histogram(shares, 10, (0, 1))[0].tolist()
    print(f"{MODELS[boundary]}, noise {told}: p = {uniformity(shares):.3g}, 90 % held {inside} of {N}, bins {count}")
    return shares, inside


@pytest.mark.parametrize("boundary", MODELS)
@pytest.mark.parametrize("noise", [true, from_repeats])
def test_the_truth_ranks_uniformly_among_the_draws(boundary, noise):
    shares, inside = ranks(boundary, noise=noise)
    assert uniformity(shares) > ALARM
    assert binom.ppf(ALARM / 2, N, 0.9) <= inside <= binom.ppf(1 - ALARM / 2, N, 0.9)


@pytest.mark.parametrize("boundary", MODELS)
def test_a_wrong_likelihood_does_not(boundary):
    """A referee that passes a broken engine is worth nothing."""
    shares, inside = ranks(boundary, noise=half)
    assert uniformity(shares) < ALARM
    assert inside < binom.ppf(ALARM / 2, N, 0.9)
