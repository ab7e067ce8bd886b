"""Samples and blocks of samples that stand apart from the rest of a tare, by median and median absolute deviation (Hampel 1974).

Median and deviation hold out against damage to nearly half of the samples, where mean and standard deviation follow a single one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from nearlift.native import POINTER, WHOLE, Kernel, address
from nearlift.reduction.steps import stepped
from nearlift.reduction.stretch import Stretch

FloatArray = NDArray[np.float64]

LOOK = Kernel("nearlift.reduction.kernel", "look", POINTER, WHOLE, WHOLE, WHOLE, POINTER, POINTER)
#: Standard deviations of normal noise in one median absolute deviation.
SD_PER_MAD = 1.4826
#: Standard deviations, by the median, beyond which one of many stands apart; of few, whose scale is uncertain, more are asked for.
APART, FEW = 8.0, 18
#: Share of that distance from which on samples are looked at one by one.
SUSPECT = 0.75
#: Samples of the first look.
FIRST_LOOK = 64
#: Blocks that a stretch is cut into, and samples that each has at least, and blocks that there must be.
BLOCKS, SHORTEST_BLOCK, FEWEST_BLOCKS = 64, 8, 8
#: Where no block lies farther from the median, half of them may stand on one level and half on another.
TWO_LEVELS = 1.6
#: Single samples come in runs of so many at most, and are so large a share.
LONGEST_RUN, LARGEST_SHARE = 5, 0.05


def suspicious(values: FloatArray, sums: Stretch) -> tuple[bool, bool]:
    """Whether single samples, and whether blocks of them, may stand apart: a first look that costs next to nothing."""
    n = len(values)
    length = _length(n)
    number = n // length
    values = np.ascontiguousarray(values, dtype=np.float64)
    room = 2 * max(FIRST_LOOK, BLOCKS)
    work = np.empty(room + 6)
    place = address(work)
    LOOK(address(values), n, max(1, n // FIRST_LOOK), length, place, place + 8 * room)
    level, deviation, _, _, of_blocks, farthest = work[room:].tolist()
    far = max(sums.high - level, level - sums.low) > SUSPECT * _apart(n) * SD_PER_MAD * deviation
    scale = SD_PER_MAD * of_blocks
    uneven = number >= FEWEST_BLOCKS and not TWO_LEVELS * scale <= farthest <= _apart(number) * scale
    return far, uneven


def step_of(values: FloatArray) -> float:
    """The step between a converter's codes; next to nothing where values are not coarse."""
    steps = np.sort(np.diff(np.unique(values)))
    # a damaged sample need not stand on a code
    return float(steps[len(steps) // 10]) if len(steps) else 0.0


def far_samples(values: FloatArray, step: float) -> NDArray[np.bool_]:
    """Mask of the samples that stand apart; noise below a converter's `step` is taken for half of it."""
    away = np.abs(values - np.median(values))
    far: NDArray[np.bool_] = away > _apart(len(values)) * max(SD_PER_MAD * float(np.median(away)), step / 2)
    return far


def are_single(mask: NDArray[np.bool_]) -> bool:
    """Whether what is masked are single samples, which can be left out, and no part of the stretch."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return int(np.count_nonzero(mask)) <= max(1.0, LARGEST_SHARE * len(mask)) and int((edges[1::2] - edges[::2]).max(initial=0)) <= LONGEST_RUN


def moved_by_blocks(values: FloatArray, step: float) -> float:
    """By how much blocks of samples that stand apart from the others, or two levels, move the mean; 0 where there are none."""
    length = _length(len(values))
    number = len(values) // length
    if number < FEWEST_BLOCKS:
        return 0.0
    means = values[: number * length].reshape(number, length).mean(axis=1)
    away = np.abs(means - np.median(means))
    scale = max(SD_PER_MAD * float(np.median(away)), step / (2 * length**0.5))
    far = away > _apart(number) * scale
    if far.any():
        return float(away[far].sum()) / number
    return float(np.ptp(means)) / 2 if float(away.max()) < TWO_LEVELS * scale and stepped(means, step) else 0.0


def _length(n: int) -> int:
    return max(n // BLOCKS, SHORTEST_BLOCK)


def _apart(n: int) -> float:
    return APART * (1 + (FEW / n) ** 2)
