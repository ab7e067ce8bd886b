"""Rank uniformity of posteriors over campaigns simulated from records: `make calibrate`, or pytest
-m calibration.

NEARLIFT_RANKS_N campaigns of each kind (200). A right engine fails here once in a thousand for each
boundary.
"""

import os

import numpy as np
import pytest
from scipy.stats import binom
from tests.calibration.ranks import MODELS, from_repeats, half, rank, true, uniformity

from nearlift.run.workers import ordered

pytestmark = pytest.mark.calibration
N = int(os.environ.get("NEARLIFT_RANKS_N", "200"))
ALARM = 1e-3


def ranks(executor, boundary, noise):
    found = list(
        ordered(executor, rank, [(boundary, seed, noise) for seed in range(70_000, 70_000 + N)])
    )
    shares, inside = np.array([r.share for r in found]), sum(r.inside90 for r in found)
    count = np.histogram(shares, 10, (0, 1))[0].tolist()
    print(
        f"{MODELS[boundary]}, noise {noise.__name__}: p = {uniformity(shares):.3g}, 90 % held"
        f" {inside} of {N}, bins {count}"
    )
    return shares, inside


@pytest.mark.parametrize("boundary", MODELS)
@pytest.mark.parametrize("noise", [true, from_repeats])
def test_the_truth_ranks_uniformly_among_the_draws(executor, boundary, noise):
    shares, inside = ranks(executor, boundary, noise)
    assert uniformity(shares) > ALARM
    assert binom.ppf(ALARM / 2, N, 0.9) <= inside <= binom.ppf(1 - ALARM / 2, N, 0.9)


@pytest.mark.parametrize("boundary", MODELS)
def test_a_wrong_likelihood_does_not(executor, boundary):
    """A referee that passes a broken engine is worth nothing."""
    shares, inside = ranks(executor, boundary, half)
    assert uniformity(shares) < ALARM
    assert inside < binom.ppf(ALARM / 2, N, 0.9)
