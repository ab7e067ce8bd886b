"""Outlying trials are distinguished from noise, from its tails, and from undeclared effects."""

from __future__ import annotations

import numpy as np
import pytest

from nearlift.reduction.outliers import LEAST_TRIALS, odd_visits, screen

THROTTLES = np.array([0.25, 0.5, 0.75, 0.92])


def bench(seed, stations=11, visits=4, throttles=THROTTLES, noise="normal", size=0.005):
    """Log lift of a traverse, whose visits have 1 % in common."""
    rng = np.random.default_rng(seed)
    z = np.repeat(
        rng.permutation(np.repeat(np.linspace(1.1, 12.0, stations), visits)), len(throttles)
    )
    throttle = np.tile(throttles, stations * visits)
    visit = np.repeat(np.arange(stations * visits), len(throttles))
    n = len(z)
    drawn = {"normal": rng.standard_normal, "t6": lambda n: rng.standard_t(6, n)}[noise](n)
    return (
        1.4 * np.log(throttle)
        + 0.3 / z
        + 0.01 * rng.standard_normal(visit.max() + 1)[visit]
        + size * drawn,
        z,
        throttle,
        visit,
    )


@pytest.mark.parametrize("noise", ["normal", "t6"])
def test_noise_is_no_outlier(noise):
    """60 campaigns of 176 trials: 0.6 alarms are expected at most; four or more have a chance of
    0.3 %.
    """
    assert sum(screen(*bench(seed, noise=noise)).outlying.any() for seed in range(60)) < 4


@pytest.mark.parametrize("factor", [10.0, 0.5, 1.15])
@pytest.mark.parametrize("trial", [0, 77, 175])
def test_a_trial_that_lifts_otherwise_is_named_and_no_other(factor, trial):
    log_lift, *places = bench(5)
    log_lift[trial] += np.log(factor)
    found = screen(log_lift, *places)
    assert np.flatnonzero(found.outlying).tolist() == [trial]
    assert found.departure[trial] == pytest.approx(np.log(factor), abs=0.03)


def test_two_trials_that_changed_labels_or_distances_are_named_and_their_visit_mates_are_not():
    log_lift, z, throttle, visit = bench(5)
    swapped = log_lift.copy()
    swapped[[40, 42]] = swapped[[42, 40]]
    assert np.flatnonzero(screen(swapped, z, throttle, visit).outlying).tolist() == [40, 42]
    # each is now in a visit of its own
    a = int(np.argmin(z))
    b = int(np.flatnonzero((z > z[a] + 3) & (throttle == throttle[a]))[0])
    z[[a, b]] = z[[b, a]]
    visit = np.cumsum(np.diff(z, prepend=z[0]) != 0)
    assert np.flatnonzero(screen(log_lift, z, throttle, visit).outlying).tolist() == sorted([a, b])


@pytest.mark.parametrize("repeats", [1, 2, 4])
def test_few_repeats_and_three_throttles_do_not_pass_the_blame_on(repeats):
    """With two visit mates a median is their mean: an outlier among them moves its innocent
    neighbours' as far as half of it.
    """
    log_lift, *places = bench(5, stations=16, visits=repeats, throttles=THROTTLES[:3])
    log_lift[20] += 1.0
    assert np.flatnonzero(screen(log_lift, *places).outlying).tolist() == [20]


def test_what_an_undeclared_effect_does_is_no_outlier():
    for seed in range(20):
        log_lift, z, throttle, visit = bench(seed)
        run, rng = np.arange(len(z)) / len(z), np.random.default_rng(seed)
        for effect in (
            -0.1 * (3 * run % 1) * throttle,  # supply sag
            0.05 * rng.standard_normal(4)[(4 * run).astype(int)],  # session gain
            np.where(z < 2, 0.3, 0.0),  # near wall
            np.where(z < 3, 0.2 * (throttle - 0.5), 0.0),  # throttle by distance
            0.1 * rng.standard_normal(visit.max() + 1)[visit] / z**2,  # height of visits
        ):
            assert not screen(log_lift + effect, z, throttle, visit).outlying.any()


def test_one_throttle_without_repeats_waits_for_a_curve():
    log_lift, z, throttle, visit = bench(5, stations=60, visits=1, throttles=THROTTLES[:1])
    assert "0 trials have repeats" in screen(log_lift, z, throttle, visit).why_not
    left = log_lift - 0.3 / z
    left[30] += 0.5
    found = screen(left, z, throttle, visit, curve_removed=True)
    assert np.flatnonzero(found.outlying).tolist() == [30]
    assert found.why_not == ""


def test_what_cannot_be_screened_says_why():
    few = screen(*bench(5, stations=2, visits=2))
    assert (
        few.why_not
        == f"16 trials have repeats or neighbours to compare with; at least {LEAST_TRIALS} are"
        " needed"
    )
    exact = screen(*bench(5, size=0.0))
    assert exact.why_not == "most trials repeat exactly, so nothing shows how far noise reaches"
    none = screen(*(np.zeros(0) for _ in range(3)), np.zeros(0, dtype=np.int64))
    assert none.why_not
    assert not few.outlying.any() | exact.outlying.any() | none.outlying.any()


def test_a_visit_that_is_off_as_a_whole_is_odd_and_none_of_its_trials_is_outlying():
    log_lift, z, throttle, visit = bench(5)
    before = odd_visits(log_lift, z, throttle, visit).tolist()
    log_lift[visit == 17] += 0.08
    assert set(odd_visits(log_lift, z, throttle, visit)) - set(before) == {17}
    assert not screen(log_lift, z, throttle, visit).outlying.any()
    assert odd_visits(log_lift[:4], z[:4], throttle[:4], visit[:4]).tolist() == []
