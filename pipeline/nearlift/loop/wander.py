"""A gain that wanders at random in the course of a campaign: what stands against every name whose
mark is a change with time.

Its columns are cosines along the run order whose size falls as in the Karhunen-Loeve expansion of a
random walk; one size for all, the likeliest, for which an explanation pays as for any unknown.
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.subspace import cosines, left_singular
from nearlift.likelihood.variance_components import ENOUGH
from nearlift.results import Observations

#: Cosines at most: the rest of a random walk is noise that neighbours share.
WAVES = 40
#: Sizes that are tried, as a fraction of lift: standard deviation of the slowest cosine.
SIZES = np.geomspace(1e-4, 2e-2, 16)


def waves(data: Observations) -> FloatArray:
    """Columns (n, k) of log lift of unit size; none where the order of the trials is unknown or
    visits are too few to tell.
    """
    visits = len(np.unique(data.visit))
    if not data.ordered or visits < ENOUGH:
        return np.zeros((data.n, 0))
    count = min(WAVES, visits // 2)
    return cosines(data.covariates["run_order"], count) / np.arange(1, count + 1)


def rms(data: Observations, size: float) -> float:
    """Root mean square of a wander of this size over the trials, a fraction of lift."""
    return size * float(np.sqrt(np.mean(np.sum(waves(data) ** 2, axis=1))))


def price(size: float, n: int) -> float:
    """What a wander of this size costs in log evidence beside `n` trials, by unit information."""
    return 0.5 * float(np.log(n)) * (size > 0)


def likeliest(scores: FloatArray, columns: FloatArray, n: int) -> float:
    """The likeliest size beside `n` trials; 0 where none is worth its price.

    Parameters
    ----------
    scores : (d,)
        What is left, unit noise.
    columns : (d, k)
        `waves` in the same space.
    """
    gain = _gain(scores[:, None], columns)[:, 0]
    best = int(np.argmax(gain))
    return float(SIZES[best]) if gain[best] > price(SIZES[best], n) else 0.0


def worth(scores: FloatArray, columns: FloatArray, n: int) -> FloatArray:
    """What the likeliest wander adds to the log evidence of each of m draws, its price paid; (m,),
    0 where it is not worth it. `scores` is (d, m).
    """
    most = np.max(_gain(scores, columns), axis=0)
    return np.asarray(np.maximum(most - price(SIZES[0], n), 0.0))


def _gain(scores: FloatArray, columns: FloatArray) -> FloatArray:
    """Log likelihood of scores (d, m) with a wander of each of `SIZES` over that without; (sizes,
    m).
    """
    u, lengths = left_singular(columns)
    variance = np.square(np.outer(SIZES, lengths))
    explained = variance / (1 + variance) @ (u.T @ scores) ** 2
    return np.asarray(0.5 * (explained - np.log1p(variance).sum(axis=1, keepdims=True)))
