"""Stations of the paper's Table 1, read as hundredths of a rotor diameter.

Table 1 of Carter, Bouchard and Quinn 2021 prints distances to 577 "cm" for a traverse in a room of
1.5 m. Read as hundredths of a rotor diameter (0.46 mm) it meets every claim of the text but one.
Nothing lies between z_hat = 2.84 and 11.5 above the ground. The text says that the ground matters
to 4. Read as millimetres it begins at z_hat = 2.48, too far for the gains that the paper reports.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from nearlift.declare import Boundary, FloatArray

#: As printed, boundary to numbers. Ground less ceiling is 52 or 53 in every row, sidewall less
#: ceiling 10 or 11: one list of commands.
TABLE_1: Mapping[Boundary, tuple[int, ...]] = {
    "ceiling": (5, 6, 7, 8, 9, 10, 11, 12, 14, 15, 18, 22, 25, 29, 34, 38, 55, 68, 90, 525),
    "ground": (57, 58, 59, 60, 61, 62, 63, 64, 66, 68, 70, 74, 77, 82, 86, 90, 108, 121, 142, 577),
    "sidewall": (15, 16, 17, 18, 19, 21, 22, 23, 24, 26, 28, 32, 35, 40, 44, 48, 66, 79, 101, 535),
}
PERCENT_DIAMETER_M = 0.46e-3


def stations_m(boundary: Boundary) -> FloatArray:
    """Rotor plane (sidewall: nearest blade tip) to boundary at each station, m, nearest first."""
    return np.array(TABLE_1[boundary], dtype=float) * PERCENT_DIAMETER_M
