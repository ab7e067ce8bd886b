"""Coordinates of a subspace that do not hang on rounding."""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray


def framed(basis: FloatArray) -> FloatArray:
    """The orthonormal basis (n, d) of the same span that a fixed set of directions picks.

    Which of the many a factorisation gives is rounding's choice where columns tie; what is drawn in
    their coordinates must not depend on that.
    """
    toward = np.random.default_rng(0).standard_normal(basis.shape)
    q, r = np.linalg.qr(basis.T @ toward)
    result: FloatArray = basis @ (q * np.where(np.diag(r) < 0, -1.0, 1.0))
    return result
