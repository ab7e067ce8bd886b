"""Random numbers that are addressed, not drawn: the n-th normal of a (key, flight) is a function of its address alone.

splitmix64 (Steele, Lea and Flood 2014) scrambles ``key + n * golden``; two of its outputs make two normals by Box and Muller's
transform, which is exact. So a flight meets the same gusts in whatever order, block or thread it is flown, at every set-point
and with every model (common random numbers), and when the step of integration is halved.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np

from nearlift.declare import FloatArray

U = np.uint64
GOLDEN, MIX_1, MIX_2 = U(0x9E3779B97F4A7C15), U(0xBF58476D1CE4E5B9), U(0x94D049BB133111EB)
THIRTY, TWENTY_SEVEN, THIRTY_ONE, ELEVEN, ONE = U(30), U(27), U(31), U(11), U(1)
#: Upper 53 bits to the open interval (0, 1): half a step off either end, so that its logarithm is finite.
STEP = 2.0**-53


def compiled(function: Any, **how: Any) -> Any:
    """The function compiled and cached on disk, or only compiled where no cache folder can be written."""
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy", **how)(function)
    except RuntimeError:
        return numba.njit(nogil=True, error_model="numpy", **how)(function)


def _mix(x: Any) -> Any:
    """splitmix64's scrambler, a bijection of 64 bits."""
    x = (x ^ (x >> THIRTY)) * MIX_1
    x = (x ^ (x >> TWENTY_SEVEN)) * MIX_2
    return x ^ (x >> THIRTY_ONE)


mix = compiled(_mix, inline="always")


def _fill(key: Any, flight: Any, out: Any) -> None:
    """Standard normals 0, 1, ... of one flight."""
    start = mix(U(key) + mix(U(flight) * GOLDEN + ONE))
    pairs = (out.size + 1) // 2
    for i in range(pairs):
        at = start + U(2 * i) * GOLDEN
        radius = math.sqrt(-2.0 * math.log((float(mix(at) >> ELEVEN) + 0.5) * STEP))
        angle = 2.0 * math.pi * (float(mix(at + GOLDEN) >> ELEVEN) + 0.5) * STEP
        out[2 * i] = radius * math.cos(angle)
        if 2 * i + 1 < out.size:
            out[2 * i + 1] = radius * math.sin(angle)


fill = compiled(_fill)


def normals(key: int, flight: int, n: int) -> FloatArray:
    """The first `n` standard normals of a flight: shape (n,), the same for ever, on every machine to the last digits of log and cos."""
    out = np.empty(n)
    fill(U(key), U(flight), out)
    return out
