"""The standard error of a mean under noise that outlasts a batch (restricted likelihood of batch
means).

Batch means take no notice of noise that remembers for longer than a batch. Here a record is cut
into finer ones to estimate their correlation. The model is correlation exp(-|t| / tau) with white
noise. Its time and its share are on a grid, each weighed by its restricted likelihood.

* Contrasts with a straight line decide whether there is slow noise: a drift has its own code. Odds
  of a hundred against white noise are required. White noise reaches them in at most one stretch of
  a hundred (Markov's inequality). All others keep the batch means' number to the last bit.
* The error of the mean is the weighted geometric mean of the estimates by each time and share, from
  contrasts with a constant.
* Where the time is rather more than a quarter of the record than less, a record cannot distinguish
  it from longer ones. Then the error is at least that of the longest, a guess on the large side.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from nearlift.declare import FloatArray

#: Segments of half a batch that a record is cut into for the second look.
SEGMENTS = 64
#: Fewer means tell nothing of slow noise.
FEWEST_MEANS = 10
#: Correlation times over the record's length, each believed beforehand the less, by the root, the
#: longer; and shares of a batch mean's variance that the slow noise has.
TIMES = tuple(0.5**k for k in range(7))
SHARES = (0.25, 0.5, 0.75, 0.9, 1.0)
#: Correlation time over the record's length that the first look is keenest on, and the standard
#: deviations of white noise that let one record in forty through (of 40 000 drawn, 2.3 % of those
#: of 31 means, 2.6 % of those of 63 and 127).
TYPICAL_TIME, LET_THROUGH = 1 / 30, 1.85
#: Odds against white noise from which on slow noise is believed.
ODDS = 100.0
#: Correlation time over the record's length from which on one record does not determine the error
#: of its mean.
TOO_LONG = 0.25
#: Hann windows over white noise: correlation of neighbours that overlap by half, and spectral
#: density per half batch over the variance of a mean.
OVERLAP, WHITE = 1 / 6, 4 / 3
#: Degrees of the polynomials that are subtracted: of the level, and of a drift.
CONSTANT, LINE = 0, 1
#: Beyond it an exponential overflows.
LARGEST_LOG = 700.0
#: Points that half a window is integrated by.
POINTS = 16


class SlowNoise(NamedTuple):
    """Variance of the record's mean, N^2, and whether noise lasts a quarter of it or more."""

    variance: float
    is_too_long: bool


def suspected(means: FloatArray) -> bool:
    """First look at a record's batch means, a microsecond long: may far neighbours be alike?"""
    if len(means) < FEWEST_MEANS:
        return False
    form = _first_look(len(means))
    return bool(form.dot(means).dot(means) < 0.0)


def slow_noise(means: FloatArray) -> SlowNoise | None:
    """Error of the mean by slow noise; None where white noise suffices.

    `means` (m,) are of successive batches with a Hann window that overlap by half and cover the
    record.
    """
    if not suspected(means):
        return None
    if np.exp(_weigh(means, LINE)[0]).mean() < ODDS:
        return None
    log_odds, variances = _weigh(means, CONSTANT)
    weights = np.exp(log_odds - log_odds.max()) / np.sqrt(TIMES)[:, None]
    weights /= weights.sum()
    # its distribution has a long tail: the geometric mean is near its median
    variance = math.exp((weights * np.log(variances)).sum())
    is_too_long = bool(weights[np.array(TIMES) >= TOO_LONG].sum() > 0.5)
    if is_too_long:
        variance = max(variance, float((weights[0] * variances[0]).sum() / weights[0].sum()))
    return SlowNoise(variance, is_too_long)


def _weigh(means: FloatArray, degree: int) -> tuple[FloatArray, FloatArray]:
    """Log odds against white noise, and variance of the record's mean: (times, shares) each."""
    space = _space(len(means), degree)
    contrasts = space.white @ means
    dof = len(contrasts)
    squares = np.add.reduce((contrasts @ space.axes)[:, None, :] ** 2 / space.variances, axis=-1)
    log_odds = -0.5 * (dof * np.log(squares / (contrasts @ contrasts)) + space.log_determinants)
    return np.minimum(log_odds, LARGEST_LOG), squares / dof * space.of_mean


class _Space(NamedTuple):
    """Contrasts of `m` means with a polynomial, `c` of them, and what slow noise is there.

    `white` (c, m) makes contrasts of means. They have unit covariance where noise is white and a
    batch mean's variance is one. Along `axes` (times, c, c), orthonormal columns, slow noise of
    each time is uncorrelated. `variances` (times, shares, c) are those along the axes.
    `log_determinants` (times, shares) is the log of their product, `of_mean` the variance of the
    record's mean.
    """

    white: FloatArray
    axes: FloatArray
    variances: FloatArray
    log_determinants: FloatArray
    of_mean: FloatArray


@functools.lru_cache(maxsize=64)
def _space(m: int, degree: int) -> _Space:
    white, share, segments = _whitener(m, degree), np.array(SHARES), m + 1
    axes, variances, of_mean = [], [], []
    for time in TIMES:
        row, mean = _exponential(m, segments * time)
        along, directions = _along(white, row)
        axes.append(directions)
        variances.append(1 - share[:, None] + share[:, None] * along)
        of_mean.append((1 - share) * WHITE / segments + share * mean)
    determinants = np.log(variances).sum(axis=-1)
    return _Space(white, np.array(axes), np.array(variances), determinants, np.array(of_mean))


@functools.lru_cache(maxsize=64)
def _first_look(m: int) -> FloatArray:
    """Quadratic form (m, m) that is negative where means indicate slow noise.

    One white record in forty makes it negative.

    It is the ratio of their squares, weighed for slow noise and for white. Its mean under white
    noise is subtracted, and `LET_THROUGH` of its standard deviations there added. Both are exact.
    """
    white = _whitener(m, LINE)
    along, axes = _along(white, _exponential(m, (m + 1) * TYPICAL_TIME)[0])
    precision = 1 / along
    spread = math.sqrt(2 * float(precision.var()) / (len(along) + 2))
    form: FloatArray = (
        white.T @ ((axes * (precision - precision.mean() + LET_THROUGH * spread)) @ axes.T) @ white
    )
    return form


def _whitener(m: int, degree: int) -> FloatArray:
    """From means to contrasts with a polynomial, white for white noise; (m - 1 - degree, m)."""
    basis = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, m), degree + 1), mode="complete")[0]
    contrasts = basis[:, degree + 1 :]
    # neighbours share half their samples
    row = np.zeros(m)
    row[:2] = 1.0, OVERLAP
    return np.asarray(
        np.linalg.solve(np.linalg.cholesky(contrasts.T @ _toeplitz(row) @ contrasts), contrasts.T)
    )


def _along(white: FloatArray, row: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Variances of the contrasts along their principal axes, and the axes."""
    variances, axes = np.linalg.eigh(white @ _toeplitz(row) @ white.T)
    return variances, axes


def _exponential(m: int, length: float) -> tuple[FloatArray, float]:
    """Covariances of a batch mean with the ones after it, and the variance of the record's mean.

    For noise with a correlation time of `length` half batches; in units of a batch mean's variance.
    """
    at = (np.arange(2 * POINTS) + 0.5) / POINTS
    window = np.sin(np.pi * at / 2) ** 2
    window /= window.sum()
    near = [
        float(window @ np.exp(-np.abs(at[:, None] - at - lag) / length) @ window)
        for lag in range(3)
    ]
    # windows two apart have no sample in common
    row = np.concatenate([near[:2], near[2] * np.exp(-np.arange(m - 2) / length)])
    part = length / (m + 1)
    return row / near[0], 2 * part * (1 + part * math.expm1(-1 / part)) / near[0]


def _toeplitz(row: FloatArray) -> FloatArray:
    places = np.arange(len(row))
    matrix: FloatArray = row[np.abs(places[:, None] - places)]
    return matrix
