"""The start of the rotors in a record, and a converter's counter that wraps."""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit import sweeps

from nearlift.reduction.start import start_of, wrap_of


@pytest.mark.parametrize(
    ("rest", "rise", "rate"), [(1.0, 0.0, 80), (1.0, 0.1, 80), (0.5, 0.02, 1000), (2.0, 0.2, 10)]
)
def test_the_start_of_the_rotors_is_measured(rest: float, rise: float, rate: float) -> None:
    _, force = sweeps.started(rest, rise, rate, 1, 8.0)
    force[5] = 8e6
    found = start_of(force, rate)
    assert found is not None
    assert abs(found.rest_ends / rate - rest) <= max(0.11 * rise, 1 / rate) + 1 / rate
    assert found.steady_from / rate >= rest + 1.8 * rise
    assert found.steady_from / rate <= rest + 5 * rise + 2 / rate
    assert start_of(force[round(rest * rate) + round(rise * rate * 8) :], rate) is None


def test_a_counter_that_wraps_is_said_and_no_other_step() -> None:
    _, force = sweeps.started(1.0, 0.0, 80, 2)
    assert wrap_of(force) is None
    wrapped = np.where(np.arange(len(force)) >= 120, force - 39946, force)
    assert wrap_of(wrapped) == pytest.approx(39946, rel=0.02)
    counts = np.round(8_300_000 + 420 * force)
    wrapping = np.where(counts > (1 << 23) - 1, counts - (1 << 24), counts)
    assert wrap_of(wrapping) == pytest.approx(1 << 24, rel=0.02)
    spike = force.copy()
    spike[100] = -39946
    assert wrap_of(spike) is None
    # a force in one step, though over all of 16 bits, may be of a larger converter
    wide = np.round(60_000 * (force - force.min()) / np.ptp(force))
    assert wrap_of(np.where(wide > 30_000, 64_500, 300) + wide % 300, certain=True) is None


@pytest.mark.parametrize(("codes", "lowest"), [(1 << 24, -(1 << 23)), (1 << 16, 0)])
@pytest.mark.parametrize("lift", [0.08, 0.3])
def test_a_counter_wraps_by_a_step_of_lift_or_of_noise(codes: int, lowest: int, lift: float):
    rng = np.random.default_rng(1)
    counts = np.where(np.arange(400) < 150, -0.004, lift) + 0.0005 * rng.standard_normal(400)
    # the tare is near the end of the counter, or the lift just at it
    for end in (0.0, lift):
        counter = (np.round((counts - end) * codes) + lowest) % codes
        counter = np.where(counter >= codes + lowest, counter - codes, counter)
        few = codes < 1 << 24
        assert (wrap_of(counter, certain=True) is None) == (end == 0.0 and few)
    # an error code is one reading
    spikes = np.round((0.2 + 0.1 * counts) * codes)
    spikes[[20, 90, 200, 300]] = lowest
    assert wrap_of(spikes, certain=True) is None
