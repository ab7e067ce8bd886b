"""Lift gained from the inflow that images cancel: the common part of all image models.

A boundary mirrors each rotor. Seen from above, the mirrored rotor is a source whose flow opposes
the induced inflow at the real one. All images together cancel the fraction `s` of the inflow; the
lift ratio is 1 / (1 - s).

Lengths are scaled by rotor radius. A rotor plane on or behind the boundary has no lift ratio: nan,
never a wrong number. Written in 1/height, so that a height of infinity (free air) gives exactly no
image and a ratio of exactly 1.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nearlift.declare import Check, FloatArray


def clear_of_boundary(z_hat: Any) -> FloatArray:
    """`z_hat` as an array, nan where it is not positive."""
    z = np.asarray(z_hat, dtype=float)
    result: FloatArray = np.where(z > 0, z, np.nan)
    return result


def image(height_hat: Any, separation_hat: Any = 0.0) -> Any:
    """Fraction of a rotor's induced inflow cancelled by one image, positive where lift is gained.

    Shapes broadcast. Approximation: a point source at the image's centre of strength (rotor area) x
    (induced velocity). Its velocity is taken at the rotor's centre, along the boundary's normal.

    Parameters
    ----------
    height_hat : array_like
        Distance between rotor and image along the boundary's normal: 2 z_hat for a flat boundary.
    separation_hat : array_like
        Their distance along the boundary: 0 for a rotor's own image.
    """
    height = np.asarray(height_hat, dtype=float)
    slant = 1.0 + np.square(separation_hat / height)
    return 0.25 / (np.square(height) * slant * np.sqrt(slant))


def gain(cancelled: Any) -> FloatArray:
    """Lift over lift far away, 1 / (1 - s); nan at and beyond the pole s = 1, where the theory has
    no answer.
    """
    left = 1.0 - np.asarray(cancelled, dtype=float)
    result: FloatArray = np.divide(1.0, left, out=np.full(left.shape, np.nan), where=left > 0)
    return result


def tabulated(*rows: tuple[float, float, Mapping[str, Any], str]) -> tuple[Check, ...]:
    """Checks against a table of four decimals: z_hat, the ratio there, the arguments, and who
    quoted it.
    """
    return tuple(
        Check(x=z_hat, expected=ratio, arguments=given, tolerance=5e-5, quoted_by=by)
        for z_hat, ratio, given, by in rows
    )
