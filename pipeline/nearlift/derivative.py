"""Derivatives by central differences: the one scheme of the package.

The error of a central difference is f''' h^2 / 6 by truncation and 1e-16 f / h by rounding. With
the relative step `STEP` both are below 1e-8 of a smooth model's derivative (Press et al. 2007,
Numerical Recipes, 3rd ed., section 5.7).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
#: Step relative to the size of an argument.
STEP = 1e-4


def central(
    f: Callable[[FloatArray], FloatArray],
    x: FloatArray,
    size: FloatArray | float,
    low: FloatArray | float = -np.inf,
    high: FloatArray | float = np.inf,
    moved: NDArray[np.bool_] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Differences of `f` at x (..., p) and the distances between the points, in one call of `f`.

    Parameters
    ----------
    f : callable
        From (..., p) to (..., n).
    size : (..., p)
        Typical size of each entry; a step is `STEP` of it, shorter at a bound.
    low, high : (p,)
    moved : (g, p) bool, optional
        Entries that move together; each moves alone if not given.

    Returns
    -------
    (..., g, n), (..., p) array
    """
    up, down = np.minimum(x + STEP * size, high), np.maximum(x - STEP * size, low)
    each = np.eye(x.shape[-1], dtype=bool) if moved is None else moved
    ends = [np.where(each, end[..., None, :], x[..., None, :]) for end in (up, down)]
    above, below = f(np.stack(ends))
    return above - below, up - down


def at_zero(f: Callable[[float], FloatArray]) -> FloatArray:
    """Derivative at 0 of a function of one number of unit size, such as a relative change."""
    return np.asarray((f(STEP) - f(-STEP)) / (2 * STEP), dtype=np.float64)
