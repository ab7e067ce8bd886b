"""Intervals under shared errors cover as often as stated, and a likelihood that leaves out what is
shared is rejected.
"""

import os

import numpy as np
import pandas as pd
import pytest
from tests.calibration import coverage, forms
from tests.calibration.simulator import simulate

#: All shares together are rejected by chance in 5 % of runs at most.
CHANCE = 1 - 0.05 / 36


def seeds(variable, count):
    """So many reported seeds, unless the environment says otherwise."""
    first = coverage.REPORTED
    return range(first, first + int(os.environ.get(variable, count)))


def test_a_few_campaigns_under_shared_errors(executor):
    """Three campaigns of each kind, pooled: the 99.9 % bands catch intervals that are too narrow by
    half.
    """
    rows = coverage.run(executor, range(1, 4), coverage.DATUMS)
    headline = rows[rows["name"] == rows["boundary"].map(forms.HEADLINE)]
    ours = headline[headline["way"] == "nearlift"]
    assert len(ours) == 18
    for level in coverage.LEVELS:
        low, high = coverage.band(18, level, 0.999)
        assert low <= coverage.holds(ours, level).sum() <= high, level
    # near a ceiling a datum is worst: of six honest intervals of 90 % two or fewer hold the truth
    # once in 800 runs
    ceiling = headline[headline["boundary"] == "ceiling"]
    for way in ("ignored", "lmfit"):
        assert coverage.holds(ceiling[ceiling["way"] == way], 90).sum() <= 2


@pytest.mark.parametrize("boundary", forms.BOUNDARIES)
def test_a_gain_per_throttle_moves_no_coefficient(boundary):
    with_gain, without = (
        simulate(coverage.spec(boundary, "0.2 mm", throttle=present), 5).data
        for present in (True, False)
    )
    assert np.abs(np.log(with_gain.lift_N / without.lift_N)).max() > 1e-3
    each = [
        coverage.answers(data, coverage.components(0.2, stated))["nearlift"]
        for data, stated in ((with_gain, True), (with_gain, False), (without, False))
    ]
    for name in forms.COEFFICIENTS[boundary]:
        u = each[0][name]["u"]
        assert np.ptp([e[name]["value"] for e in each]) < 0.05 * u
        assert np.ptp([e[name]["u"] for e in each]) < 0.02 * u


def test_what_is_injected_is_what_is_stated():
    shared = coverage.spec("ground", "0.5 mm").shared
    stated = {c.name: c for c in coverage.components(0.5)}
    for name, size in {
        "boundary height": shared.datum_m,
        "session gain": shared.session_gain,
        "throttle gain": shared.throttle_gain,
    }.items():
        assert stated[name].standard == pytest.approx(size)
    cell = stated["load cell linearity"]
    assert cell.range_N == pytest.approx(9.80665)
    assert cell.standard * np.sqrt(3) == pytest.approx(shared.cell_N, rel=1e-3)


def test_pooled_shares_are_judged_too():
    """A share that one design's band just admits is outside the band of both together."""
    truth = np.repeat([0.0, 1.5, 2.5, 9.0], [58, 32, 5, 5])
    one = pd.DataFrame({"boundary": "ground", "name": "K_b", "truth": truth, "way": "nearlift"})
    for level, half in zip(coverage.LEVELS, (1.0, 2.0, 3.0), strict=True):
        one[f"lo{level}"], one[f"hi{level}"] = -half, half
    assert coverage.band(100, 68, 0.99)[0] <= 58
    rows = pd.concat([one.assign(design=d) for d in coverage.DATUMS])
    with pytest.raises(AssertionError, match="116 of 200 intervals of 68 %"):
        coverage.check(rows, "nearlift", 0.99)


@pytest.mark.calibration
def test_intervals_cover_with_few_visits(executor):
    """NEARLIFT_FEW_N (60) campaigns of each design; taken as independent, the same trials fail."""
    rows = coverage.run(executor, seeds("NEARLIFT_FEW_N", "60"), coverage.FEW)
    coverage.check(rows, "nearlift", 1 - 0.05 / 48, narrow_only=True)
    with pytest.raises(AssertionError, match="intervals of"):
        coverage.check(rows, "ignored", 1 - 0.05 / 48, narrow_only=True)


@pytest.mark.calibration
def test_intervals_cover_under_shared_errors(executor):
    """NEARLIFT_COVERAGE_N (250) campaigns of each boundary and datum; wrong likelihoods fail."""
    rows = coverage.run(executor, seeds("NEARLIFT_COVERAGE_N", "250"), coverage.DATUMS)
    coverage.check(rows, "nearlift", CHANCE)
    for boundary in forms.BOUNDARIES:
        for way in ("ignored", "lmfit"):
            with pytest.raises(AssertionError, match="intervals of"):
                coverage.check(rows[rows["boundary"] == boundary], way, CHANCE)
