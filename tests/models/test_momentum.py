"""Laws of the ceiling models: gamma derived again, its limits, and what a constant-rpm rotor makes
of it.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from nearlift.models.empirical import CEILING_EMPIRICAL
from nearlift.models.images import CHEESEMAN_BENNETT
from nearlift.models.momentum import (
    HSIAO_CHIRARATTANANON,
    HSIAO_CHIRARATTANANON_CONSTANT_POWER,
    HSIAO_CHIRARATTANANON_FREE_EXPONENT,
    gamma,
)

height = st.floats(0.02, 30)
coefficient = st.floats(0, 4)


@given(z=height)
def test_gamma_solves_the_momentum_balance(z):
    """Far-wake speed v_e and disk speed v_i: v_e^2 - 2 v_i v_e - v_i^2 / (8 z^2) = 0, and gamma =
    v_e / (2 v_i).
    """
    v_i = 1.0
    v_e = brentq(lambda v: v**2 - 2 * v_i * v - v_i**2 / (8 * z**2), 1.9, 1e4)
    assert float(gamma(z, 0.125)) == pytest.approx(v_e / (2 * v_i), rel=1e-9)


@given(z=height, alpha=coefficient)
def test_gamma_is_one_without_a_ceiling_and_grows_with_it(z, alpha):
    assert float(gamma(z, 0.0)) == 1.0
    assert 1.0 <= float(gamma(1.01 * z, alpha)) <= float(gamma(z, alpha))


def test_gammas_limits():
    alpha = 0.125
    assert float(gamma(1e3, alpha)) - 1 == pytest.approx(alpha / 4 / 1e6, rel=1e-3)
    assert float(gamma(1e-4, alpha)) == pytest.approx(0.5 * math.sqrt(alpha) / 1e-4 + 0.5, rel=1e-6)


def test_negative_coefficient_has_no_value_where_the_root_has_none():
    assert np.isnan(gamma(0.5, -0.3))
    assert np.isfinite(gamma(0.6, -0.3))


@given(z=height, alpha=coefficient, n=st.floats(0.1, 2))
def test_held_quantity_is_the_exponent(z, alpha, n):
    one = float(HSIAO_CHIRARATTANANON(z, alpha=alpha))
    assert float(HSIAO_CHIRARATTANANON_CONSTANT_POWER(z, alpha=alpha)) == pytest.approx(
        one ** (2 / 3), rel=1e-12
    )
    assert float(HSIAO_CHIRARATTANANON_FREE_EXPONENT(z, alpha=alpha, n=n)) == pytest.approx(
        one**n, rel=1e-12
    )


@given(z=height, alpha=coefficient)
def test_downwash_is_what_power_needs_at_the_same_thrust(z, alpha):
    assert float(HSIAO_CHIRARATTANANON.downwash(z, alpha=alpha)) * float(
        gamma(z, alpha)
    ) == pytest.approx(1.0, rel=1e-12)


def thrust_at_constant_rpm(g: float, solidity_lift_slope: float, C_T: float = 0.02054) -> float:
    """Thrust over thrust far away of a blade-element rotor whose induced power ratio is `g`, at
    constant rpm and pitch.

    C_T = (sigma a / 2) (theta / 3 - lambda / 2), lambda = sqrt(C_T / 2) / g; C_T is a hovering
    Crazyflie's (66.2 mN a rotor, r = 23 mm, 278 Hz, 1.2 kg/m^3), which sets theta.
    """
    half = solidity_lift_slope / 2
    pitch = C_T / half + math.sqrt(C_T / 2) / 2
    return brentq(lambda c: half * (pitch - math.sqrt(c / 2) / (2 * g)) - c, 1e-6, 1.0) / C_T


def test_hovering_rotor_coefficient():
    tip = 2 * math.pi * 278 * 0.023
    assert 0.0662 / (1.2 * math.pi * 0.023**2 * tip**2) == pytest.approx(0.02054, rel=2e-3)


@pytest.mark.parametrize(
    ("solidity_lift_slope", "table", "saturation"),
    [
        (0.9, (1.748, 1.523, 1.378, 1.281, 1.167, 1.075, 1.041, 1.021, 1.006), 2.11),
        (1.14, (1.925, 1.636, 1.453, 1.334, 1.197, 1.088, 1.048, 1.025, 1.006), 2.40),
    ],
)
def test_constant_rpm_saturates_without_viscosity(solidity_lift_slope, table, saturation):
    z = (0.05, 0.10, 0.15, 0.20, 0.30, 0.50, 0.70, 1.0, 2.0)
    got = [thrust_at_constant_rpm(float(gamma(x, 0.125)), solidity_lift_slope) for x in z]
    np.testing.assert_allclose(got, table, atol=2e-3)
    assert thrust_at_constant_rpm(1e9, solidity_lift_slope) == pytest.approx(saturation, abs=0.01)


@pytest.mark.parametrize("solidity_lift_slope", [0.75, 1.14])
def test_exponent_at_constant_rpm_lies_below_the_papers(solidity_lift_slope):
    exponent = math.log(thrust_at_constant_rpm(1.1, solidity_lift_slope)) / math.log(1.1)
    assert 0.55 < exponent < 0.85
    near = math.log(thrust_at_constant_rpm(2.3, solidity_lift_slope)) / math.log(2.3)
    assert near < exponent  # it falls as the gain grows


def test_empirical_form_is_a_shifted_image():
    z = np.linspace(0.3, 5, 20)
    np.testing.assert_allclose(
        CEILING_EMPIRICAL(z, c=1 / 16, e=0.0), CHEESEMAN_BENNETT(z, k=1.0), rtol=1e-12
    )
    np.testing.assert_allclose(
        CEILING_EMPIRICAL(z, c=0.3, e=0.5),
        CEILING_EMPIRICAL(z + 0.5, c=0.3, e=0.0),
        rtol=1e-12,
    )


def test_empirical_form_is_refused_below_its_pole():
    assert np.isnan(CEILING_EMPIRICAL(0.09, c=0.04, e=0.1))
    assert np.isfinite(CEILING_EMPIRICAL(0.11, c=0.04, e=0.1))
    assert np.isfinite(CEILING_EMPIRICAL(1e-6, c=0.04, e=0.25))
