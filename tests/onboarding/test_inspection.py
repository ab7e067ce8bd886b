"""What `nearlift inspect` shows of a file: reader, channels, notes."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from tests.unit import sweeps, written
from tests.unit.small_run import nearlift

from nearlift.onboarding.inspection import inspect
from nearlift.onboarding.shown import block, notes

FORCE = [float(x) for x in np.round(np.linspace(0.1, 3, 60), 3)]


@pytest.mark.parametrize("name", list(written.WRITERS))
def test_every_format_is_recognised_and_its_block_names_the_reader_and_the_force(tmp_path, name):
    write, column, unit, suffix = written.WRITERS[name]
    seen = inspect(written.put(tmp_path, f"a.{suffix}", write(FORCE)))
    assert (seen.reader, seen.grid, seen.table) == (name, None, None)
    assert seen.force is not None
    assert seen.force.name.split(" (")[0].split("[")[0] in (column, "force", column.split(" (")[0])
    tables = tomllib.loads(block(seen))
    records = tables["records"]
    assert (records["reader"], records["files"]) == (name, f"{{trial}}.{suffix}")
    assert records["force"]["column"] == seen.force.name
    if name not in ("mat", "csv"):
        assert records["force"]["unit"] == unit
    if name in ("lvm", "tdms", "hdf5", "text"):
        assert float(tables["load_cell"]["sample_rate"].split()[0]) == pytest.approx(1000)


@pytest.mark.parametrize(
    ("content", "reader"),
    [
        (b"F\n1\n2\n", "csv"),
        (b"t;F\n0.1;2\n0.2;3\n", "text"),
        (b"a log of 12:30\nt,F\n0.1,2\n0.2,3\n", "csv"),
        (b"t,F\n s,N\n0.1,2\n0.2,3\n", "csv"),
    ],
)
def test_plain_csv_gets_its_own_reader_and_all_other_text_that_of_text(tmp_path, content, reader):
    assert inspect(written.put(tmp_path, "a.csv", content)).reader == reader


def test_a_dialect_can_be_given_and_is_in_the_block(tmp_path):
    rows = "".join(f"{20 * i},{-0.1 * i:.2f},7\r\n" for i in range(60))
    path = written.put(tmp_path, "ramp.txt", f"START\r\n{rows}STOP\r\n".encode())
    refused = nearlift("inspect", path)
    assert refused.exit_code == 4
    assert 'dialect = { ignore = ["STOP"] }' in refused.stderr
    said = '{ ignore = ["START", "STOP"], columns = ["t", "thrust", "n"], units = ["ms", "N", ""] }'
    answer = nearlift("inspect", path, "--dialect", said)
    tables = tomllib.loads(answer.stdout.split("\n\n", 1)[1])
    assert tables["records"]["dialect"] == tomllib.loads("x = " + said)["x"]
    assert tables["records"]["time"] == {"column": "t", "unit": "ms"}
    assert tables["load_cell"]["sample_rate"] == "50 Hz"
    assert "sign = -1}   # lift makes these numbers smaller" in answer.stdout
    made = nearlift("new", tmp_path / "c", "--from", path, "--dialect", said.strip("{}"))
    assert made.exit_code == 0, made.stderr
    manifest = tomllib.loads((tmp_path / "c" / "campaign.toml").read_text())
    assert manifest["records"]["dialect"] == tables["records"]["dialect"]
    for wrong, text in (
        ("columns = [", "is not as a manifest has it"),
        ("colums = 1", "did you mean 'columns'?"),
    ):
        answer = nearlift("inspect", path, "--dialect", wrong)
        assert (answer.exit_code, text in answer.stderr) == (2, True)


def test_lost_samples_and_a_clock_without_a_unit_are_told_in_text_and_json(tmp_path):
    rows = (f"{i / 500:.3f},{'OVER' if i % 10 == 3 else 2.5}\n" for i in range(60))
    path = written.put(tmp_path, "a.csv", f"time,force\n{''.join(rows)}".encode())
    answer = nearlift("inspect", path).stdout
    assert "note: 6 of 60 samples of 'force' hold no number" in answer
    assert 'time = {column = "time", unit = "FILL IN"}   # in s the rate is 500 Hz' in answer
    content = json.loads(nearlift("inspect", path, "--json").stdout)
    assert (content["force"], [c["samples"] for c in content["channels"]]) == ("force", [60, 60])


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "is empty"),
        (b"\x1f\x8b\x08", "is compressed"),
        (b"\x89HDF\r\n\x1a\nnothing", "cannot be read"),
        (b"t,F\n", "holds no channel of numbers"),
        (b'{"t": 1, "F": 2}\n{"t": 2, "F": 3}\n', "is JSON, XML or bracketed lists"),
        (None, "is missing"),
    ],
)
def test_4_for_a_file_that_cannot_be_read(tmp_path, content, text):
    path = tmp_path / "no" if content is None else written.put(tmp_path, "a.bin", content)
    answer = nearlift("inspect", path)
    assert (answer.exit_code, text in answer.stderr) == (4, True)
    assert "Traceback" not in answer.output
    assert "--from FOLDER` takes them all" in nearlift("inspect", tmp_path).stderr


def test_a_force_without_a_sample_is_no_traceback(tmp_path):
    header = written.rcbenchmark([0.0]).splitlines(keepends=True)[0]
    answer = nearlift("inspect", written.put(tmp_path, "a.csv", header))
    assert "Traceback" not in answer.output
    assert answer.exit_code in (0, 4)


@pytest.mark.parametrize(
    ("header", "unit", "clock"),
    [
        ("时间（秒）,推力（牛）", "N", "s"),
        ('"Время, с","Тяга, Н"', "N", "s"),
        ("Tempo (s),Empuxo (gf)", "gf", "s"),
        ("Zeit [s],Last [kp]", "kgf", "s"),
        ("Time (sec),Load (lbs)", "lbf", "s"),
        ("Time (min),Thrust (kgs)", "kgf", "min"),
    ],
)
def test_headers_in_other_tongues_and_units(
    tmp_path: Path, header: str, unit: str, clock: str
) -> None:
    step = 0.01 / (60 if clock == "min" else 1)
    rows = "".join(f"{step * i:.9f},{i % 7}\n" for i in range(120))
    path = written.put(tmp_path, "a.csv", f"{header}\n{rows}".encode())
    seen = tomllib.loads(block(inspect(path)))
    assert seen["records"]["force"]["unit"] == unit
    assert seen["records"]["time"]["unit"] == clock
    assert seen["load_cell"]["sample_rate"] == "100 Hz"


@pytest.mark.parametrize("sensors", [2, 3])
def test_several_sensors_under_one_stamp_are_noted(tmp_path: Path, sensors: int) -> None:
    rows = [f"{i / 50:.2f},{k},{5 * k + (i % 3) / 10}" for i in range(60) for k in range(sensors)]
    path = written.put(tmp_path, "a.csv", "\n".join(["t_s,unit,F_N", *rows, ""]).encode())
    (note,) = notes(inspect(path))
    assert f"each time of 't_s' has {sensors} rows" in note
    assert "keep one as a file of its own" in note


def test_a_counter_that_wraps_is_noted(tmp_path):
    force = np.where(np.arange(320) >= 120, 300.0 - 39946, 0.0)
    force += np.random.default_rng(2).normal(0, 1, 320)
    path = tmp_path / "r.csv"
    path.write_text(sweeps.text_of({"t_s": np.arange(320) / 80, "thrust_g": force}))
    seen = inspect(path)
    assert "a counter of the converter that wraps" in " ".join(notes(seen))
    assert "sign = -1" not in block(seen)
