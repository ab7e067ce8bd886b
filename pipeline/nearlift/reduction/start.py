"""The start of the rotors in a record: where the rest head ends, and where the lift is steady.

A converter's counter that wraps is found, too: a lasting jump far beyond any force.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nearlift.declare import FloatArray
from nearlift.reduction.stretch import SD_PER_MAD, median

#: Fewest samples of a record, and of a rest head; samples of the running median, which single
#: readings do not move.
FEWEST, FEWEST_HEAD, WIDTH = 20, 5, 5
#: Share of the lift by which rest and steady lift may be left, and the standard deviations of the
#: running median for noisy records.
BAND, DEVIATIONS = 0.1, 5.0
#: Smallest lift, in standard deviations of a sample, whose start can be seen.
SEEN = 6.0
#: Time that a state must last, s.
LASTS_S = 0.03
#: Codes of the counters of load cells. In one direction a load takes less than half of a large one,
#: while few counts may be of any converter.
CODES, LARGE = (1 << 16, 1 << 20, 1 << 24, 1 << 32), 1 << 24
#: Share of a counter by which readings jump that cross its end; different readings that distinguish
#: noise across the end from an error code.
ACROSS, DIFFERENT = 0.97, 3
#: Standard deviations of a sample that a jump has where the scale of the counts is not known, and
#: samples that it lasts.
JUMP, LASTS = 3e4, 5


class RotorStart(NamedTuple):
    """The first sample after the rest head, and the first of steady lift."""

    rest_ends: int
    steady_from: int


def start_of(force: FloatArray, rate_Hz: float) -> RotorStart | None:
    """The start of the rotors in a record of one lift with its rest head.

    None where there is no head, or it is not detectable.

    Rest is the level of the first samples, lift that of the second half.
    """
    known = force[np.isfinite(force)]
    n = len(known)
    if n < FEWEST or n < 0.9 * len(force):
        return None
    smooth = np.median(
        np.lib.stride_tricks.sliding_window_view(np.pad(known, WIDTH // 2, "edge"), WIDTH), axis=1
    )
    rest, lift = median(smooth[: max(FEWEST_HEAD, n // 50)]), median(smooth[n // 2 :])
    scatter = SD_PER_MAD * median(np.abs(np.diff(known))) / 2**0.5
    if abs(lift - rest) <= SEEN * scatter:
        return None
    way = (smooth - rest) / (lift - rest)
    # the running median has about half of the scatter of a sample
    band = max(BAND, DEVIATIONS * 0.55 * scatter / abs(lift - rest))
    lasts = max(WIDTH, round(LASTS_S * rate_Hz))
    begins = _first_that_lasts(way > band, 0, lasts)
    if begins is None or begins < FEWEST_HEAD:
        return None
    steady = _first_that_lasts(np.abs(way - 1) <= band, begins, lasts)
    return None if steady is None else RotorStart(begins, steady)


def steady_after(force: FloatArray, first: int, rate_Hz: float) -> int:
    """Samples from `first` on before the lift is steady; 0 where it is, or no start is detectable.

    The lift is taken for steady after twice the time that it took to come within the band. An
    exponential approach is then within 1 %. At most half of the samples are left out.
    """
    start = start_of(force, rate_Hz)
    if start is None:
        return 0
    rise = start.steady_from - start.rest_ends
    later = start.rest_ends + 2 * rise + max(WIDTH, round(LASTS_S * rate_Hz)) - first
    return later if start.steady_from > first and 2 * later < len(force) - first else 0


def _first_that_lasts(
    mask: np.ndarray[tuple[int], np.dtype[np.bool_]], at: int, lasts: int
) -> int | None:
    """The first index from `at` on from which the mask holds for so many samples."""
    whole = np.convolve(mask[at:], np.ones(lasts, dtype=int), "valid") == lasts
    return at + int(np.argmax(whole)) if whole.any() else None


def wrap_of(force: FloatArray, *, certain: bool = False) -> float | None:
    """The size of a jump from one sample to the next that is no force; None where there is none.

    Whole counts go back and forth across a counter's end, or jump lastingly by half of a large
    counter. Unless it must be `certain`, a lasting jump by a small one, or of tens of thousands of
    standard deviations, is one, too.
    """
    known = force[np.isfinite(force)]
    if len(known) < 4 * LASTS:
        return None
    steps = np.abs(np.diff(known))
    # the rest takes half as long as all else that a record needs
    if certain and steps.max() <= ACROSS * CODES[0]:
        return None
    codes = _counter(known)
    if len(np.unique(known[1:][steps > ACROSS * codes])) >= DIFFERENT:
        return float(steps.max())
    at = int(np.argmax(steps)) + 1
    jump = abs(median(known[at : at + LASTS]) - median(known[max(at - LASTS, 0) : at]))
    if jump < 0.5 * steps[at - 1]:
        return None
    if codes >= LARGE and jump > 0.5 * codes:
        return jump
    scatter = SD_PER_MAD * median(steps) / 2**0.5
    likely = jump > ACROSS * codes or (scatter > 0 and jump > JUMP * scatter)
    return jump if likely and not certain else None


def _counter(force: FloatArray) -> float:
    """The codes of the smallest counter that holds these whole counts; infinite without one."""
    low, high = force.min(), force.max()
    if (force % 1 == 0).all():
        for codes in CODES:
            if (low >= 0 and high < codes) or -codes / 2 <= low <= high < codes / 2:
                return codes
    return math.inf
