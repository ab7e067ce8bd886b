"""A converter's counter that wraps: a jump far beyond any force that lasts."""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.reduction.stretch import SD_PER_MAD, median

#: Codes of the counters of load cells: 2^16, 2^20, 2^24, 2^32; a lift moves the jump by this share.
CODES, LIFT_SHARE = (1 << 16, 1 << 20, 1 << 24, 1 << 32), 0.03
#: Standard deviations of a sample that a jump has where the scale of the counts is not known, and
#: samples that it lasts.
JUMP, LASTS = 3e4, 5


def wrap_of(force: FloatArray, largest: float | None = None) -> float | None:
    """The size of a jump from one sample to the next that lasts and is no force; None where there
    is none.

    It is above the `largest` force that is possible. Where that is not known, it is tens of
    thousands of standard deviations, or all codes of a counter.
    """
    known = force[np.isfinite(force)]
    if len(known) < 4 * LASTS:
        return None
    steps = np.abs(np.diff(known))
    at = int(np.argmax(steps)) + 1
    before, after = known[max(at - LASTS, 0) : at], known[at : at + LASTS]
    if len(before) < 1 or len(after) < 1:
        return None
    jump = abs(median(after) - median(before))
    if jump < 0.5 * steps[at - 1]:
        return None
    if largest is not None:
        return jump if jump > largest else None
    whole = bool((known[:: max(1, len(known) // 100)] % 1 == 0).all())
    counted = whole and any(abs(jump / codes - 1) < LIFT_SHARE for codes in CODES)
    scatter = SD_PER_MAD * median(steps) / 2**0.5
    return jump if counted or (scatter > 0 and jump > JUMP * scatter) else None
