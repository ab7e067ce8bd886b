"""Cuts of a record into pieces: at steps of a column, at changes of its mean, into windows;
and what settling leaves of them.

A cut is a pair of indices, the first sample and one past the last. Samples are counted, not timed:
where some are lost, a settling time counted out in those that are left is only the longer.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nearlift.declare import FloatArray
from nearlift.reduction.stretch import SD_PER_MAD, median

Cut = tuple[int, int]
#: Batches that the shortest piece is cut into before changes are looked for, and the most that a
#: record may have: time scales as their square.
BATCHES, MOST = 8, 4000
#: What a further change must gain, in logarithms of the number of batches: white noise is split in
#: fewer than one record of a hundred.
PENALTY = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """A piece of a record: its number, from 1 in the record's order; its first sample, its first
    settled one, and one past the last.
    """

    number: int
    first: int
    start: int
    end: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Cuts:
    """The pieces that are long enough, how many are too short, and how many samples are settling or
    are in pieces too short.
    """

    pieces: tuple[Span, ...] = ()
    short: int = 0
    settling: int = 0
    between: int = 0


def by_level(values: FloatArray, hold: float = 0.0) -> list[Cut]:
    """Stretches in which all samples lie within `hold` of each other.

    Each is as long as it can be from its first sample on. Samples without a number are a stretch of
    their own.
    """
    if len(values) == 0:
        return []
    changed = values[1:] != values[:-1]
    changed &= ~(np.isnan(values[1:]) & np.isnan(values[:-1]))
    starts = np.concatenate([[0], np.flatnonzero(changed) + 1])
    if hold > 0:
        low = high = math.nan
        kept = []
        for start, value in zip(starts.tolist(), values[starts].tolist(), strict=True):
            low, high = min(low, value), max(high, value)
            # a comparison with no number is false
            if value != value or not high - low <= hold:
                kept.append(start)
                low = high = value
        starts = np.array(kept)
    return list(itertools.pairwise([*starts.tolist(), len(values)]))


def by_change(values: FloatArray, step: float, smallest: int) -> list[Cut]:
    """Stretches of constant mean: the partition of least squared error.

    Each change gains more than noise would. Neighbours less than `step` apart are one.

    Values (n,) without a number count as the one before. `smallest` are the samples of the shortest
    piece that is of use: it sets the grid, and no change is missed between two such pieces.

    Optimal partitioning (Jackson et al. 2005, IEEE Signal Process. Lett. 12, 105) of batch means,
    whose noise is estimated from the differences of neighbours. Every change is then moved to the
    sample that fits best within a batch.
    """
    n, known = len(values), np.isfinite(values)
    if known.any():
        last = np.maximum.accumulate(np.where(known, np.arange(n), known.argmax()))
        values = values[last]
    else:
        values = np.zeros(n)
    size = max(smallest // BATCHES, math.ceil(n / MOST), 1)
    m = n // size
    if m < 2:
        return [(0, n)] if n else []
    means = values[: m * size].reshape(m, size).mean(axis=1)
    noise = max(SD_PER_MAD * median(np.abs(np.diff(means))) / math.sqrt(2), step / 100)
    penalty = PENALTY * math.log(m) * noise * noise
    ones, squares = _sums(means)
    best, before = np.zeros(m + 1), np.zeros(m + 1, dtype=np.int64)
    best[0] = -penalty
    for end in range(1, m + 1):
        total, length = ones[end] - ones[:end], end - np.arange(end)
        cost = best[:end] + squares[end] - squares[:end] - total**2 / length + penalty
        before[end] = np.argmin(cost)
        best[end] = cost[before[end]]
    ends = [m]
    while before[ends[-1]]:
        ends.append(int(before[ends[-1]]))
    edges = [0, *(_moved(values, size * e, size) for e in reversed(ends[1:])), n]
    return _joined(values, edges, step)


def _sums(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Running sums of values less their middle, and of their squares, from none to all."""
    away = values - median(values)
    return np.concatenate([[0.0], np.cumsum(away)]), np.concatenate([[0.0], np.cumsum(away**2)])


def _moved(values: FloatArray, at: int, size: int) -> int:
    """The sample within a batch of `at` at which two levels part the samples around it best."""
    first = max(at - 2 * size, 0)
    around = values[first : at + 2 * size]
    ones, _ = _sums(around)
    n = len(around)
    place = np.arange(max(at - first - size, 1), min(at - first + size, n - 1) + 1)
    gain = ones[place] ** 2 / place + (ones[-1] - ones[place]) ** 2 / (n - place)
    return first + int(place[np.argmax(gain)])


def _joined(values: FloatArray, edges: Sequence[int], step: float) -> list[Cut]:
    """The stretches between edges, the nearest neighbours joined until all differ by `step`."""
    cuts = [(a, b) for a, b in itertools.pairwise(edges) if a < b]
    level = [float(values[a:b].mean()) for a, b in cuts]
    while len(cuts) > 1:
        apart = np.abs(np.diff(level))
        k = int(np.argmin(apart))
        if apart[k] >= step:
            break
        cuts[k : k + 2] = [(cuts[k][0], cuts[k + 1][1])]
        level[k : k + 2] = [float(values[slice(*cuts[k])].mean())]
    return cuts


def windows(first: int, end: int, length: int) -> list[Cut]:
    """Windows of so many samples; what is left at the end is one more, if it is half as long."""
    cuts = [(a, min(a + length, end)) for a in range(first, end, length)]
    return cuts if cuts and 2 * (cuts[-1][1] - cuts[-1][0]) >= length else cuts[:-1]


def settled(cuts: Sequence[Cut], settle: int, shortest: int, length: int | None = None) -> Cuts:
    """Pieces of each cut behind its first `settle` samples, cut on into windows of `length`
    where that is given, if it has `shortest` samples.

    Pieces are counted whether they are kept or not, so that another `settle` renames none of them
    (windows aside, whose number it changes).
    """
    kept: list[Span] = []
    number = short = settling = between = 0
    for first, end in cuts:
        start = min(first + settle, end)
        parts = [(start, end)] if length is None else windows(start, end, length) or [(start, end)]
        for k, (a, b) in enumerate(parts):
            number += 1
            if b - a >= shortest:
                kept.append(Span(number=number, first=a if k else first, start=a, end=b))
                settling += 0 if k else start - first
            else:
                short += 1
                between += b - (a if k else first)
        between += end - parts[-1][1]
    return Cuts(pieces=tuple(kept), short=short, settling=settling, between=between)


def longest_shortest(cuts: Sequence[Cut], settle: int) -> int:
    """The largest `shortest`, in samples, that keeps pieces with half of all; 0 if none does."""
    left = np.sort([max(end - first - settle, 0) for first, end in cuts])[::-1]
    whole = sum(end - first for first, end in cuts)
    kept = np.cumsum(left + settle * (left > 0))
    enough = np.flatnonzero(2 * kept >= whole)
    return int(left[enough[0]]) if len(enough) else 0
