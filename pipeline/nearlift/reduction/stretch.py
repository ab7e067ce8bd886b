"""A stretch of a record as the few numbers by which mean, noise and quality are judged."""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray

#: Share of long steps from which on a clock may be rounded to nearly its own step, and the steps
#: that do not show it.
ROUNDED, FEW_STEPS = 0.05, 30
#: Standard deviations of normal noise in one median absolute deviation.
SD_PER_MAD = 1.4826
#: Samples up to which the numbers of a record are kept for the next one.
MOST_KEPT = 1 << 20


class Stretch(NamedTuple):
    """Sums over n samples; `away` is a sample less the mean.

    `batches` (b,) are means of away, weighted with a Hann window and overlapping by half. They are
    away itself where it is cut into none. `gain` is the sum of the window's squared weights.
    `squares` is the sum of away^2, `tilt` that of away times the sample's number less the middle
    one. `low` and `high` are the extremes. `repeats` counts the samples that repeat the one before,
    `at_low` and `at_high` those at either extreme. `far` counts those more than six standard
    deviations away.
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


def stretch(values: FloatArray, half: int) -> Stretch:
    """The stretch of some samples, in batches of twice `half`; with `half` 0 in none.

    No sum is BLAS's, whose threads would change its last bits.
    """
    n = len(values)
    if n == 0:
        return Stretch(0, np.empty(0), 1.0)
    mean = float(np.add.reduce(values)) / n
    low, high = float(values.min()), float(values.max())
    away = values - mean
    ramp = _ramp(n) if n <= MOST_KEPT else _ramp.__wrapped__(n)
    squared = away * away
    squares = float(np.add.reduce(squared))
    limit = 36.0 * squares / max(n - 1, 1)
    farthest = max(high - mean, mean - low)
    few_far = farthest * farthest > limit
    batches, gain = away, 1.0
    if half:
        (rising, falling), gain = _window(half)
        halves = away[: n // half * half].reshape(n // half, half)
        up, down = (np.einsum("ij,j->i", halves, side) for side in (rising, falling))
        batches = up[:-1] + down[1:]
    return Stretch(
        n,
        batches,
        gain,
        mean=mean,
        squares=squares,
        tilt=float(np.add.reduce(away * ramp)),
        low=low,
        high=high,
        repeats=float(np.count_nonzero(values[1:] == values[:-1])),
        at_low=float(np.count_nonzero(values == low)),
        at_high=float(np.count_nonzero(values == high)),
        far=float(np.count_nonzero(squared > limit)) if few_far else 0.0,
    )


def steady(clock: FloatArray, rate_Hz: float) -> bool:
    """Whether every step of a clock is one sample long, to a hundredth of it."""
    steps = np.diff(clock) * rate_Hz
    # a step that is no number is not steady
    return len(steps) == 0 or bool(steps.min() > 0.99 and steps.max() < 1.01)


def usual_step(steps: FloatArray) -> float:
    """The usual step of a clock: the mean of those near the median one; 0 where there is none.

    The median alone does not suffice: stamps may be rounded to 12 and 13 ms. Stamps of 8 Hz in
    tenths of a second are one or two of them apart. They keep to a straight line within one, which
    lost samples do not.
    """
    middle = float(np.median(steps)) if len(steps) else 0.0
    if middle > 0 and len(steps) > FEW_STEPS and np.mean(steps > 1.5 * middle) > ROUNDED:
        mean = float(np.mean(steps))
        if np.ptp(np.cumsum(steps - mean)) <= 1.5 * middle:
            return mean
    near = steps[np.abs(steps - middle) < 0.5 * abs(middle)]
    return float(np.mean(near)) if len(near) else middle


@functools.lru_cache(maxsize=8)
def _ramp(n: int) -> FloatArray:
    """The numbers of n samples less the middle one."""
    return np.arange(n, dtype=float) - 0.5 * (n - 1)


@functools.lru_cache(maxsize=64)
def _window(half: int) -> tuple[FloatArray, float]:
    """The two halves of a Hann window of unit sum, and its sum of squares."""
    window = np.sin(np.pi * (np.arange(2 * half) + 0.5) / (2 * half)) ** 2
    window /= window.sum()
    return window.reshape(2, half), float(window @ window)
