"""Detection of throttle sweeps: records of several lifts, which are more than one trial."""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.reduction.samples import LARGEST_N
from nearlift.reduction.stretch import SD_PER_MAD

#: Stretches whose levels show how the force moves. Below this part of the largest the rotors are at
#: rest. The rest of the record moves by more than such a ratio, and more than so many times the
#: stretches' noise, if it is no one lift.
STRETCHES, AT_REST, MOVES, ABOVE_NOISE = 200, 0.05, 1.3, 10.0
#: Samples of a record that is judged.
FEWEST = 100


def is_sweep(force: FloatArray) -> bool:
    """Whether a record's force (n,) has several lifts, far apart; readings at rest do not count.

    The reading at rest may have any value: a zero that is not tared, with one lift, is one trial. A
    record with a blank, or a number beyond any load cell's range, is not a sweep.
    """
    if len(force) < FEWEST or not np.abs(force).max() <= LARGEST_N:
        return False
    levels = levels_of(force)
    for size in (levels, levels - levels[0]):
        size = size if abs(size.max()) >= abs(size.min()) else -size
        # neighbours differ by noise, or by steps, which are few
        noise = SD_PER_MAD * float(np.median(np.abs(np.diff(size)))) / np.sqrt(2)
        run = size[size > AT_REST * np.quantile(size, 0.95)]
        if len(run) < 10 or size.max() <= 0:
            return False
        low, high = np.quantile(run, [0.1, 0.9])
        if not (high > MOVES * low and high - low > ABOVE_NOISE * noise):
            return False
    return True


def levels_of(values: FloatArray) -> FloatArray:
    """Medians of short stretches, which single impossible readings do not move."""
    parts = np.array_split(values, max(1, min(STRETCHES, len(values) // 3))) if len(values) else []
    return np.array([float(np.median(p)) for p in parts])
