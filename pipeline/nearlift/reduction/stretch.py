"""A stretch of a record as the few numbers by which mean, noise and quality are judged."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray, IntArray
from nearlift.native import POINTER, REAL, WHOLE, Kernel, address

STRETCH = Kernel(
    "nearlift.reduction.sums_kernel", "stretch", POINTER, WHOLE, WHOLE, POINTER, POINTER, POINTER
)
STEADY = Kernel("nearlift.reduction.sums_kernel", "steady", POINTER, WHOLE, REAL)
#: Sums that the kernel gives before the batches' means.
SUMS = 9
#: Standard deviations of normal noise in one median absolute deviation.
SD_PER_MAD = 1.4826


class Stretch(NamedTuple):
    """What n samples add up to; `away` is a sample less the mean.

    `batches` (b,) are means of away, weighted with a Hann window and overlapping by half (away
    itself where it is cut into none), `gain` the sum of the window's squared weights; `squares` is
    the sum of away^2, `tilt` that of away times the sample's number less the middle one. `low` and
    `high` are the extremes; `repeats`, `at_low`, `at_high` and `far` count the samples that repeat
    the one before, stand at either, and lie more than six standard deviations away.
    """

    n: int
    batches: FloatArray
    gain: float
    mean: float = 0.0
    squares: float = 0.0
    tilt: float = 0.0
    low: float = 0.0
    high: float = 0.0
    repeats: float = 0.0
    at_low: float = 0.0
    at_high: float = 0.0
    far: float = 0.0


def median(values: NDArray[Any]) -> float:
    """The median of finite values; numpy's takes ten times as long, and loads masked arrays."""
    middle = len(values) // 2
    ranked = np.sort(values)
    return float(ranked[middle] if len(values) % 2 else (ranked[middle - 1] + ranked[middle]) / 2)


def distinct(values: NDArray[Any]) -> NDArray[Any]:
    """The values that occur, rising; numpy's would load its masked arrays."""
    ranked = np.sort(values)
    first = np.ones(len(ranked), dtype=bool)
    first[1:] = ranked[1:] != ranked[:-1]
    return np.compress(first, ranked)


def numbered(values: NDArray[Any]) -> IntArray:
    """The place of each value among those that occur."""
    return np.searchsorted(distinct(values), values).astype(np.int64)


def numbered_pairs(major: NDArray[Any], minor: NDArray[Any]) -> IntArray:
    """The place of each pair of values among those that occur."""
    place = numbered(minor)
    return numbered(numbered(major) * (place.max(initial=0) + 1) + place)


def stretch(values: FloatArray, half: int) -> Stretch:
    """The stretch of some samples, in batches of twice `half`; with `half` 0 in none."""
    n = len(values)
    if n == 0:
        return Stretch(0, np.empty(0), 1.0)
    values = np.ascontiguousarray(values, dtype=np.float64)
    sums = np.empty(SUMS + (n // half if half else 1))
    window = _window(half)
    STRETCH(address(values), n, half, *window.places, address(sums))
    return Stretch(
        n, sums[SUMS:-1] if half else values - sums[0], window.gain, *sums[:SUMS].tolist()
    )


def steady(clock: FloatArray, rate_Hz: float) -> bool:
    """Whether every step of a clock is one sample long, to a hundredth of it."""
    clock = np.ascontiguousarray(clock, dtype=np.float64)
    return bool(STEADY(address(clock), len(clock), rate_Hz))


class _Window(NamedTuple):
    """The two halves of a Hann window of unit sum, where they stand, and its sum of squares."""

    halves: FloatArray
    places: tuple[int, int]
    gain: float


@functools.lru_cache(maxsize=64)
def _window(half: int) -> _Window:
    if half == 0:
        return _Window(np.empty((2, 0)), (0, 0), 1.0)
    window = np.sin(np.pi * (np.arange(2 * half) + 0.5) / (2 * half)) ** 2
    window /= window.sum()
    halves = window.reshape(2, half)
    return _Window(halves, (address(halves[0]), address(halves[1])), float(window @ window))
