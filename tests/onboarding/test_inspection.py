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
from nearlift.onboarding.shown import BARS, sparkline

FORCE = [float(x) for x in np.round(np.linspace(0.1, 3, 60), 3)]


@pytest.mark.parametrize("name", list(written.WRITERS))
def test_every_format_is_recognised_and_its_block_names_the_reader_and_the_force(tmp_path, name):
    write, column, unit, suffix = written.WRITERS[name]
    found = inspect(written.put(tmp_path, f"a.{suffix}", write(FORCE)))
    assert (found.reader, found.grid, found.table) == (name, None, None)
    assert found.force is not None
    assert found.force.name.split(" (")[0].split("[")[0] in (column, "force", column.split(" (")[0])
    answer = nearlift("inspect", tmp_path / f"a.{suffix}")
    assert answer.exit_code == 0
    block = tomllib.loads(answer.stdout.split("\n\n", 1)[1])
    assert block["records"]["reader"] == found.reader
    assert block["records"]["files"] == f"{{trial}}.{suffix}"
    assert block["records"]["force"]["column"] == found.force.name
    if name not in ("mat", "csv"):
        assert block["records"]["force"]["unit"] == unit
    if name in ("lvm", "tdms", "hdf5", "text"):
        assert float(block["load_cell"]["sample_rate"].split()[0]) == pytest.approx(1000)


@pytest.mark.parametrize(
    ("content", "reader"),
    [
        (b"t,F\n0.1,2\n0.2,3\n", "csv"),
        (b"F\n1\n2\n", "csv"),
        (b"t;F\n0.1;2\n0.2;3\n", "text"),
        (b"a log of 12:30\nt,F\n0.1,2\n0.2,3\n", "csv"),
        (b"# t,F\n0.1,2\n0.2,3\n", "csv"),
        (b"t,F\n s,N\n0.1,2\n0.2,3\n", "csv"),
    ],
)
def test_plain_csv_gets_the_reader_of_plain_csv_and_all_other_text_that_of_text(
    tmp_path, content, reader
):
    assert inspect(written.put(tmp_path, "a.csv", content)).reader == reader
    both = [
        written.put(tmp_path, "rig/a.csv", content),
        written.put(tmp_path, "rig/b.csv", b"t,F\n0.1,2\n0.2,3\n"),
    ]
    if b"t" in content:
        # one reader for all
        assert nearlift("new", tmp_path / "campaign", "--from", *both).exit_code == 0
        assert (
            tomllib.loads((tmp_path / "campaign" / "campaign.toml").read_text())["records"][
                "reader"
            ]
            == reader
        )


RAMP = (
    b"START\r\n"
    + b"".join(b"%d,%.2f,%d\r\n" % (20 * i, -0.1 * i, 7) for i in range(60))
    + b"STOP\r\n"
)


def test_what_a_refusal_proposes_can_be_said_and_is_in_the_block(tmp_path):
    path = written.put(tmp_path, "ramp.txt", RAMP)
    refused = nearlift("inspect", path)
    assert refused.exit_code == 4
    assert 'dialect = { ignore = ["STOP"] }' in refused.stderr
    said = '{ ignore = ["START", "STOP"], columns = ["t", "thrust", "n"], units = ["ms", "N", ""] }'
    answer = nearlift("inspect", path, "--dialect", said)
    found = tomllib.loads(answer.stdout.split("\n\n", 1)[1])
    assert found["records"]["dialect"] == tomllib.loads("x = " + said)["x"]
    assert found["records"]["time"] == {"column": "t", "unit": "ms"}
    assert found["load_cell"]["sample_rate"] == "50 Hz"
    assert "sign = 1}   # sign = -1 if lift makes these numbers negative" in answer.stdout
    made = nearlift("new", tmp_path / "c", "--from", path, "--dialect", said.strip("{}"))
    assert made.exit_code == 0, made.stderr
    manifest = tomllib.loads((tmp_path / "c" / "campaign.toml").read_text())
    assert manifest["records"]["dialect"] == found["records"]["dialect"]
    for wrong, code, text in (
        ("columns = [", 2, "is not as a manifest has it"),
        ("colums = 1", 2, "did you mean 'columns'?"),
    ):
        answer = nearlift("inspect", path, "--dialect", wrong)
        assert (answer.exit_code, text in answer.stderr) == (code, True)


def test_two_readings_are_parted_by_what_the_refusal_asks_for(tmp_path):
    path = written.put(tmp_path, "a.csv", b"force\n" + b"1,234\n" * 60)
    refused = nearlift("inspect", path)
    assert (refused.exit_code, 'dialect = { decimal = "," }' in refused.stderr) == (4, True)
    answer = nearlift("inspect", path, "--dialect", 'decimal = ","')
    assert (answer.exit_code, "1.234" in answer.stdout) == (0, True)


def test_what_a_file_does_not_say_of_clock_rate_and_numbers_is_said(tmp_path):
    path = written.put(
        tmp_path,
        "a.csv",
        b"t,force\n"
        + b"".join(b"%d,%s\n" % (i, b"OVER" if i % 10 == 3 else b"2.5") for i in range(60)),
    )
    answer = nearlift("inspect", path).stdout
    assert "note: 6 of 60 samples of 'force' hold no number" in answer
    assert 'time = {column = "t", unit = "FILL IN"}' in answer


def test_json_for_machines(tmp_path):
    path = written.put(tmp_path, "a.lvm", written.lvm(FORCE))
    found = json.loads(nearlift("inspect", path, "--json").stdout)
    assert found["force"] == "Force"
    assert [c["samples"] for c in found["channels"]] == [60] * 3


@pytest.mark.parametrize(
    ("content", "text"),
    [
        (b"", "is empty"),
        (b"\x1f\x8b\x08", "is compressed"),
        (b"\x89HDF\r\n\x1a\nnothing", "cannot be read"),
        (b"t,F\n", "holds no channel of numbers"),
        (b"PAR1 and no more", "cannot be read"),
    ],
)
def test_4_for_a_file_that_cannot_be_read(tmp_path, content, text):
    answer = nearlift("inspect", written.put(tmp_path, "a.bin", content))
    assert answer.exit_code == 4
    assert text in answer.stderr
    assert "Traceback" not in answer.output


def test_4_for_what_is_no_file(tmp_path):
    assert "is missing" in nearlift("inspect", tmp_path / "no").stderr
    told = nearlift("inspect", tmp_path).stderr
    assert "is not a regular file" in told
    assert "`nearlift new DIR --from FOLDER` takes them all" in told


def test_a_clock_without_a_unit_says_which_rate_seconds_would_make(tmp_path):
    rows = "".join(f"{i / 500:.3f},{0.1 + i % 7 / 100}\n" for i in range(100))
    path = written.put(tmp_path, "a.csv", b"time,force\n" + rows.encode())
    assert 'unit = "FILL IN"}   # in s the rate is 500 Hz' in nearlift("inspect", path).stdout


def test_sparklines():
    assert sparkline(np.arange(8.0)) == BARS
    assert sparkline(np.array([])) == ""
    assert sparkline(np.full(5, 3.0)) == BARS[4] * 5
    assert sparkline(np.array([0.0, np.nan, 1.0])) == BARS[0] + " " + BARS[-1]


@pytest.mark.parametrize("sensors", [2, 3])
def test_several_sensors_under_one_stamp_are_said(tmp_path: Path, sensors: int) -> None:
    rows = [f"{i / 50:.2f},{k},{5 * k + (i % 3) / 10}" for i in range(60) for k in range(sensors)]
    path = written.put(tmp_path, "a.csv", "\n".join(["t_s,unit,F_N", *rows, ""]).encode())
    said = nearlift("inspect", path).stdout
    assert f"each time of 't_s' has {sensors} rows" in said
    assert "'unit' numbers them" in said


def test_a_counter_that_wraps_is_said(tmp_path):
    force = np.where(np.arange(320) >= 120, 300.0 - 39946, 0.0) + np.random.default_rng(2).normal(
        0, 1, 320
    )
    path = tmp_path / "r.csv"
    path.write_text(sweeps.text_of({"t_s": np.arange(320) / 80, "thrust_g": force}))
    said = nearlift("inspect", path).stdout
    assert "a counter of the converter that wraps" in said
    assert "sign = -1" not in said
