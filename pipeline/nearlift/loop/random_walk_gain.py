"""Random-walk gain: the nuisance that rivals every effect whose signature is a change with time.

Its columns are cosines along the run order, with the amplitudes of the Karhunen-Loeve expansion of
a random walk. All share one size, fitted by maximum likelihood and charged as one unknown.
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.likelihood.subspace import cosines
from nearlift.likelihood.variance_components import MIN_REVISITS
from nearlift.results import Observations

#: Largest number of cosines; the rest of a random walk is noise that neighbours share.
WAVES = 40
#: Grid of sizes: standard deviation of the slowest cosine, as a fraction of lift.
SIZES = np.geomspace(1e-4, 2e-2, 16)


def waves(data: Observations) -> FloatArray:
    """Columns (n, k) of log lift of unit size.

    k is 0 where the order of the trials is unknown or visits are fewer than `MIN_REVISITS`.
    """
    visits = len(np.unique(data.visit))
    if not data.ordered or visits < MIN_REVISITS:
        return np.zeros((data.n, 0))
    count = min(WAVES, visits // 2)
    return cosines(data.covariates["run_order"], count) / np.arange(1, count + 1)


def bic_penalty(size: float, n: int) -> float:
    """Penalty in log evidence for the size, by unit information: ln(n) / 2, or 0 for size 0."""
    return 0.5 * float(np.log(n)) * (size > 0)


def likeliest(scores: FloatArray, columns: FloatArray, n: int) -> float:
    """Maximum-likelihood size; 0 where its gain in log likelihood is below its `bic_penalty`.

    `scores` (d,) are the residual in units of the noise, `columns` (d, k) `waves` in the same
    space.
    """
    gain = _gain(scores[:, None], columns)[:, 0]
    best = int(np.argmax(gain))
    return float(SIZES[best]) if gain[best] > bic_penalty(SIZES[best], n) else 0.0


def log_evidence_gain(scores: FloatArray, columns: FloatArray, n: int) -> FloatArray:
    """Gain in log evidence by the likeliest size, net of its `bic_penalty`, (m,), not below 0.

    `scores` (d, m) are draws of the residual.
    """
    most = np.max(_gain(scores, columns), axis=0)
    return np.asarray(np.maximum(most - bic_penalty(SIZES[0], n), 0.0))


def _gain(scores: FloatArray, columns: FloatArray) -> FloatArray:
    """Log likelihood ratio of scores (d, m) for each of `SIZES`; (sizes, m)."""
    squares, turn = np.linalg.eigh(columns.T @ columns)
    size2 = SIZES[:, None] ** 2
    variance = size2 * np.maximum(squares, 0.0)
    explained = size2 / (1 + variance) @ (turn.T @ (columns.T @ scores)) ** 2
    return np.asarray(0.5 * (explained - np.log1p(variance).sum(axis=1, keepdims=True)))
