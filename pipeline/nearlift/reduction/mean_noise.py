"""How well a record's mean is known: the noise's spectral density at frequency zero, from batch
means.

The standard error is made from batch means. A rotor tone (61 Hz and its like) is no noise of the
mean: it averages out within each batch. Estimators that add up autocorrelations are fooled by it.
Three choices make the batches right:

* They are long, so that slow noise is counted: a sixteenth of the record (an eighth of the tare)
  and at least 60 ms. Noise that remembers for a twelfth of the tare's batch makes u 4 % low. For a
  fifth it is 13 % (measured in tests/reduction/test_record.py).
* Each is weighted with a Hann window. So a tone which does not fit a whole number of times leaks
  30 dB less than from plain batches. For white noise the weighted means have ``sum(w^2) /
  sum(w)^2`` of the samples' variance, which is divided out.
* They overlap by half, which wins back the efficiency that the window costs.

What results is the noise's spectral density at frequency zero, S0 (N^2 per sample), and u^2 = S0 /
n. Where batches far apart are alike, noise outlasts a batch. `nearlift.reduction.slow_noise` then
estimates the error of the mean. The code `slow` marks trials for which no record of this length
can.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from nearlift.declare import FloatArray
from nearlift.reduction import slow_noise
from nearlift.reduction.slow_noise import SlowNoise
from nearlift.reduction.stretch import Stretch, stretch

#: Batches of a record and of a tare, where they are long enough; and the fewest.
BATCHES, TARE_BATCHES, FEWEST_BATCHES = 16, 8, 4
#: The shortest batch, in s and in samples.
SHORTEST_BATCH_S, SHORTEST_BATCH = 0.06, 8


class RecordPart(NamedTuple):
    """Samples of the tare or of the live part, the variance of their mean times their number (N^2),
    and their sums.
    """

    values: FloatArray
    density: float
    sums: Stretch


def part_of(values: FloatArray, rate_Hz: float, *, tone: bool) -> RecordPart:
    """Samples (n,) with the variance of their mean times n, N^2, and the stretch with the batch
    means that it was made from.

    `tone` says whether the rotors ran. A tare has no tone; it is shorter, so it is cut into fewer
    batches to keep them long. Biased low by noise whose correlation time is not short against a
    batch, as every estimate from one record is.
    """
    n = len(values)
    least = min(_shortest(rate_Hz, tone), n // FEWEST_BATCHES)
    half = max(n // (BATCHES if tone else TARE_BATCHES), least) // 2
    run = stretch(values, half if half >= 2 else 0)
    if half < 2:
        return RecordPart(values, run.squares / max(n - 1, 1), run)
    means = run.batches
    # each mean is taken from the record's own mean, which shares 1/n of its variance
    # not by BLAS: a record that will be rejected may hold inf
    density = float(np.add.reduce(means * means)) / len(means) / (run.gain - 1.0 / n)
    return RecordPart(values, density, run)


def outlasting(
    values: FloatArray, means: FloatArray, u2: float, rate_Hz: float, *, tone: bool = True
) -> SlowNoise | None:
    """Noise that outlasts a batch, where means raise the suspicion and it is over `u2`."""
    if not slow_noise.suspected(means):
        return None
    # a tone leaks less from longer batches
    half = max(len(values) // slow_noise.SEGMENTS, _shortest(rate_Hz, tone) // 2)
    finer = stretch(values, half)
    slow = slow_noise.slow_noise(finer.batches)
    return slow if slow is not None and slow.variance > u2 else None


def _shortest(rate_Hz: float, tone: bool) -> int:
    """Samples of the shortest batch."""
    return max(SHORTEST_BATCH, math.ceil(SHORTEST_BATCH_S * rate_Hz) if tone else 0)
