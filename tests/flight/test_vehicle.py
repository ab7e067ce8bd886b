"""Dimensionless groups of the paper, and gains that fly."""

from __future__ import annotations

import math

import pytest

from nearlift.errors import ManifestError
from nearlift.flight.paper import CEILING_GAINS, CRAZYFLIE_AS_PRINTED, DISTURBANCE, GAINS
from nearlift.flight.vehicle import Gains, dimensionless, poles, refuse_unstable


def test_groups_are_the_paper_s():
    groups = dimensionless(CRAZYFLIE_AS_PRINTED, CEILING_GAINS, DISTURBANCE, 120.0)
    scale = 4 * 1.6 * 1.2 / 0.027
    assert groups.alpha == pytest.approx(316 * math.sqrt(scale * 0.023**6 / 9.8))
    assert groups.beta == pytest.approx(316 * math.sqrt(scale * 0.023**5))
    assert groups.gamma == pytest.approx(31.6 * math.sqrt(scale * 0.023**7 / 9.8**2))
    assert (groups.delta, round(groups.hold, 2)) == (1.0, 2.06)
    back = groups.gains(CRAZYFLIE_AS_PRINTED)
    assert (back.kP, back.kD, back.kI) == pytest.approx((316, 316, 31.6))


@pytest.mark.parametrize(
    ("gains", "boundary", "words"),
    [
        (
            CEILING_GAINS,
            "ground",
            r"simulate.gains.ground: kP = 316.*unstable loop.*too low must turn.*\n.*negative",
        ),
        (
            GAINS["ground"],
            "ceiling",
            r"simulate.gains.ceiling.*too close must slow its rotors\n.*positive",
        ),
        (Gains(kP=-316, kD=316, kI=-31.6), "ground", "want one sign"),
        (Gains(kP=0, kD=-316, kI=0), "ground", "without both"),
    ],
)
def test_unstable_gains_are_refused_with_the_reason(gains, boundary, words):
    with pytest.raises(ManifestError, match=words):
        refuse_unstable(gains, CRAZYFLIE_AS_PRINTED, boundary)


def test_the_paper_s_gains_are_stable_with_the_right_sign():
    for boundary, gains in GAINS.items():
        refuse_unstable(gains, CRAZYFLIE_AS_PRINTED, boundary)
    assert sorted(poles(CEILING_GAINS, CRAZYFLIE_AS_PRINTED, "ceiling").real) == pytest.approx(
        [-16.6, -0.945, -0.113], abs=0.05
    )
