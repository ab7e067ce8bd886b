"""A clock that jitters: the rate of a short piece is not refused for it, that of a whole record is."""

from __future__ import annotations

import numpy as np
import pytest

from nearlift.errors import InputRefused
from nearlift.reduction.samples import Conditions, clock_codes


@pytest.mark.parametrize("samples", [12, 20])
def test_a_piece_may_be_off_by_less_than_a_sample(samples):
    time_s = np.arange(samples) * 1.04 / 8.0
    assert clock_codes(time_s, Conditions(rate_Hz=8.0), "r0") == []
    with pytest.raises(InputRefused, match="runs at"):
        clock_codes(np.arange(samples) * 2 / 8.0, Conditions(rate_Hz=8.0), "r0")


def test_a_record_may_not():
    with pytest.raises(InputRefused, match="runs at"):
        clock_codes(np.arange(200) * 1.04 / 8.0, Conditions(rate_Hz=8.0), "r0")
