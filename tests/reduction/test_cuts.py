"""Where a record is cut: every sample once, steps found, noise left whole."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearlift.reduction import cuts

LEVELS = st.lists(st.tuples(st.sampled_from([0.0, 1.0, 1.4, np.nan]), st.integers(1, 5)))


@given(LEVELS, st.sampled_from([0.0, 0.5]))
def test_levels_cover_every_sample_once(levels: list[tuple[float, int]], hold: float) -> None:
    values = np.array([v for v, n in levels for _ in range(n)])
    found = cuts.by_level(values, hold)
    assert [i for a, b in found for i in range(a, b)] == list(range(len(values)))
    for a, b in found:
        own = values[a:b]
        assert np.isnan(own).all() or np.ptp(own) <= hold
    for (a, _), (b, c) in itertools.pairwise(found):
        # the next sample did not belong
        both = values[[*range(a, b), b]]
        assert np.isnan(both).any() or np.ptp(both) > hold, (a, b, c)


@given(st.integers(1, 60), st.integers(1, 20), st.integers(1, 20), st.integers(0, 30))
def test_windows_are_of_one_length_but_for_the_last(
    n: int, length: int, first: int, more: int
) -> None:
    found = cuts.windows(first, first + n, length)
    assert all(b - a == length for a, b in found[:-1])
    assert all(length <= 2 * (b - a) <= 2 * length for a, b in found[-1:])
    assert sum(b - a for a, b in found) > n - length / 2 - 1 or not found


@given(
    st.lists(st.integers(1, 30), min_size=1, max_size=8),
    st.integers(0, 12),
    st.integers(1, 12),
    st.one_of(st.none(), st.integers(12, 20)),
)
def test_what_is_kept_and_what_is_not_is_all_there_is(
    lengths: list[int], settle: int, shortest: int, window: int | None
) -> None:
    ends = np.cumsum(lengths).tolist()
    edges = list(zip([0, *ends[:-1]], ends, strict=True))
    found = cuts.settled(edges, settle, shortest, window)
    kept = sum(p.end - p.start for p in found.pieces)
    assert kept + found.settling + found.between == sum(lengths)
    assert all(p.end - p.start >= shortest for p in found.pieces)
    if window is None:
        assert len(found.pieces) + found.short == len(lengths)
        other = cuts.settled(edges, settle + 1, shortest)
        numbers = {p.number: p.first for p in found.pieces}
        assert all(numbers[p.number] == p.first for p in other.pieces)


def test_white_noise_is_left_whole() -> None:
    """Of 400 records of noise, each of 16 batches' length or of 100, at most 1 % are split: 4 are
    expected at most, and more than 10 are less likely than 0.003 (binomial).
    """
    rng = np.random.default_rng(20)
    split = 0
    for k in range(400):
        values = rng.normal(0, 1, 320 if k % 2 else 2000)
        split += len(cuts.by_change(values, 0.05, 160)) > 1
    assert split <= 10


@pytest.mark.parametrize("step", [0.5, 1.0, 5.0])
def test_steps_are_found_to_the_sample_or_nearly(step: float) -> None:
    """A change of half the noise over 400 samples is ten standard errors of its size."""
    rng = np.random.default_rng(4)
    edges = [0, 400, 750, 1300, 1800]
    level = np.repeat(np.arange(4) * step, np.diff(edges))
    found = cuts.by_change(level + rng.normal(0, 1, 1800), step / 2, 200)
    assert len(found) == 4
    # a place is known to a few times (noise / step)^2 samples, within a batch of 25
    off = np.abs(np.array([a for a, _ in found]) - edges[:-1])
    assert off.max() <= min(10 * (1 / step) ** 2 + 1, 50)


@pytest.mark.parametrize(
    ("levels", "expected"),
    [
        ((1.0, 1.3), [(0, 10)]),
        ((1.0, 1.6), [(0, 5), (5, 10)]),
        # 0.4 goes to 0.7, and their mean stands 0.55 from 0
        ((0.0, 0.4, 0.7), [(0, 5), (5, 15)]),
        ((0.0, 0.3, 0.6, 2.0), [(0, 15), (15, 20)]),
    ],
)
def test_neighbours_less_than_a_step_apart_are_one_the_nearest_first(
    levels: tuple[float, ...], expected: list[tuple[int, int]]
) -> None:
    edges = range(0, 5 * len(levels) + 1, 5)
    assert cuts._joined(np.repeat(levels, 5), edges, 0.5) == expected


def test_steps_below_the_smallest_are_none() -> None:
    rng = np.random.default_rng(5)
    values = np.repeat([0.0, 1.0, 1.1], 400) + rng.normal(0, 0.01, 1200)
    assert [a for a, _ in cuts.by_change(values, 0.3, 200)] == [0, 400]
    assert [a for a, _ in cuts.by_change(values, 0.05, 200)] == [0, 400, 800]


def test_samples_without_a_number_do_not_part_a_plateau() -> None:
    values = np.repeat([0.0, 1.0], 300) + np.random.default_rng(6).normal(0, 0.01, 600)
    values[[0, 1, 50, 299, 450]] = np.nan
    assert len(cuts.by_change(values, 0.3, 100)) == 2
    assert cuts.by_change(np.full(50, np.nan), 0.3, 10) == [(0, 50)]
    assert cuts.by_change(np.empty(0), 0.3, 10) == []


def test_the_longest_shortest_keeps_half() -> None:
    edges = [(0, 10), (10, 100), (100, 112), (112, 200)]
    shortest = cuts.longest_shortest(edges, 5)
    found = cuts.settled(edges, 5, shortest)
    assert sum(p.end - p.first for p in found.pieces) >= 100
    assert cuts.settled(edges, 5, shortest + 1).pieces != found.pieces
    assert cuts.longest_shortest([(0, 3)], 5) == 0
