"""Files that laboratories recorded, next to the repository: each is read, or refused with the right
words.
"""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nearlift import readers
from nearlift.errors import InputRefused
from nearlift.readers.base import Contents, pick

DATA = Path(__file__).parents[2].parent / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not here")
FIRST = ["thrust", "current", "voltage", "power", "throttle", "loop", "t"]
RAMP = {
    "columns": FIRST,
    "units": ["kgf", "A", "V", "W", "percent", "Hz", "us"],
    "ignore": ["START", "STOP"],
}
THERMAL = "pitt-ras-iarc7-thrust/v2_thermal/transisterthermaltesting.txt.gz"
SWEEP = {"columns": ["throttle", "thrust", "battery", "distance"]}


def read(name: str, path: Path, dialect: dict[str, Any] | None = None) -> Contents:
    return readers.reader(name).open(path, dialect or {}, None)


def values(contents: Contents, name: str) -> Any:
    return pick(contents.channels, name, "k", "f").values


#: Folder, file, channel; unit, number of readings, largest reading, rate in Hz; codes.
THRUST_GF = ("Thrust", "gf")
TRIGGER = ("Excitation (Trigger)", "N", 10, None, 25600)
LINE = "07/09/2012 06:58:23 PM - Digital Input - All Data/Dev1_port3_line7 - line 0"
FILES: dict[str, list[tuple[Any, ...]]] = {
    "rcbenchmark rcbenchmark-logs": [
        ("StepsTest20230615_2023-06-15_174003.csv", *THRUST_GF, 2001, 25.71, None, "dead_speed"),
        ("StepsTest_2020-06-16_220513.csv", *THRUST_GF, 21, 146.1, None),
        ("aerostack2_xNova-SR-ramp.csv", "Thrust", "N", 135, 9.12, None, "dead_speed"),
        ("aerostack2_xNova-SR-steps-up.csv", "Thrust", "N", 377, 5.435, None),
    ],
    "lvm daq-format-samples": [
        ("short.lvm", *TRIGGER),
        ("short_new_line_end.lvm", *TRIGGER),
        ("long_single_header_multi_ch.lvm", "m_2", "m/s^2", 16384, None, 1023.5),
        ("no_decimal_separator.lvm", "az.X_Value", "s", 4, None, 4000),
    ],
    "tdms daq-format-samples": [
        ("raw1.tdms", "Layer Data/First  Channel", None, 2000, None, 5e4),
        ("big_endian.tdms", "Measured Data/Amplitude sweep", None, 3500, None, 1e3),
        ("Digital_Input.tdms", LINE, None, 20000, None, 2e3),
    ],
    "crazyflie crazyflie-thrust-stand": [
        ("cf2.1-stock-prop.csv", "weight", "g", 2573, 50.01, None),
        ("cf21_stock2.csv", "weight", "g", 1735, 29.58, None),
        ("imrc_cf21bl_guards_2026.csv", "thrust", "g", 72, 97.0, None),
        ("imrc_cf21plus_350mah_2026.csv", "thrust", "g", 121, 63.0, None),
    ],
}


@pytest.mark.parametrize(
    ("place", "row"), [(k, row) for k, rows in FILES.items() for row in rows], ids=str
)
def test_a_file_of_a_laboratory_is_read(place: str, row: tuple[Any, ...]) -> None:
    reader, folder = place.split()
    file, channel, unit, n, largest, rate, *codes = row
    contents = read(reader, DATA / folder / file)
    one = pick(contents.channels, channel, "k", "f")
    assert len(one.values) == n
    assert list(contents.codes) == codes
    assert unit is None or one.unit == unit
    assert largest is None or np.abs(one.values).max() == pytest.approx(largest, rel=0.01)
    assert rate is None or one.rate_Hz == pytest.approx(rate, rel=1e-3)


@pytest.mark.parametrize(
    "file", ["5x5x3_fpv_forward.txt", "6x4.5x2_fpv_forward.txt", "apc_12_6.txt"]
)
def test_raw_ramps(file: str) -> None:
    contents = read("text", DATA / "pitt-ras-iarc7-thrust/v2_static" / file, RAMP)
    thrust = pick(contents.channels, "thrust", "k", "f")
    assert 1800 < len(thrust.values) < 2300
    assert thrust.unit == "kgf"
    assert 0.3 < thrust.values.max() < 5


def test_the_clock_of_averaged_steps_runs_on_but_not_steadily() -> None:
    contents = read("rcbenchmark", DATA / "rcbenchmark-logs/StepsTest_2020-06-16_220513.csv")
    assert np.diff(values(contents, "Time"))[0] < 0.01


def test_lvm_with_comments_and_a_false_rate() -> None:
    contents = read("lvm", DATA / "daq-format-samples/with_comments.lvm")
    names = [c.name for c in contents.channels]
    assert names == ["X_Value", "Press\u00e3o ABS. (MPa)", "Temperatura (\u00b0C)", "Volume (ml)"]
    assert values(contents, "Volume (ml)")[:2].tolist() == [0.0, 89.8214]
    assert "the header says 1 Hz" in contents.notes[0]


def test_all_calibration_runs_are_read_by_recipe_and_give_the_straight_line() -> None:
    paths = sorted((DATA / "vadl-loadcell-calibration").glob("[0-9]*.txt.gz"))
    recipe = {"columns": ["force"], "units": ["count"]}
    counts = [values(read("text", path, recipe), "force").mean() for path in paths]
    slope, zero = np.polyfit([float(path.name.split(".")[0]) for path in paths], counts, 1)
    assert len(paths) == 20
    assert (slope, zero) == (pytest.approx(2.7548, rel=0.005), pytest.approx(1604.4, abs=2))


def test_sweeps_without_a_header() -> None:
    folder = DATA / "pitt-ras-iarc7-thrust/v1_sweeps_with_ground_distance"
    contents = [read("text", path, SWEEP) for path in folder.glob("*.csv")]
    assert [[len(c.values) for c in one.channels] for one in contents] == 12 * [[50] * 4]


@pytest.mark.parametrize(
    ("file", "dialect", "words"),
    [
        (
            *("text vadl-loadcell-calibration/100.txt.gz", {}),
            r'above its rows of 1 cell\n  name them: dialect = { columns = \["force"\] }',
        ),
        (
            *("crazyflie crazyflie-thrust-stand/bitcraze_2015_table.csv", {}),
            "line 1: has not the header of Crazyflie system identification",
        ),
        (
            "text pitt-ras-iarc7-thrust/v2_dynamic/6x4.5x2_dynamic.txt.gz",
            {"columns": list("abcdefghij"), "ignore": ["START", "STOP"]},
            "line 350: has 1 cells under 10 column names",
        ),
        (
            *(f"text {THERMAL}", {"labels": True}),
            "line 2: is labelled T, C, V, W, Thr, Hz, not Thr, Hz",
        ),
    ],
)
def test_what_cannot_be_read_is_refused_with_the_way_out(
    file: str, dialect: dict[str, Any], words: str
) -> None:
    reader, _, name = file.partition(" ")
    with pytest.raises(InputRefused, match=words):
        read(reader, DATA / name, dialect)


def test_the_thermal_log(tmp_path: Path) -> None:
    """Labelled cells; its first line begins in the middle, its last ends there."""
    packed = DATA / THERMAL
    path = tmp_path / packed.stem
    path.write_bytes(gzip.decompress(packed.read_bytes()))
    contents = read("text", path, {"labels": True, "skip": 1})
    assert [c.name for c in contents.channels] == ["T", "C", "V", "W", "Thr", "Hz"]
    assert len(values(contents, "T")) == 68777
    assert contents.codes == ("truncated",)
