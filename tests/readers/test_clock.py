"""Times of day in a record are seconds, in any usual writing, or are named as not read."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import h5py
import nptdms
import numpy as np
import pyarrow.parquet
import pytest
import scipy.io
from tests.readers.reading import records

from nearlift.errors import InputRefused
from nearlift.onboarding.inspection import inspect
from nearlift.onboarding.shown import block
from nearlift.readers import reader
from nearlift.readers.base import pick, rate_of
from nearlift.readers.clock import seconds_of
from nearlift.reduction.samples import Conditions, clock_codes


@pytest.mark.parametrize(
    ("cells", "want"),
    [
        (["23:59:58.000", "23:59:59.5", "0:00:01.0"], [0, 1.5, 3]),
        (["59:58.0", "59:59.9", "00:01.2"], [0, 1.9, 3.2]),
        (["2024-10-27T02:59:59.5+02:00", "2024-10-27T02:00:00.5+01:00"], [0, 1]),
        (["2024-03-31T01:59:59Z", "", "2024-03-31 02:00:01 UTC"], [0, np.nan, 2]),
        (["11:59:59 AM", "12:00:01 PM", "1:00:00 p.m."], [0, 2, 3601]),
        (["12/31/2024 11:59:59.990 PM", "1/1/2025 12:00:00.010 AM"], [0, 0.02]),
        (["27.10.2024 02:59:58,500", "27.10.2024 02:59:58,600"], [0, 0.1]),
        (["2024-10-27 02:59:58:012", "2024-10-27 02:59:58:022"], [0, 0.01]),
        (["20241027T235958.5Z", "20241028T000000.25Z"], [0, 1.75]),
        (["[14:05:03.000]", "[14:05:03.012]"], [0, 0.012]),
        (["Oct 27 2024 14:05:03", "Oct 27 2024 14:05:04"], [0, 1]),
        (["14. März 2026 14:05:03,25", "14. März 2026 14:05:04,5"], [0, 1.25]),
        (["14h05m03.2s", "14h05m03,7s"], [0, 0.5]),
        (["14時5分03.2秒", "14時05分03.7秒"], [0, 0.5]),
        (["2026-03-01 14:05:03.2 JST", "2026-03-01 14:05:03.7 JST"], [0, 0.5]),
        (["14/03/2026 02:05:03.2 pm", "14/03/2026 02:05:03.7 pm"], [0, 0.5]),
    ],
)
def test_usual_writings(cells: list[str], want: list[float]) -> None:
    found, bad = seconds_of(cells)
    assert bad is None
    np.testing.assert_allclose(found, want, atol=1e-9)


@pytest.mark.parametrize("cell", ["12:30", "24:00:00", "1:60:00", "x", "3.5"])
def test_what_may_be_something_else_is_no_time(cell: str) -> None:
    assert seconds_of([cell])[1] == 0


@pytest.mark.parametrize(
    ("header", "row"),
    [
        ("time,force\n", "{:%H:%M:%S}.{:03d},{}\n"),
        ("time;force\n", "{:%d.%m.%Y %H:%M:%S}.{:03d};{}\n"),
        ("", "{:%H:%M:%S}.{:03d} -> {}\n"),
        ("time,force\n", "{:%I:%M:%S}.{:03d} PM,{}\n"),
    ],
)
def test_a_record_by_its_clock(tmp_path: Path, header: str, row: str) -> None:
    """Its rate is found, the manifest's is held against it, and gaps are seen."""
    import datetime

    start = datetime.datetime(2024, 5, 6, 21, 59, 58)
    force = np.round(np.random.default_rng(1).normal(1.5, 0.1, 200), 4).tolist()
    stamps = [start + datetime.timedelta(milliseconds=25 * i) for i in range(200)]
    lines = [row.format(t, t.microsecond // 1000, f) for t, f in zip(stamps, force, strict=True)]
    path = tmp_path / "a.csv"
    path.write_text(header + "".join(lines))
    found = inspect(path)
    assert found.force is not None
    assert found.clock is not None
    assert found.force.rate_Hz == pytest.approx(40)
    assert "is a time of day: read as seconds" in found.contents.notes[-1]
    time = {"column": found.clock.name, "unit": "s"}
    said = {"time": time, "dialect": {} if header else found.dialect}
    (record,) = records(tmp_path, "text", found.force.name, "N", "{trial}.csv", "40 Hz", **said)
    assert record.time_s is not None
    np.testing.assert_allclose(record.time_s, np.arange(200) / 40, atol=1e-9)
    assert record.force_N.tolist() == force


@pytest.mark.parametrize(
    ("header", "row", "unit", "rate"),
    [
        ("timestamp,force", "1773497100.{ms:03d},{f}", "s", 100),
        ("timestamp,force", "1773497100{ms:03d},{f}", "ms", 100),
        ("timestamp,force", "1773497100{ms:03d}000,{f}", "us", 100),
        ("timestamp,force", "1773497100{ms:03d}000000,{f}", "ns", 100),
        # days of a spreadsheet, and of MATLAB
        ("Zeit;Kraft (gf)", "{excel:.10f};{f}", "day", 10),
        ("datenum,Thrust (gf)", "{matlab:.9f},{f}", "day", 40),
    ],
)
def test_stamps_have_their_unit(
    tmp_path: Path, header: str, row: str, unit: str, rate: float
) -> None:
    rows = [
        row.format(
            ms=10 * i, f=i % 7, excel=46095.586805 + i / 864000, matlab=740043.5 + i / 3456000
        )
        for i in range(99)
    ]
    (tmp_path / "a.csv").write_text("\n".join([header, *rows, ""]))
    shown = inspect(tmp_path / "a.csv")
    assert shown.clock is not None
    assert shown.force is not None
    assert (shown.clock.unit, shown.force.rate_Hz) == (unit, pytest.approx(rate, rel=1e-3))
    proposed = tomllib.loads(block(shown))["records"]
    name, time = proposed["reader"], proposed["time"]
    column = shown.force.name
    (record,) = records(tmp_path, name, column, "gf", "{trial}.csv", f"{rate} Hz", time=time)
    assert record.time_s is not None
    np.testing.assert_allclose(record.time_s - record.time_s[0], np.arange(99) / rate, atol=1e-4)


@pytest.mark.parametrize(
    ("stamps", "rows"),
    # the second is 40 Hz rounded to tenths: three to five rows of each
    [
        ([f"12:00:{i // 80:02d}" for i in range(400)], 80),
        ([f"{i / 40:.1f}" for i in range(200)], 4),
    ],
)
def test_coarse_stamps_are_no_clock_of_samples(
    tmp_path: Path, stamps: list[str], rows: int
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,force\n" + "".join(f"{t},{i % 7}\n" for i, t in enumerate(stamps)))
    found = inspect(path)
    assert found.rows_per_stamp == rows
    assert "\ntime" not in block(found)


def test_stamps_in_whole_milliseconds_have_the_rate_of_the_samples() -> None:
    """Steps of 12 and 13 ms are 80 Hz, and not 83."""
    stamps = np.floor(12.5 * np.arange(400)) / 1000
    assert rate_of(stamps) == pytest.approx(80, rel=2e-4)
    assert clock_codes(stamps, Conditions(rate_Hz=80.0), "a") == []
    with pytest.raises(InputRefused, match="runs at 80"):
        clock_codes(stamps, Conditions(rate_Hz=83.3), "a")


def test_a_time_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time,force\n" + "".join(f"12:{i // 60:02d},{i % 7}\n" for i in range(99)))
    said = "'time' is not read: '12:00' is neither a number nor a time"
    assert any(said in note for note in inspect(path).contents.notes)
    path.write_text("time,force\n12:00:00,1\nlater,2\n12:00:02,3\n")
    said = "column 'time' is not read: line 3 has 'later'"
    assert any(said in note for note in inspect(path).contents.notes)
    with pytest.raises(InputRefused, match="line 3: has 'later' in column 'time', no time of"):
        reader("csv").open(path, {}, ("force", "time"))


@pytest.mark.parametrize(
    ("seconds", "fractions", "unit_s"),
    [
        ("secs", "nsecs", 1e-9),
        ("sec", "nanosec", 1e-9),
        ("header.stamp.secs", "header.stamp.nsecs", 1e-9),
        ("tv_sec", "tv_usec", 1e-6),
        ("Seconds", "Milliseconds", 1e-3),
        ("time (s)", "time (ms)", 1e-3),
        ("seconds", "microseconds", 1e-6),
    ],
)
def test_a_clock_in_two_columns_is_read_as_one(
    tmp_path: Path, seconds: str, fractions: str, unit_s: float
) -> None:
    """At 40 Hz over three seconds, from the middle of one."""
    path, ticks = tmp_path / "a.csv", np.arange(120) * 25 + 300
    rows = zip(1_700_000_000 + ticks // 1000, ticks % 1000 * round(1e-3 / unit_s), strict=True)
    lines = "".join(f"{s},{f},{i % 7}\n" for i, (s, f) in enumerate(rows))
    path.write_text(f"{seconds},{fractions},force_N\n{lines}")
    proposed = tomllib.loads(block(inspect(path)))
    assert proposed["load_cell"]["sample_rate"] == "40 Hz"
    assert proposed["records"]["time"] == {"column": seconds, "unit": "s"}
    clock, force = reader("csv").open(path, {}, ("force_N", seconds)).channels
    assert (clock.name, clock.unit, force.name) == (seconds, "s", "force_N")
    np.testing.assert_allclose(np.diff(clock.values), 0.025, atol=1e-9)
    # the fractions alone are no clock
    alone = reader("csv").open(path, {}, (fractions,)).channels
    with pytest.raises(InputRefused, match=f"records.time.column = .{re.escape(seconds)}"):
        pick(alone, fractions, "records.time.column", "a")


@pytest.mark.parametrize("name", ["parquet", "hdf5", "mat", "tdms"])
def test_two_columns_of_binary_files_are_one_clock(tmp_path: Path, name: str) -> None:
    ticks = np.arange(120) * 25 + 300
    columns = {"sec": 1_700_000_000 + ticks // 1000, "nanosec": ticks % 1000 * 1_000_000}
    columns |= {"force": ticks % 7, "note": ticks}
    column, path = {"hdf5": "/log/{}", "mat": "log.{}", "tdms": "log/{}"}.get(name, "{}"), tmp_path
    if name == "parquet":
        trial = {"trial": ["a"] * len(ticks)}
        pyarrow.parquet.write_table(pyarrow.table(trial | columns), path / "a.parquet")
    elif name == "hdf5":
        with h5py.File(path / "a.h5", "w") as file:
            for key, values in columns.items():
                file[f"log/{key}"] = values
    elif name == "mat":
        scipy.io.savemat(path / "a.mat", {"log": columns})
    else:
        with nptdms.TdmsWriter(path / "a.tdms") as writer:
            writer.write_segment([nptdms.ChannelObject("log", *item) for item in columns.items()])
    [file] = path.iterdir()
    files = file.name if name == "parquet" else f"{{trial}}{file.suffix}"
    time = {"column": column.format("sec"), "unit": "s"}
    (record,) = records(tmp_path, name, column.format("force"), "N", files, "40 Hz", time=time)
    assert record.time_s is not None
    np.testing.assert_allclose(np.diff(record.time_s), 0.025, atol=1e-9)
    assert "are one clock" in record.notes[0]


def test_two_clocks_are_not_joined(tmp_path: Path) -> None:
    """Neither whole seconds and all milliseconds, nor seconds with decimals."""
    for whole in (np.floor(np.arange(120) / 40), np.arange(120) / 40):
        path = tmp_path / "a.csv"
        rows = zip(whole, 25 * np.arange(120), strict=True)
        path.write_text("t_s,t_ms,F\n" + "".join(f"{s:g},{ms},{ms % 7}\n" for s, ms in rows))
        assert [c.name for c in inspect(path).contents.channels] == ["t_s", "t_ms", "F"]
