"""Linear maps of rows some of which have no value.

BLAS kernels differ in their results for inf and nan, so such rows never reach them.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nearlift.declare import FloatArray


def where_finite(linear: Callable[[FloatArray], FloatArray], x: FloatArray) -> FloatArray:
    """`linear` of `x` row by row, (..., n) to (..., m); nan throughout where a row holds inf or
    nan.
    """
    whole = np.isfinite(x).all(axis=-1, keepdims=True)
    if whole.all():
        return linear(x)
    return np.where(whole, linear(np.where(whole, x, 0.0)), np.nan)
