"""`nearlift inspect`, `nearlift new --from` and `nearlift run --check`: what they say, and that what
they print can be used.
"""

from __future__ import annotations

import json
import shutil
import tomllib

import numpy as np
import pytest
from tests.unit import small_run, written
from tests.unit.small_run import nearlift

from nearlift.onboarding.inspection import inspect
from nearlift.onboarding.shown import BARS, sparkline

FORCE = [float(x) for x in np.round(np.linspace(0.1, 3, 60), 3)]


@pytest.mark.parametrize("name", list(written.WRITERS))
def test_every_format_is_recognised_and_its_block_names_the_reader_and_the_force(tmp_path, name):
    write, column, unit, suffix = written.WRITERS[name]
    found = inspect(written.put(tmp_path, f"a.{suffix}", write(FORCE)))
    assert found.reader == name
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
        (b"a log of 12:30\nt,F\n0.1,2\n0.2,3\n", "text"),
        (b"# t,F\n0.1,2\n0.2,3\n", "text"),
        (b"t,F\n s,N\n0.1,2\n0.2,3\n", "text"),
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


def test_a_table_of_parquet(tmp_path):
    small_run.write(tmp_path / "c", form="parquet")
    answer = nearlift("inspect", tmp_path / "c" / "records.parquet")
    assert 'reader = "parquet"' in answer.stdout
    assert 'files  = "records.parquet"' in answer.stdout


def test_numbers_without_names_are_shown_with_the_recipe_to_read_them(tmp_path):
    path = written.put(tmp_path, "a.txt", b"".join(b"%d\r\n" % (960 + i % 7) for i in range(100)))
    found = tomllib.loads(nearlift("inspect", path).stdout.split("\n\n", 1)[1])
    assert found["records"]["dialect"] == {"columns": ["column 1"]}
    assert found["load_cell"]["sample_rate"] == "FILL IN Hz"


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


def test_new_from_files_writes_what_they_say_and_marks_the_rest(tmp_path):
    paths = [written.put(tmp_path, f"rig/run {i}.lvm", written.lvm(FORCE)) for i in range(3)]
    answer = nearlift("new", tmp_path / "camp\u00e4gne", "--from", *paths)
    assert answer.exit_code == 0
    made = tomllib.loads((tmp_path / "camp\u00e4gne" / "campaign.toml").read_text(encoding="utf-8"))
    assert made["name"] == "campagne"
    assert made["records"] == {
        "reader": "lvm",
        "files": "trials/{trial}.lvm",
        "force": {"column": "Force", "unit": "N", "sign": 1},
        "time": {"column": "X_Value", "unit": "s"},
    }
    assert made["load_cell"]["sample_rate"] == "1000 Hz"
    assert "FILL IN" in made["rig"]["gravity"]
    rows = (tmp_path / "camp\u00e4gne" / "trials.csv").read_text().splitlines()
    assert rows[1:] == [f"run {i},FILL IN,FILL IN,FILL IN,4" for i in range(3)]
    assert (tmp_path / "camp\u00e4gne" / "trials" / "run 2.lvm").read_bytes() == paths[
        2
    ].read_bytes()
    assert "still to fill in:" in answer.stdout
    # what is not filled in is refused by key
    blank = nearlift("run", tmp_path / "camp\u00e4gne", "--out", tmp_path)
    assert blank.exit_code == 2
    for key in (
        "vehicle.name: 'FILL IN'",
        "rig.distance_datum: 'FILL IN'",
        "rig.gravity: 'FILL IN m/s^2'",
        "load_cell.tare: 'FILL IN s'",
    ):
        assert f"{key} is still to be filled in" in blank.stderr
    again = nearlift("new", tmp_path / "camp\u00e4gne", "--from", *paths)
    assert (again.exit_code, "is there already" in again.stderr) == (2, True)


def test_new_from_a_folder_takes_all_its_files(tmp_path):
    for i in range(3):
        written.put(tmp_path, f"rig/{i}.lvm", written.lvm(FORCE))
    written.put(tmp_path, "rig/.hidden", b"no record")
    assert nearlift("new", tmp_path / "c", "--from", tmp_path / "rig").exit_code == 0
    assert [
        row.partition(",")[0]
        for row in (tmp_path / "c" / "trials.csv").read_text().splitlines()[1:]
    ] == ["0", "1", "2"]
    (tmp_path / "none").mkdir()
    empty = nearlift("new", tmp_path / "d", "--from", tmp_path / "none")
    assert (empty.exit_code, "holds no files" in empty.stderr) == (2, True)
    assert not (tmp_path / "d").exists()


def test_new_from_files_in_the_folder_leaves_them_where_they_are(tmp_path):
    paths = [written.put(tmp_path, f"c/data/{i}.csv", written.rcbenchmark(FORCE)) for i in range(2)]
    assert nearlift("new", tmp_path / "c", "--from", *paths).exit_code == 0
    assert (
        tomllib.loads((tmp_path / "c" / "campaign.toml").read_text(encoding="utf-8"))["records"][
            "files"
        ]
        == "data/{trial}.csv"
    )
    assert not (tmp_path / "c" / "trials").exists()


def test_new_from_sweeps_cuts_them_and_asks_for_no_throttle(tmp_path):
    throttle = np.repeat([0, 40, 60, 80, 0], 320)
    lift = 12 * throttle**1.5 + np.random.default_rng(1).normal(0, 2, len(throttle))
    table = np.c_[np.arange(len(throttle)) / 80, throttle, lift]
    (tmp_path / "sweeps").mkdir()
    for k in range(2):
        path = tmp_path / "sweeps" / f"r{k}.csv"
        np.savetxt(path, table, "%.4f", ",", header="t,throttle,force", comments="")
    answer = nearlift("new", tmp_path / "stand", "--from", tmp_path / "sweeps")
    assert answer.exit_code == 0
    made = tomllib.loads((tmp_path / "stand" / "campaign.toml").read_text())
    assert made["records"]["files"] == "trials/{record}.csv"
    assert made["segments"]["by"] == "throttle"
    assert set(made["trials"]["units"]) == {"distance"}
    schedule = (tmp_path / "stand" / "trials.csv").read_text().splitlines()
    assert schedule == ["record,boundary,distance", "r0,FILL IN,FILL IN", "r1,FILL IN,FILL IN"]


def test_new_refuses_a_mixture(tmp_path):
    a, b = (
        written.put(tmp_path, "a.lvm", written.lvm(FORCE)),
        written.put(tmp_path, "b.csv", written.rcbenchmark(FORCE)),
    )
    answer = nearlift("new", tmp_path / "c", "--from", a, b)
    assert (answer.exit_code, "with other channels than a.lvm" in answer.stderr) == (4, True)
    assert not (tmp_path / "c").exists()
    for words in ((tmp_path / "c", "--from"), (tmp_path / "c", a)):
        assert nearlift("new", *words).exit_code == 2


def test_check_finds_what_is_not_what_it_was(tmp_path):
    raw = small_run.write_means(tmp_path / "raw", 24)
    assert nearlift("ingest", raw, "--out", tmp_path, "-q").exit_code == 0
    whole = nearlift("run", "--check", raw, "--out", tmp_path)
    assert (whole.exit_code, whole.stdout) == (0, "3 of 3 files are what they were\n")
    product = tmp_path / "processed" / "means" / "trials.parquet"
    content = bytearray(product.read_bytes())
    content[200] ^= 1
    product.write_bytes(bytes(content))
    (raw / "trials.csv").unlink()
    spoilt = nearlift("run", "--check", raw, "--out", tmp_path)
    assert spoilt.exit_code == 4
    assert "trials.csv: is missing" in spoilt.stdout
    assert "trials.parquet: is not what it was" in spoilt.stdout
    shutil.rmtree(tmp_path / "processed")
    assert nearlift("run", "--check", raw, "--out", tmp_path).exit_code == 4


@pytest.mark.parametrize(
    "content",
    [
        {},
        {"inputs": [], "stages": {}},
        {"inputs": {"a": 1}, "stages": {}},
        {"inputs": {}, "stages": {"fit": 3}},
    ],
)
def test_check_refuses_a_provenance_that_nearlift_does_not_write(tmp_path, content):
    raw = small_run.write_means(tmp_path / "raw", 24)
    (tmp_path / "processed" / "means").mkdir(parents=True)
    (tmp_path / "processed" / "means" / "provenance.json").write_text(json.dumps(content))
    answer = nearlift("run", "--check", raw, "--out", tmp_path)
    assert (answer.exit_code, "is not what nearlift writes" in answer.stderr) == (4, True)
