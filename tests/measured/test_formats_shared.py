"""Files that laboratories recorded, beside the repository: each one is read, or refused with the
right words.
"""

from __future__ import annotations

import gzip
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nearlift import readers
from nearlift.errors import InputRefused
from nearlift.readers.base import Contents, pick

DATA = Path(__file__).parents[2].parent / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not here")


def read(name: str, path: Path, dialect: Mapping[str, Any] | None = None) -> Contents:
    return readers.reader(name).open(path, dialect or {}, None)


def unpacked(path: Path, folder: Path) -> Path:
    plain = folder / path.stem
    plain.write_bytes(gzip.decompress(path.read_bytes()))
    return plain


def values(found: Contents, name: str) -> Any:
    return pick(found.channels, name, "k", "f").values


# ---- RCbenchmark


@pytest.mark.parametrize(
    ("name", "rows", "unit", "peak", "codes"),
    [
        ("StepsTest20230615_2023-06-15_174003.csv", 2001, "gf", 25.71, {"dead_speed"}),
        ("StepsTest_2020-06-16_220513.csv", 21, "gf", 146.1, set()),
        ("aerostack2_xNova-SR-ramp.csv", 135, "N", 9.12, {"dead_speed"}),
        ("aerostack2_xNova-SR-steps-up.csv", 377, "N", 5.435, set()),
    ],
)
def test_rcbenchmark(name: str, rows: int, unit: str, peak: float, codes: set[str]) -> None:
    found = read("rcbenchmark", DATA / "rcbenchmark-logs" / name)
    thrust = pick(found.channels, "Thrust", "k", "f")
    assert (len(thrust.values), thrust.unit) == (rows, unit)
    assert float(np.abs(thrust.values).max()) == pytest.approx(peak, rel=0.01)
    assert set(found.codes) == codes


def test_the_clock_of_averaged_steps_runs_on_but_not_steadily() -> None:
    found = read("rcbenchmark", DATA / "rcbenchmark-logs" / "StepsTest_2020-06-16_220513.csv")
    assert np.diff(values(found, "Time"))[0] < 0.01


# ---- LabVIEW


@pytest.mark.parametrize(
    ("name", "channels", "rate"),
    [
        (
            "short.lvm",
            {"Excitation (Trigger)": ("N", 10), "Response (Trigger)": ("m/s^2", 10)},
            25600,
        ),
        (
            "short_new_line_end.lvm",
            {"Excitation (Trigger)": ("N", 10), "Response (Trigger)": ("m/s^2", 10)},
            25600,
        ),
        (
            "long_single_header_multi_ch.lvm",
            {"F": ("g", 16384), "m_1": ("m/s^2", 16384), "m_2": ("m/s^2", 16384)},
            1023.5,
        ),
        (
            "no_decimal_separator.lvm",
            {"ax": ("g", 4), "ay": ("g", 4), "az.X_Value": ("s", 4)},
            4000,
        ),
    ],
)
def test_lvm(name: str, channels: dict[str, tuple[str, int]], rate: float) -> None:
    found = read("lvm", DATA / "daq-format-samples" / name)
    for channel, (unit, n) in channels.items():
        one = pick(found.channels, channel, "k", "f")
        assert (one.unit, len(one.values)) == (unit, n)
        assert one.rate_Hz == pytest.approx(rate, rel=1e-3)
    assert found.codes == ()


def test_lvm_with_comments_and_a_false_rate() -> None:
    found = read("lvm", DATA / "daq-format-samples" / "with_comments.lvm")
    assert [c.name for c in found.channels] == [
        "X_Value",
        "Press\u00e3o ABS. (MPa)",
        "Temperatura (\u00b0C)",
        "Volume (ml)",
    ]
    assert values(found, "Volume (ml)")[:2].tolist() == [0.0, 89.8214]
    assert "the header says 1 Hz" in found.notes[0]


@pytest.mark.parametrize(
    ("name", "channel", "n", "rate"),
    [
        ("raw1.tdms", "Layer Data/First  Channel", 2000, 5e4),
        ("big_endian.tdms", "Measured Data/Amplitude sweep", 3500, 1e3),
        (
            "Digital_Input.tdms",
            "07/09/2012 06:58:23 PM - Digital Input - All Data/Dev1_port3_line7 - line 0",
            20000,
            2e3,
        ),
    ],
)
def test_tdms(name: str, channel: str, n: int, rate: float) -> None:
    found = read("tdms", DATA / "daq-format-samples" / name)
    one = pick(found.channels, channel, "k", "f")
    assert len(one.values) == n
    assert one.rate_Hz == pytest.approx(rate)
    assert found.codes == ()


# ---- one number to a line


def test_all_calibration_runs_are_read_by_recipe_and_give_the_straight_line() -> None:
    grams, counts = [], []
    for path in sorted((DATA / "vadl-loadcell-calibration").glob("[0-9]*.txt.gz")):
        found = read("text", path, {"columns": ["force"], "units": ["count"]})
        assert found.codes == ()
        grams.append(float(path.name.split(".")[0]))
        counts.append(values(found, "force").mean())
    slope, zero = np.polyfit(grams, counts, 1)
    assert len(grams) == 20
    assert (slope, zero) == (pytest.approx(2.7548, rel=0.005), pytest.approx(1604.4, abs=2))


def test_what_has_no_header_is_refused_with_the_way_out() -> None:
    with pytest.raises(
        InputRefused,
        match=(
            r"line 1: has no columns\' names above its rows of 1 cell\n  name them: dialect = {"
            r' columns = \["force"\] }'
        ),
    ):
        read("text", DATA / "vadl-loadcell-calibration" / "100.txt.gz")


# ---- the Crazyflie's stand


@pytest.mark.parametrize(
    ("name", "column", "rows", "largest"),
    [
        ("cf2.1-stock-prop.csv", "weight", 2573, 60.0),
        ("cf21_stock2.csv", "weight", 1735, 29.6),
        ("imrc_cf21bl_guards_2026.csv", "thrust", 72, 97.0),
        ("imrc_cf21plus_350mah_2026.csv", "thrust", 121, 59.0),
    ],
)
def test_crazyflie(name: str, column: str, rows: int, largest: float) -> None:
    found = read("crazyflie", DATA / "crazyflie-thrust-stand" / name)
    force = pick(found.channels, column, "k", "f")
    assert (len(force.values), force.unit) == (rows, "g")
    assert force.values.max() == pytest.approx(largest, rel=0.35)


def test_a_table_of_means_is_no_recording() -> None:
    path = DATA / "crazyflie-thrust-stand" / "bitcraze_2015_table.csv"
    with pytest.raises(
        InputRefused, match="line 1: has not the header of Crazyflie system identification"
    ):
        read("crazyflie", path)
    assert len(values(read("text", path), "thrust_g")) == 16


# ---- the Pitt RAS stand

RAMP = {
    "columns": ["thrust", "current", "voltage", "power", "throttle", "loop", "t"],
    "units": ["kgf", "A", "V", "W", "percent", "Hz", "us"],
    "ignore": ["START", "STOP"],
}


@pytest.mark.parametrize(
    ("name", "rows"),
    [("5x5x3_fpv_forward.txt", 1820), ("6x4.5x2_fpv_forward.txt", 1827), ("apc_12_6.txt", 2203)],
)
def test_raw_ramps(name: str, rows: int) -> None:
    found = read("text", DATA / "pitt-ras-iarc7-thrust" / "v2_static" / name, RAMP)
    thrust = pick(found.channels, "thrust", "k", "f")
    assert (len(thrust.values), thrust.unit) == (rows, "kgf")
    assert 0.3 < thrust.values.max() < 5


def test_sweeps_without_a_header() -> None:
    paths = sorted(
        (DATA / "pitt-ras-iarc7-thrust" / "v1_sweeps_with_ground_distance").glob("*.csv")
    )
    for path in paths:
        with pytest.raises(
            InputRefused, match="line 1: has no columns' names above its rows of 4 cells"
        ):
            read("text", path)
        found = read("text", path, {"columns": ["throttle", "thrust", "battery", "distance"]})
        assert [len(c.values) for c in found.channels] == [50] * 4
    assert len(paths) == 12


def test_the_thermal_log(tmp_path: Path) -> None:
    """Labelled cells; its first line begins in the middle, its last ends there."""
    path = unpacked(
        DATA / "pitt-ras-iarc7-thrust" / "v2_thermal" / "transisterthermaltesting.txt.gz", tmp_path
    )
    with pytest.raises(InputRefused, match="line 2: is labelled T, C, V, W, Thr, Hz, not Thr, Hz"):
        read("text", path, {"labels": True})
    found = read("text", path, {"labels": True, "skip": 1})
    assert [c.name for c in found.channels] == ["T", "C", "V", "W", "Thr", "Hz"]
    assert len(values(found, "T")) == 68777
    assert values(found, "T").max() == pytest.approx(4.03, abs=0.4)
    assert found.codes == ("truncated",)


def test_step_responses_with_lines_of_another_kind_between_are_refused(tmp_path: Path) -> None:
    path = unpacked(
        DATA / "pitt-ras-iarc7-thrust" / "v2_dynamic" / "6x4.5x2_dynamic.txt.gz", tmp_path
    )
    with pytest.raises(InputRefused, match="line 350: has 1 cells under 10 column names"):
        read("text", path, {"columns": list("abcdefghij"), "ignore": ["START", "STOP"]})
