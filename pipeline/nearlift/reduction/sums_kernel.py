"""What a record's samples add up to, compiled: each stretch is gone over a few times while it is in
the cache, and nothing is allocated.

Sums are taken in the order that suits the processor (`reassoc`), as numpy's and BLAS's are: their
last bits are the machine's own.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.compiler import inlined, numba

#: Where each sum is put; means of batches follow.
MEAN, SQUARES, TILT, LOW, HIGH, REPEATS, AT_LOW, AT_HIGH, FAR, SUMS = range(10)


def stretch(values: Any, n: Any, half: Any, rising: Any, falling: Any, sums: Any) -> Any:
    """Sums over `n` samples, at least one.

    Squares of the samples less their mean, these times the sample's number less the middle one, the
    lowest and the highest sample, how many samples repeat the one before, are the lowest, are the
    highest, and lie more than six standard deviations off; then the means of batches of twice
    `half` samples that overlap by half, weighted with a window that is `rising` and `falling` (none
    where `half` is 0).
    """
    total = 0.0
    for i in range(n):
        total += values[i]
    mean = total / n
    low = high = values[0]
    for i in range(1, n):
        # two branches that are hardly ever taken; `min` and `max` would wait for one another
        value = values[i]
        if value < low:
            low = value
        elif value > high:
            high = value
    squares = tilt = 0.0
    middle = 0.5 * (n - 1)
    for i in range(n):
        away = values[i] - mean
        squares += away * away
        tilt += (i - middle) * away
    far = 0
    limit = 36.0 * squares / max(n - 1, 1)
    for i in range(n):
        away = values[i] - mean
        far += away * away > limit
    repeats = at_low = at_high = 0
    for i in range(1, n):
        repeats += values[i] == values[i - 1]
    for i in range(n):
        at_low += values[i] == low
        at_high += values[i] == high
    sums[MEAN], sums[SQUARES], sums[TILT] = mean, squares, tilt
    sums[LOW], sums[HIGH] = low, high
    sums[REPEATS], sums[AT_LOW], sums[AT_HIGH], sums[FAR] = repeats, at_low, at_high, far
    if half > 0:
        before = 0.0
        for k in range(n // half):
            up = down = 0.0
            for j in range(half):
                away = values[k * half + j] - mean
                up += away * rising[j]
                down += away * falling[j]
            if k > 0:
                sums[SUMS + k - 1] = before + down
            before = up
    return np.int64(0)


@inlined
def _median(values: Any, n: Any) -> Any:
    """The median of a few numbers by counting what is below each, ten times as fast as to sort."""
    median = values[0]
    for i in range(n):
        below = equal = 0
        for j in range(n):
            below += values[j] < values[i]
            equal += values[j] == values[i]
        if below <= n // 2 and n // 2 < below + equal:
            median = values[i]
    return median


@inlined
def _spread(values: Any, n: Any, results: Any, at: Any) -> None:
    """Median, median absolute and largest deviation of a few numbers, which become deviations."""
    level = _median(values, n)
    farthest = 0.0
    for i in range(n):
        values[i] = abs(values[i] - level)
        farthest = max(farthest, values[i])
    results[at], results[at + 1], results[at + 2] = level, _median(values, n), farthest


def look(values: Any, n: Any, every: Any, length: Any, work: Any, steps: Any, results: Any) -> Any:
    """Median, median absolute deviation and largest deviation of every so many samples; the same of
    the means of blocks of `length` samples, and of the steps between these.

    There are at most as many of each as `work` and `steps` have room for.
    """
    count = 0
    for i in range(0, n, every):
        work[count] = values[i]
        count += 1
    _spread(work, count, results, 0)
    number = n // length
    for k in range(number):
        total = 0.0
        for i in range(length):
            total += values[k * length + i]
        work[k] = total / length
        if k > 0:
            steps[k - 1] = work[k] - work[k - 1]
    _spread(work, number, results, 3)
    _spread(steps, number - 1, results, 6)
    return np.int64(0)


def steady(clock: Any, n: Any, rate_Hz: Any) -> Any:
    """Whether every step of a clock of `n` times is one sample long, to a hundredth of it."""
    off = 0
    for i in range(1, n):
        step = (clock[i] - clock[i - 1]) * rate_Hz
        off += not (step > 0.99 and step < 1.01)
    return np.int64(off == 0)


types = numba.types
_NUMBERS: Any = types.CPointer(types.float64)
#: What `nearlift.native` compiles.
KERNELS: dict[str, object] = {
    "stretch": (
        stretch,
        types.int64(_NUMBERS, types.int64, types.int64, _NUMBERS, _NUMBERS, _NUMBERS),
        {"fastmath": {"reassoc"}},
    ),
    "look": (
        look,
        types.int64(_NUMBERS, types.int64, types.int64, types.int64, _NUMBERS, _NUMBERS, _NUMBERS),
        {"fastmath": {"reassoc"}},
    ),
    "steady": (steady, types.int64(_NUMBERS, types.int64, types.float64), {}),
}
