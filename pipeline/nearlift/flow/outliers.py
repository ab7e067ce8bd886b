"""Spurious vectors in an instantaneous field: the normalised median test of Westerweel and Scarano
(2005).
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from nearlift.declare import FloatArray

#: What a component's residual is divided by at least: this share of the field's own typical
#: residual.
FLOOR = 1.0
#: Of a pixel's eight neighbours at least so many must have a vector.
ENOUGH = 4


def spurious(vx: FloatArray, vy: FloatArray, threshold: float) -> NDArray[np.bool_]:
    """Vectors (ny, nx) that deviate from the median of their neighbours.

    The limit is `threshold` times the scatter of those neighbours.

    The scatter has a floor, the field's median scatter. The usual floor of 0.1 pixel needs a pixel
    size, which exported fields seldom state. Nodes with fewer than four neighbours are not tested.
    """
    bad = np.zeros(vx.shape, dtype=bool)
    if threshold <= 0:
        return bad
    total = np.zeros(vx.shape)
    for v in (vx, vy):
        windows = sliding_window_view(np.pad(v, 1, constant_values=np.nan), v.shape)
        around = np.delete(windows.reshape(9, *v.shape), 4, axis=0)
        middle = _median(around)
        scatter = _median(np.abs(around - middle))
        enough = np.isfinite(around).sum(axis=0) >= ENOUGH
        typical = np.nanmedian(scatter[enough]) if (enough & np.isfinite(scatter)).any() else 0.0
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.abs(v - middle) / (scatter + FLOOR * typical)
        total += np.where(enough & np.isfinite(ratio), ratio, 0.0) ** 2
    return np.asarray(np.sqrt(total) > threshold) & np.isfinite(vx)


def _median(stack: FloatArray) -> FloatArray:
    """Median along the first axis of what is there: of eight sorted neighbours, where nan sorts
    last.
    """
    ordered = np.sort(stack, axis=0)
    count = np.isfinite(ordered).sum(axis=0)
    low = np.maximum((count - 1) // 2, 0)
    high = np.minimum(count // 2, stack.shape[0] - 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        middle = 0.5 * (
            np.take_along_axis(ordered, low[None], 0)[0]
            + np.take_along_axis(ordered, high[None], 0)[0]
        )
    return np.where(count > 0, middle, np.nan)
