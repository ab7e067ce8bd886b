"""What docs/damage.md promises of damaged files."""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack
from pathlib import Path

import pytest
from tests.calibration.damage import TRIES, page, subjects, table, tally


def test_one_subject_is_told_apart(tmp_path: Path) -> None:
    """The harness itself: what pandas makes of a cut CSV is silently short or wrong, and ours is marked."""
    with ExitStack() as stack:
        chosen = {s.program: tally(s, "cut", tmp_path) for s in subjects(stack) if s.format == "plain CSV"}
    assert sum(chosen["nearlift"].values()) == TRIES
    assert chosen["nearlift"]["wrong"] == 0
    assert chosen["pandas"]["short"] + chosen["pandas"]["wrong"] > TRIES / 2
    assert chosen["nearlift, `record` given"]["short"] == 0


@pytest.mark.calibration
def test_no_damage_is_silent_where_it_can_be_seen(tmp_path: Path) -> None:
    found = table(tmp_path)
    ours = {(f, h): c for (f, p, h), c in found.items() if p.startswith("nearlift")}
    told = {(f, h): c for (f, p, h), c in found.items() if p == "nearlift, `record` given"}
    for fmt in (
        "Crazyflie uSD",
        "LVM",
        "TDMS",
        "MATLAB v7",
        "MATLAB v5, not compressed",
        "MATLAB v7.3",
        "HDF5",
        "HDF5 with fletcher32",
        "Parquet, defaults",
        "Parquet with page checksums",
        "our own products",
    ):
        assert ours[fmt, "cut"]["short"] + ours[fmt, "cut"]["wrong"] == 0, fmt
    for (fmt, how), count in told.items():
        assert how == "flip" or count["short"] + count["wrong"] == 0, fmt
    for fmt in (
        "our own products",
        "Crazyflie uSD",
        "HDF5 with fletcher32",
        "Parquet with page checksums",
        "any, beside SHA256SUMS (here plain CSV)",
    ):
        assert ours[fmt, "flip"]["wrong"] + ours[fmt, "flip"]["short"] == 0, fmt
    assert isinstance(next(iter(found.values())), Counter)
    assert "| our own products | nearlift |" in page(found)
