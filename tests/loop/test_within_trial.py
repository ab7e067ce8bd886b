"""Change of lift over a record, over visits."""

import pytest
from scipy.stats import t

from nearlift.loop import within_trial


def test_the_interval_is_student_s_over_visits(monkeypatch):
    monkeypatch.setattr(within_trial, "_over_visits", lambda _: (0.01, 0.002, 12))
    found = within_trial.heating(None, (), rate=0.05)
    half = t.ppf(0.95, 11) * 0.002
    change = found.change_over_record
    assert (change.value, change.lo90, change.hi90) == pytest.approx(
        (0.01, 0.01 - half, 0.01 + half)
    )
    assert found.p_value == pytest.approx(2 * t.sf(5.0, 11))
    assert found.significant
