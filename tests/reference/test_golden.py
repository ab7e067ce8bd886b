"""Golden values: numbers worked out once from the published formulae, to the digits printed."""

import math

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.models.empirical import HAYDEN
from nearlift.models.images import square
from nearlift.models.momentum import HSIAO_CHIRARATTANANON, HSIAO_CHIRARATTANANON_CONSTANT_POWER

R = 23.0  # mm
GROUND_Z = (0.5, 1.0, 1.14, 1.5, 2.0, 2.48, 3.0, 4.0, 5.0)
GROUND = {
    "Cheeseman-Bennett": (
        "cheeseman_bennett_fixed",
        {},
        (1.3333, 1.0667, 1.0505, 1.0286, 1.0159, 1.0103, 1.0070, 1.0039, 1.0025),
    ),
    "as printed, l = 90 mm": (
        "sanchez_cuevas_as_printed",
        {"spacing_hat": 90 / R},
        (1.3530, 1.0866, 1.0708, 1.0487, 1.0342, 1.0261, 1.0203, 1.0133, 1.0093),
    ),
    "original, d = 90 mm": (
        "sanchez_cuevas",
        {"spacing_hat": 90 / R, "diagonal_hat": math.sqrt(2) * 90 / R},
        (1.3703, 1.1066, 1.0921, 1.0722, 1.0585, 1.0495, 1.0416, 1.0300, 1.0221),
    ),
    "original form, b = d = 90 mm": (
        "sanchez_cuevas",
        {"spacing_hat": 90 / R, "diagonal_hat": 90 / R},
        (1.4072, 1.1414, 1.1263, 1.1030, 1.0821, 1.0665, 1.0532, 1.0356, 1.0250),
    ),
    "original, Crazyflie 65 / 92 mm": (
        "sanchez_cuevas",
        {"spacing_hat": 65 / R, "diagonal_hat": 92 / R},
        (1.4299, 1.1586, 1.1422, 1.1151, 1.0898, 1.0714, 1.0562, 1.0369, 1.0256),
    ),
    "images only, d = 90 mm": (
        "images",
        {"layout_hat": square(90 / R)},
        (1.3495, 1.0831, 1.0673, 1.0453, 1.0311, 1.0236, 1.0182, 1.0119, 1.0083),
    ),
}
CEILING_Z = (0.05, 0.10, 0.15, 0.20, 0.30, 0.50, 0.70, 1.0, 2.0)


@pytest.mark.parametrize("row", GROUND)
def test_ground_table(row):
    name, known, table = GROUND[row]
    np.testing.assert_allclose(catalogue.model(name)(np.array(GROUND_Z), **known), table, atol=6e-5)


def test_ceiling_table():
    z = np.array(CEILING_Z)
    np.testing.assert_allclose(
        HSIAO_CHIRARATTANANON(z),
        (4.071, 2.337, 1.780, 1.516, 1.273, 1.112, 1.060, 1.030, 1.008),
        atol=6e-4,
    )
    constant_power = (2.549, 1.761, 1.469, 1.319, 1.174, 1.074, 1.040, 1.020, 1.005)
    np.testing.assert_allclose(HSIAO_CHIRARATTANANON_CONSTANT_POWER(z), constant_power, atol=6e-4)


def test_hayden_tends_to_less_than_one():
    assert float(HAYDEN(np.inf)) == pytest.approx(0.9951, abs=6e-5)
