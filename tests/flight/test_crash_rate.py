"""Crash rates, levels, refinement and the test of the time step."""

from __future__ import annotations

import math

import numpy as np
import pytest

from nearlift.errors import UsageError
from nearlift.flight import crash_rate, paper
from nearlift.flight.crash_rate import halved_step, sweep
from nearlift.flight.simulation import tabulate

KEY = 20210401
NO_BOUNDARY = tabulate([np.ones_like], 0.5)


def level(preset, boundary, exponent, risk, around, flights):
    """Level of the paper's model to a power, flown about where it is expected."""
    targets = np.round(np.arange(around - 0.3, around + 0.31, 0.1), 10)
    how = paper.simulation(preset, boundary, flights, KEY)
    rate = (how.ended(paper.scaled_curves(boundary, (exponent,)), targets) >= 0).mean(axis=1)
    return crash_rate.level(targets, rate, risk, 0.5 / flights)


#: Boundary, power (0: no model), and the levels of 50 % and 1 % by an independent simulation of the
#: paper's scheme.
REPRODUCED = [
    ("ground", 0.0, 1.15, 1.55),
    ("ground", 0.6, 0.80, 1.10),
    ("ground", 0.8, 0.80, 1.08),
    ("ground", 1.0, 0.82, 1.08),
    ("ground", 1.2, 0.84, 1.07),
    ("ground", 1.4, 0.86, 1.07),
    ("ceiling", 0.0, 1.17, None),
    ("ceiling", 0.6, 1.74, 2.09),
    ("ceiling", 0.8, 1.90, 2.25),
    ("ceiling", 1.0, 2.03, 2.39),
    ("ceiling", 1.2, 2.11, 2.50),
    ("ceiling", 1.4, 2.17, 2.59),
]


@pytest.mark.parametrize("flights", [400, pytest.param(10_000, marks=pytest.mark.calibration)])
@pytest.mark.parametrize(("boundary", "exponent", "half", "rare"), REPRODUCED)
def test_the_paper_s_curves(boundary, exponent, half, rare, flights):
    """50 % levels within 0.05: of 400 flights their standard deviation is below 0.012, so a true
    one deviates by 4 of them. 1 % levels, of 10 000 flights, within 0.1.
    """
    levels = {0.5: (half, 0.05)} | ({0.01: (rare, 0.1)} if flights > 400 and rare else {})
    for risk, (expected, within) in levels.items():
        at = level("paper", boundary, exponent, risk, expected, flights)
        assert at == pytest.approx(expected, abs=within)


@pytest.mark.parametrize(
    ("boundary", "exponent", "half"),
    [("ground", 0.0, 0.91), ("ground", 1.0, 0.53), ("ceiling", 1.0, 1.87)],
)
def test_a_converged_step_moves_the_levels_down(boundary, exponent, half):
    """Levels at steps of 0.02 s and less: 0.92, 0.55, 1.88. 200 flights: +-0.04."""
    assert level("converged", boundary, exponent, 0.5, half, 200) == pytest.approx(half, abs=0.06)


def test_every_run_tests_its_own_step():
    targets = np.array([0.8, 1.0, 1.2])
    good, bad = (
        sweep(paper.simulation(name, "ground", 120, KEY), NO_BOUNDARY, targets)[1]
        for name in ("converged", "paper")
    )
    assert good.converged
    assert not bad.converged
    assert bad.worst > 0.2
    assert (good.step_s, bad.step_s) == (0.05, 0.1)


def test_one_flight_among_few_makes_no_step_too_long():
    """49 of 50 and 50 of 50 lie outside of the first's interval, not of the second's."""
    how, at, curve = (
        paper.simulation("converged", "ground", 50, KEY),
        np.array([0.2]),
        np.array([0]),
    )
    coarse = np.ones((1, 50), dtype=bool)
    coarse[0, 0] = False
    assert halved_step(how, NO_BOUNDARY, at, curve, 0.0, coarse).converged
    coarse[0, :20] = False
    assert not halved_step(how, NO_BOUNDARY, at, curve, 0.0, coarse).converged


def test_a_level_is_read_across_no_gap_wider_than_half_its_interval():
    """The bounded push makes all crash at 0.5 and none at 0.6, and three set-points would read the
    level in the middle of their gap.
    """
    curves, coarse = paper.scaled_curves("ground", (1.0,)), np.array([0.4, 0.6, 0.8])
    how = paper.simulation("converged", "ground", 200, KEY)
    flown, _ = sweep(how, curves, coarse, risks=(0.5,))
    weights = crash_rate.resamples(200, np.random.default_rng(1))
    values = crash_rate.levels(flown.target_z_hat, flown.crashed[0], 0.5, weights)
    low, high = crash_rate.spread90(values)
    around = np.searchsorted(flown.target_z_hat, values[0])
    gap = flown.target_z_hat[around] - flown.target_z_hat[around - 1]
    assert gap <= max(crash_rate.FINEST_GAP_Z_HAT, 0.6 * (high - low))
    fine = np.round(np.arange(0.49, 0.54, 0.002), 6)
    dense = (how.ended(curves, fine) >= 0).mean(axis=1)
    assert values[0] == pytest.approx(crash_rate.level(fine, dense, 0.5, 0.0025), abs=0.003)
    assert {0.4, 0.6, 0.8} <= set(flown.target_z_hat)
    assert np.array_equal(sweep(how, curves, coarse)[0].target_z_hat, coarse)


def test_intervals_of_rates_cover():
    """90 % intervals over every true rate drawn: between 86 and 94 % of 2000 (a sd of 0.7 %)."""
    rng = np.random.default_rng(1)
    p = rng.uniform(0.02, 0.98, 2000)
    low, high = crash_rate.binomial90(rng.binomial(200, p), 200)
    assert 0.86 < ((low <= p) & (p <= high)).mean() < 0.94
    low, high = crash_rate.binomial90(np.array([0, 200]), 200)
    assert (low[0], high[1]) == (0.0, 1.0)
    assert high[0] < 0.02


def test_levels():
    z_hat, rate = np.array([1.0, 1.1, 1.2, 1.3]), np.array([0.9, 0.5, 0.05, 0.0])
    assert crash_rate.level(z_hat, rate, 0.5, 1e-3) == pytest.approx(1.0 + 0.1 * 1.0)
    assert 1.1 < crash_rate.level(z_hat, rate, 0.1, 1e-3) < 1.2
    # between a set-point where all crash and one where none does, half do in the middle
    assert crash_rate.level(z_hat, np.array([1.0, 1.0, 0.0, 0.0]), 0.5, 1e-3) == pytest.approx(1.15)
    assert math.isnan(crash_rate.level(z_hat, rate + 0.3, 0.1, 1e-3))
    rows = np.stack([rate, rate + 0.3, np.zeros(4)])
    assert np.array_equal(
        crash_rate.level(z_hat, rows, 0.1, 1e-3),
        [float(crash_rate.level(z_hat, row, 0.1, 1e-3)) for row in rows],
        equal_nan=True,
    )
    assert crash_rate.level(z_hat, np.zeros(4), 0.1, 1e-3) == 1.0
    with pytest.raises(UsageError, match=r"0.01 is not detectable in 100 flights\n.*300"):
        crash_rate.refuse_few(0.01, 100)
    low, high = crash_rate.spread90(np.array([1.0] * 19 + [math.nan]))
    assert low == 1.0
    assert math.isnan(high)
