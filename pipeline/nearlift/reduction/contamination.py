"""Outlying samples and blocks of samples, by median and median absolute deviation (Hampel 1974).

Median and deviation hold out against damage to nearly half of the samples, where mean and standard
deviation follow a single one.
"""

from __future__ import annotations

import functools
import math

import numpy as np

from nearlift.declare import BoolArray, FloatArray
from nearlift.reduction.stretch import SD_PER_MAD, Stretch, median

#: Standard deviations, by the median, beyond which one of many is outlying; of few, whose scale is
#: uncertain, more are asked for.
APART, SMALL_SAMPLE = 6.5, 20
#: Share of that distance at which samples are outlying if there are so many, of at least so many.
NEARER, MIN_OUTLYING, MIN_SAMPLES = 0.7, 3, 100
#: Samples of the first look, and the standard deviations at which blocks are looked at again.
FIRST_LOOK, UNEVEN = 64, 5.0
#: Blocks that a stretch is cut into, and samples that each has at least, if there are enough; and
#: the fewest that show anything.
BLOCKS, SHORTEST_BLOCK, FEWEST_BLOCKS = 32, 8, 10
#: A trend is a cubic that explains so many times what noise would, by the blocks' means; of few,
#: more is asked for.
CUBIC, TREND = 3, 12.0
#: Longest run of single outlying samples, and their largest share.
LONGEST_RUN, LARGEST_SHARE = 5, 0.05
#: Distance of an impossible reading, such as a converter's error code, from the median in robust
#: standard deviations; and the largest share of such readings.
IMPOSSIBLE, IMPOSSIBLE_SHARE = 20.0, 0.2
#: Samples of a start that the running median of `reduction.start` does not show, and standard
#: errors of the mean by which one of them must move it to be left out.
UNSEEN, MATTERS = 2, 3.0
#: Noise, in steps of the converter, that half of the samples on one code may hide; of a block's
#: mean the less by the root of its samples.
HIDDEN = 0.74
#: How far beyond one block's limit a long segment must be, being the best of many: the largest
#: of 54,000 clean tares of 100 to 2000 samples, white with half as much noise of memory 0.9, was
#: 1.4.
OF_MANY = 1.6
#: Samples that a converter's step is taken from.
ENOUGH_CODES = 2000
#: A step between two levels counts where it is within the middle half, of so many means at
#: least: nearer to the ends it is a start or a stop.
EDGE, FEWEST_TO_STEP = 0.25, 8


# ---- samples


def step_of(values: FloatArray) -> float:
    """The step between a converter's codes; next to nothing where values are not coarse."""
    steps = np.sort(np.diff(np.unique(values[:ENOUGH_CODES])))
    # a damaged sample need not be on a code
    return float(steps[len(steps) // 10]) if len(steps) else 0.0


def suspicious(values: FloatArray, sums: Stretch) -> tuple[bool, bool]:
    """Whether single samples, and whether a segment, may be outlying: a first and cheap look."""

    def spread(some: FloatArray) -> tuple[float, float, float]:
        """The upper median, the median absolute deviation and the largest deviation."""
        middle = len(some) // 2
        level = float(np.sort(some)[middle])
        away = np.sort(np.abs(some - level))
        return level, float(away[middle]), float(away[-1])

    n, means = len(values), blocks(values)
    level, deviation, _ = spread(values[:: max(1, n // FIRST_LOOK)])
    far = max(sums.high - level, level - sums.low) > NEARER * _apart(n) * SD_PER_MAD * deviation
    if len(means) < FEWEST_BLOCKS:
        return far, False
    farthest, of_steps = spread(means)[2], spread(np.diff(means))[1]
    return far, farthest > UNEVEN * SD_PER_MAD * of_steps / 2**0.5


def far_samples(values: FloatArray, step: float) -> BoolArray:
    """Mask of outlying samples, by the noise or what a converter's `step` may hide."""
    away = np.abs(values - median(values))
    limit = _apart(len(values)) * max(SD_PER_MAD * median(away), HIDDEN * step)
    nearer: BoolArray = away > NEARER * limit
    many = len(values) >= MIN_SAMPLES and np.count_nonzero(nearer) >= MIN_OUTLYING
    return nearer if many else away > limit


def impossible(values: FloatArray, sums: Stretch, other: float, first: bool) -> BoolArray | None:
    """Mask of readings that no force explains, such as a converter's error codes.

    None where there is none, or where they are a whole part of the record. Codes may be held for
    many samples.

    `other` is the mean of the part of the record that borders on this one. It borders at this
    part's `first` sample, or else at its last. Samples there between the two levels are rotors that
    start, unless they are so few that a running median does not show them.
    """
    few = values[:: max(1, len(values) // FIRST_LOOK)]
    level = median(few)
    scatter = max(SD_PER_MAD * median(np.abs(few - level)), 0.0)
    # half the limit, for the scatter of a few samples is uncertain
    if max(sums.high - level, level - sums.low) <= IMPOSSIBLE / 2 * scatter:
        return None
    level = median(values)
    away = np.abs(values - level)
    limit = IMPOSSIBLE * max(SD_PER_MAD * median(away), HIDDEN * step_of(values))
    mask: BoolArray = away > limit * (1 + (SMALL_SAMPLE / len(values)) ** 2)
    border = mask if first else mask[::-1]
    starting = np.abs(values - (level + other) / 2) <= 0.6 * abs(level - other)
    run = int(np.argmin(border & (starting if first else starting[::-1])))
    # by what two samples move the mean of a long record is below its standard error
    matters = first and away[0] > MATTERS * limit / IMPOSSIBLE * math.sqrt(len(values))
    border[: 0 if matters and run <= UNSEEN else run] = False
    if not mask.any() or np.count_nonzero(mask) > max(1.0, IMPOSSIBLE_SHARE * len(mask)):
        return None
    # a code that is held counts once; lift and rest, 0 where no other part is, may hold as well
    rest = other if math.isfinite(other) else 0.0
    beyond = np.abs(values - (level + rest) / 2) > abs(level - rest)
    held = mask & beyond & (np.diff(values, prepend=np.nan) == 0)
    return mask if are_single(mask & ~held, IMPOSSIBLE_SHARE) else None


def are_single(mask: BoolArray, largest_share: float = LARGEST_SHARE) -> bool:
    """Whether the masked samples are single ones, which can be left out, and no whole part."""
    few = np.count_nonzero(mask) <= max(1.0, largest_share * len(mask))
    return bool(few) and longest_run(mask) <= LONGEST_RUN


def longest_run(mask: BoolArray) -> int:
    """Most successive samples for which the mask holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


# ---- segments


def moved_by_segment(values: FloatArray, step: float) -> tuple[float, bool]:
    """Shift of the mean by the most outlying segment (0 if none), and whether that is at the
    beginning. Such a segment is a block of damage or a second level.

    It is the segment that explains most of the squares of the blocks' means: the longer it is, the
    smaller a change shows. The noise about the two levels leaves out the two blocks that fit worst,
    in which the segment may begin and end.
    """
    means, noise = blocks(values), _hidden_noise(values, step)
    n = len(means)
    if n < FEWEST_BLOCKS:
        return 0.0, False
    first, end = np.triu_indices(n + 1, 1)
    first, end = first[end - first < n], end[end - first < n]
    inside = end - first
    sums = np.concatenate([[0.0], np.cumsum(means - np.add.reduce(means) / n)])
    best = int(np.argmax((sums[end] - sums[first]) ** 2 / (inside * (n - inside))))
    members = int(inside[best])
    chosen = np.zeros(n, dtype=bool)
    chosen[first[best] : end[best]] = True
    levels = median(means[chosen]), median(means[~chosen])
    left = means - np.where(chosen, *levels)
    inner = np.sort(np.abs(left))[:-2]
    change = abs(levels[0] - levels[1])
    # a long segment shows a small change, unless neighbours are alike anyway
    longer = 1.0
    if len(values) >= n * SHORTEST_BLOCK:
        longer = max((members * (n - members) / n / _memory(left)) ** 0.5 / OF_MANY, 1.0)
    if change * longer <= _apart(n) * max(float(inner @ inner / (n - 4)) ** 0.5, noise):
        return 0.0, False
    size = min(members, n - members)
    return change * size / n, bool(chosen[0]) == (size == members)


def stepped(means: FloatArray, allowed_N: float) -> bool:
    """Whether the means (n,) of successive batches, N, step from one level to another, by more than
    is allowed.

    The best split into two levels must leave less than half of the squares that the best straight
    line leaves. The step must be six times the scatter about the levels. So a drift, however
    strong, is no step: two levels leave a quarter of a ramp's squares, a line none.
    """
    n = len(means)
    # no two levels lie farther apart than the means do
    if n < FEWEST_TO_STEP or float(means.max() - means.min()) <= allowed_N:
        return False
    away = means - means.mean()
    total = float(away @ away)
    first = np.arange(max(2, math.ceil(EDGE * n)), min(n - 2, math.floor((1 - EDGE) * n)) + 1)
    before = np.cumsum(away)[first - 1] / first
    after = -before * first / (n - first)
    explained = first * before**2 + (n - first) * after**2
    best = int(np.argmax(explained))
    step, left = float(after[best] - before[best]), max(total - float(explained[best]), 0.0)
    ramp = np.arange(n) - (n - 1) / 2
    from_line = max(total - float(ramp @ away) ** 2 / float(ramp @ ramp), 0.0)
    return abs(step) > max(allowed_N, 6 * math.sqrt(left / (n - 2))) and left < 0.5 * from_line


def ends_apart(values: FloatArray, step: float) -> float:
    """By how much the first or the last block differs from the median one, where that is more than
    the noise between neighbours; else 0.
    """
    means = blocks(values)
    if len(means) < FEWEST_BLOCKS:
        return 0.0
    apart = float(np.abs(means[[0, -1]] - median(means)).max())
    of_steps = SD_PER_MAD * median(np.abs(np.diff(means))) / 2**0.5
    noise = max(_hidden_noise(values, step), of_steps)
    return apart if apart > _apart(len(means)) * noise else 0.0


def slow_drift(values: FloatArray, means: FloatArray, step: float) -> float:
    """Half range of the level, by a cubic through the blocks' `means`; 0 if it is only noise.

    A zero that drifts has no edge, and what one straight line or a bump leaves of two levels passes
    for noise.
    """
    n = len(means)
    if n < FEWEST_BLOCKS or len(values) < n * SHORTEST_BLOCK:
        return 0.0
    curves = _cubic(n)
    weights = curves.T @ means
    curve = curves @ weights
    left = means - np.add.reduce(means) / n - curve
    noise2 = max(float(left @ left) / (n - 1 - CUBIC), _hidden_noise(values, step) ** 2)
    least = noise2 * _memory(left)
    if float(weights @ weights) <= TREND * (1 + (SMALL_SAMPLE / n) ** 2) ** 2 * CUBIC * least:
        return 0.0
    return float(curve.max() - curve.min()) / 2


def _memory(left: FloatArray) -> float:
    """The factor, at least 1, by which correlated neighbours raise the variance of a sum."""
    squares = float(left @ left)
    alike = min(max(float(left[1:] @ left[:-1]) / squares, 0.0), 0.9) if squares > 0 else 0.0
    return (1 + alike) / (1 - alike)


@functools.lru_cache(maxsize=32)
def _cubic(n: int) -> FloatArray:
    """Orthonormal polynomials of degree 1 to 3 at n places, (n, 3)."""
    powers = np.vander(np.linspace(-1.0, 1.0, n), CUBIC + 1, increasing=True)
    return np.ascontiguousarray(np.linalg.qr(powers)[0][:, 1:])


def blocks(values: FloatArray) -> FloatArray:
    """Means of blocks."""
    length = _length(len(values))
    number = len(values) // length
    # what `mean` does, without looking at its arguments
    sums: FloatArray = np.add.reduce(values[: number * length].reshape(number, length), axis=1)
    return sums / length


def _length(n: int) -> int:
    """Samples of a block."""
    return max(n // BLOCKS, SHORTEST_BLOCK if n >= FEWEST_BLOCKS * SHORTEST_BLOCK else 1)


def _hidden_noise(values: FloatArray, step: float) -> float:
    """Noise of a block's mean that a converter's step may hide."""
    return HIDDEN * step / math.sqrt(_length(len(values)))


def _apart(n: int) -> float:
    return APART * (1 + (SMALL_SAMPLE / n) ** 2)
