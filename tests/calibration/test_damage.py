"""What docs/damage.md promises of damaged files."""

import pytest
from tests.calibration import damage


def test_damaged_bytes_have_their_rows(tmp_path):
    """A sample of every format's; what is raised over a record would end this test."""
    tries = {"byte": 8, "sector": 4, "cut": 4}
    fates = damage.bytes_to_rows(tmp_path, tries)
    assert (fates.sum(axis=1) == 16).all()
    assert fates.xs("silent", axis=1, level=1).sum().sum() == 0


@pytest.mark.parametrize("n", [2000, 200])
@pytest.mark.parametrize("glitch", damage.GLITCHES.values(), ids=damage.GLITCHES)
def test_a_glitch_in_the_tare_moves_no_lift_in_silence(glitch, n):
    made = damage.tare_glitches(n, glitch, tries=20)
    assert made["reported"].any()
    assert not made["silent"].any()


@pytest.mark.calibration
def test_no_glitch_and_no_damaged_byte_is_silent(tmp_path):
    """Binary formats without a check sum may hold other numbers that are as likely: one sector in a
    hundred, at most.
    """
    fates = damage.bytes_to_rows(tmp_path)
    assert (fates.xs("silent", axis=1, level=1) <= 1).all(axis=None)
    for glitch in damage.GLITCHES.values():
        for n in damage.TARES[:2]:
            assert not damage.tare_glitches(n, glitch)["silent"].any()
    assert (damage.false_alarms(5000)[[2000, 200]] <= 1).all(axis=None)
