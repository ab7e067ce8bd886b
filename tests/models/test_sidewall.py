"""Laws of the sidewall models."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nearlift.models.sidewall import SIDEWALL_DECAY, SIDEWALL_POWER_LAW

gap = st.floats(0.01, 20)


@given(z=gap, shift=st.floats(-0.5, 0.5), a=st.floats(0.01, 0.3), lambda_=st.floats(0.2, 5))
def test_datum_error_is_absorbed_by_the_amplitude(z, shift, a, lambda_):
    shifted = SIDEWALL_DECAY(z + shift, a=a, lambda_=lambda_)
    assert float(shifted) == pytest.approx(
        float(SIDEWALL_DECAY(z, a=a * np.exp(-shift / lambda_), lambda_=lambda_)), rel=1e-12
    )


@given(z=gap, a=st.floats(-0.5, 0.9))
def test_sign_of_the_amplitude_is_the_sign_of_the_loss(z, a):
    for model in (SIDEWALL_DECAY, SIDEWALL_POWER_LAW):
        loss = 1 - float(model(z, a=a))
        assert loss * a >= 0
        assert abs(loss) <= abs(a) + np.finfo(float).eps
