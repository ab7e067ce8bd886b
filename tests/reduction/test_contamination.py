"""A step is distinguished from noise and from a drift, by batch means."""

from __future__ import annotations

import numpy as np
import pytest

from nearlift.declare import FloatArray
from nearlift.reduction.contamination import stepped

NOISE: FloatArray = 0.01 * np.random.default_rng(4).standard_normal(16)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("at", [4, 8, 12])
def test_two_levels_are_a_step_where_it_is_more_than_is_allowed(at: int, sign: float) -> None:
    levels = NOISE + sign * (np.arange(16) >= at)
    assert stepped(levels, 0.9)
    assert not stepped(levels, 1.1)
    assert not stepped(NOISE, 0.0)


def test_a_drift_however_strong_is_no_step() -> None:
    assert not stepped(NOISE + np.linspace(0.0, 5.0, 16), 0.1)
    # nor is what begins or ends within a batch or two of an end
    assert not stepped(NOISE + (np.arange(16) >= 15), 0.1)
