"""What docs/damage.md promises of damaged files."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from tests.calibration import records
from tests.calibration.damage import TRIES, page, subjects, table, tally


def test_one_subject_is_told_apart(tmp_path: Path) -> None:
    """The harness itself: what pandas makes of a cut CSV is silently short or wrong, and ours is
    marked.
    """
    chosen = {s.program: tally(s, "cut", tmp_path) for s in subjects() if s.format == "plain CSV"}
    assert sum(chosen["nearlift"].values()) == TRIES
    assert chosen["nearlift"]["wrong"] == 0
    assert chosen["pandas"]["short"] + chosen["pandas"]["wrong"] > TRIES / 2
    assert chosen["nearlift, `record` given"]["short"] == 0


def test_damaged_bytes_have_their_rows(tmp_path: Path) -> None:
    """A sample of every format's; what is raised over a record would end this test."""
    found = records.bytes_to_rows(tmp_path, flips=8, sectors=4)
    for (name, kind), count in found.items():
        assert sum(count.values()) == {"flip": 8, "sector": 4}[kind], name
        assert count["silent"] == 0, name


@pytest.mark.parametrize("rate_Hz", [1000.0, 100.0])
@pytest.mark.parametrize("glitch", list(records.GLITCHES.values()), ids=list(records.GLITCHES))
def test_a_glitch_in_the_tare_moves_no_lift_in_silence(
    glitch: records.Glitch, rate_Hz: float
) -> None:
    found = records.tare_glitches(rate_Hz, round(2 * rate_Hz), glitch, tries=20)
    assert found.told > 0
    assert found.silent == 0


@pytest.mark.calibration
def test_no_glitch_and_no_damaged_byte_is_silent(tmp_path: Path) -> None:
    """Binary formats without a check sum may hold other numbers that are as likely: one sector in a
    hundred, at most.
    """
    for (name, kind), count in records.bytes_to_rows(tmp_path / "rows").items():
        assert count["silent"] <= 1, (name, kind)
    for glitch in records.GLITCHES.values():
        for rate_Hz, n in records.TARES[:2]:
            assert records.tare_glitches(rate_Hz, n, glitch).silent == 0
    told, most = records.on_the_coefficient(tmp_path / "campaign")
    assert told.silent == 0
    assert most < 1
    assert all(
        flagged <= 1 for (_, n), (flagged, _) in records.false_alarms(5000).items() if n >= 200
    )


@pytest.mark.calibration
def test_no_damage_is_silent_where_it_can_be_seen(tmp_path: Path) -> None:
    found = table(tmp_path)
    ours = {(f, h): c for (f, p, h), c in found.items() if p.startswith("nearlift")}
    told = {(f, h): c for (f, p, h), c in found.items() if p == "nearlift, `record` given"}
    for fmt in (
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
        "HDF5 with fletcher32",
        "Parquet with page checksums",
    ):
        assert ours[fmt, "flip"]["wrong"] + ours[fmt, "flip"]["short"] == 0, fmt
    assert isinstance(next(iter(found.values())), Counter)
    assert "| our own products | nearlift |" in page(found)
