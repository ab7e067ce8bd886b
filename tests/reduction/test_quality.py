"""Quality codes keep their convention."""

from __future__ import annotations

import numpy as np
import pytest

from nearlift.reduction.quality import CODES, EXCLUDED, joined, reason, rejected


def test_capitals_reject() -> None:
    for name, meaning in CODES.items():
        assert name.isupper() != name.islower(), "CAPITALS reject, lower case warns"
        assert meaning


def test_mask_of_rejected_trials() -> None:
    quality = np.array(
        ["", "drift", "SATURATED", "truncated SHORT", "NO_DATA", "out_of_range"], dtype=object
    )
    assert rejected(quality).tolist() == [False, False, True, True, True, False]
    assert rejected(np.array([], dtype=object)).tolist() == []


def test_codes_are_joined_in_one_order_each_once() -> None:
    assert joined(["drift", "STUCK", "drift"]) == "STUCK drift"
    assert joined([]) == ""
    with pytest.raises(KeyError, match="not quality codes"):
        joined(["nonsense"])


def test_the_reason_names_only_what_rejects() -> None:
    assert reason("STUCK drift") == f"STUCK ({CODES['STUCK']})"
    assert reason("drift") == ""


def test_the_manifests_reason_stands_behind_its_exclusion_and_a_fault_stays_a_fault() -> None:
    assert reason("STUCK EXCLUDED", "cable touched").endswith(
        "EXCLUDED (excluded by the manifest): cable touched"
    )
    assert reason("EXCLUDED") == "EXCLUDED (excluded by the manifest)"
    column = np.array(["EXCLUDED", "STUCK EXCLUDED", "drift"], dtype=object)
    assert rejected(column, EXCLUDED).tolist() == [False, True, False]
