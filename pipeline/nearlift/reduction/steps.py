"""A record of two throttles: its batch means stand on two levels, and not on a line."""

from __future__ import annotations

import math

import numpy as np

from nearlift.declare import FloatArray

FEWEST_BATCHES = 8
#: A step counts that stands within the middle half: nearer to the ends it is a start or a stop.
EDGE = 0.25


def stepped(means: FloatArray, allowed_N: float) -> bool:
    """Whether the means of successive batches step from one level to another.

    Parameters
    ----------
    means : (n,) float array
        Batch means of the live part, N.
    allowed_N : float
        A smaller step is let pass.

    Notes
    -----
    The best split into two levels must leave less than half of the squares that the best straight
    line leaves, and the step must be six times the scatter about the levels: a drift, however
    strong, is no step (two levels leave a quarter of a ramp's squares, a line none).
    """
    n = len(means)
    # no two levels lie farther apart than the means do
    if n < FEWEST_BATCHES or float(means.max() - means.min()) <= allowed_N:
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
