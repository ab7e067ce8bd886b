"""Trials whose rotors did not turn, records that begin with a stopped head, and weights that look
like another unit.
"""

import numpy as np

from nearlift.reduction import plausibility
from nearlift.reduction.conditions import Conditions
from nearlift.reduction.record import reduce_record


def table(lift, quality=None):
    n = len(lift)
    return {
        "boundary": np.full(n, "ground", dtype=object),
        "z_hat": np.full(n, 10.0),
        "throttle": np.full(n, 0.5),
        "lift_N": np.asarray(lift, dtype=float),
        "quality": np.asarray(quality if quality is not None else [""] * n, dtype=object),
    }


def test_a_lift_that_is_not_there_is_told_from_one_that_is():
    found = plausibility.without_lift(table([0.2, 0.21, 0.19, -0.0004, 0.000018, 0.0]))
    assert found.tolist() == [False, False, False, True, True, True]


def test_a_trial_rejected_for_another_reason_is_left_to_it():
    found = plausibility.without_lift(
        table([0.2, 0.21, np.nan, -1.0], ["", "", "NO_DATA", "SATURATED"])
    )
    assert not found.any()


def test_ten_times_the_weight_gets_a_note_and_a_usual_one_none():
    assert (
        "which is unusual"
        in plausibility.odd_weight(table([4.2, 4.1]), 0.265, "mN", "records.force.unit")[0]
    )
    assert plausibility.odd_weight(table([0.41, 0.42]), 0.265, "mN", "records.force.unit") == []


def test_a_stopped_head_left_in_the_record_is_noticed():
    rng = np.random.default_rng(0)
    head, live = rng.normal(0, 1e-3, 300), rng.normal(0.2, 1e-3, 1000)
    assert "unsettled" in reduce_record(np.r_[head, live], Conditions(rate_Hz=1000.0)).codes
    assert "unsettled" not in reduce_record(live, Conditions(rate_Hz=1000.0)).codes


def test_a_campaign_of_unsettled_records_is_told_what_to_look_at():
    assert (
        "is `tare` too short"
        in plausibility.mostly_unsettled(table([0.2] * 4, ["unsettled"] * 3 + [""]))[0]
    )
    assert plausibility.mostly_unsettled(table([0.2] * 4, ["unsettled"] + [""] * 3)) == []
