"""The campaign that `nearlift new` writes, empty and from files."""

from __future__ import annotations

import gzip
import shutil
import tomllib
import unicodedata
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from tests.unit import small_run, sweeps, written
from tests.unit.small_run import nearlift

from nearlift.campaign import manifest as manifests
from nearlift.run import tables
from nearlift.stages.ingest import TRIALS

FORCE = [float(x) for x in np.round(np.linspace(0.1, 3, 60), 3)]


TABLE = "surface;distance_cm;pwm;rpm_mean;fz_n\n" + "".join(
    f"ceiling;{d};{p};2000,5;{(p - 1000) / 100 * (1 + 0.3 / d):.3f}\n".replace(".", ",")
    for d in (5, 10, 20, 40)
    for p in (1100, 1200, 1300)
)


def new(folder: Path, *files: Path) -> tuple[dict[str, Any], list[str], str]:
    """Manifest and lines of the schedule that `new` makes of files, and its answer."""
    answer = nearlift("new", folder, "--from", *files)
    assert answer.exit_code == 0, answer.output
    manifest = tomllib.loads((folder / "campaign.toml").read_text(encoding="utf-8"))
    return manifest, (folder / "trials.csv").read_text().splitlines(), answer.stdout


def test_a_table_of_means_becomes_a_campaign_of_means(tmp_path):
    path = written.put(tmp_path, "table.csv", TABLE.encode())
    assert "fz_n -> lift" in nearlift("inspect", path).stdout
    manifest, rows, _ = new(tmp_path / "c", path)
    units = {"distance": "cm", "throttle": "FILL IN", "rpm": "rpm", "lift": "N"}
    assert manifest["trials"]["units"] == units
    assert manifest["trials"]["order"] == "FILL IN"
    assert "load_cell" not in manifest
    text = (tmp_path / "c" / "campaign.toml").read_text()
    assert "# below 45 rows, as a column" in text
    assert rows[0] == "trial,boundary,distance,throttle,rpm,lift"
    assert rows[1] == "1,ceiling,5,1100,2000.5,1.060"
    assert len(rows) == 13


def test_a_schedule_without_its_manifest_gets_one_and_stays(tmp_path):
    folder = small_run.write_means(tmp_path / "c", 24)
    (folder / "campaign.toml").unlink()
    before = (folder / "trials.csv").read_bytes()
    manifest, _, _ = new(folder, folder / "trials.csv")
    assert (folder / "trials.csv").read_bytes() == before
    assert manifest["records"]["reader"] == "means"
    # another schedule is not overwritten, and nothing is half made
    (folder / "campaign.toml").unlink()
    (folder / "trials.csv").write_text("a,b\n1,2\n")
    other = written.put(tmp_path, "table.csv", TABLE.encode())
    refused = nearlift("new", folder, "--from", other)
    assert (refused.exit_code, "is there already" in refused.stderr) == (2, True)
    assert not (folder / "campaign.toml").exists()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    """Records, and a spreadsheet that lists them under names of its own."""
    folder = small_run.write(tmp_path_factory.mktemp("rig") / "c", visits=1)
    listed = pd.read_csv(folder / "trials.csv")
    units = manifests.load(folder).trials.units
    sheet = pd.DataFrame(
        {
            "file": listed["trial"] + ".csv",
            "surface": "ground",
            f"height_{units['distance']}": listed["distance"],
            f"thr ({units['throttle']})": listed["throttle"],
            "session": listed["session"],
        }
    )
    sheet.to_csv(folder / "trials" / "lab book.csv", index=False)
    return folder


def test_records_and_the_table_that_lists_them_make_a_campaign_that_runs(recorded, tmp_path):
    folder = tmp_path / "new"
    manifest, _, _ = new(folder, recorded / "trials")
    assert "FILL IN" not in str(manifest["trials"])
    assert not (folder / "trials" / "lab book.csv").exists()
    written.fill_in(folder)
    for root in (folder, recorded):
        assert nearlift("ingest", root, "--out", tmp_path).exit_code == 0
    ours, theirs = (
        tables.read_table(tmp_path / "processed" / name / "trials.parquet", TRIALS)
        for name in ("new", "small")
    )
    for column in ("trial", "boundary", "z_hat", "throttle", "lift_N"):
        assert (ours[column] == theirs[column]).all()


def listed(folder: Path, *rows: str) -> Path:
    """Three records of rotors that spin up slowly, and a list with these rows."""
    t = np.arange(240) / 80
    force = 300 * (1 - np.exp(-np.maximum(t - 1, 0) / 0.25)) + np.sin(9999 * t)
    text = "t_s,force_gf\n" + "".join(f"{a:.4f},{b:.2f}\n" for a, b in zip(t, force, strict=True))
    for name in ("höhe 1", "höhe 2", "höhe 3"):
        written.put(folder, unicodedata.normalize("NFD", f"{name}.csv"), text.encode())
    written.put(
        folder, "list.csv", "\n".join(["record,height_mm,throttle_pct", *rows, ""]).encode()
    )
    return folder


def test_a_list_names_records_in_any_case_and_form_and_their_throttle_makes_no_sweep(tmp_path):
    rows = ("HÖHE 1,20,50", "Höhe 2.csv,30,50", "höhe 3,40,50")
    manifest, lines, _ = new(tmp_path / "c", listed(tmp_path / "rig", *rows))
    assert "segments" not in manifest
    assert lines[0].startswith("trial,record,distance,throttle")
    wanted = [unicodedata.normalize("NFD", f"höhe {i}") for i in (1, 2, 3)]
    assert [line.partition(",")[0] for line in lines[1:]] == wanted
    refused = nearlift("new", tmp_path / "d", "--from", listed(tmp_path / "rig", rows[0], rows[2]))
    plain = unicodedata.normalize("NFC", refused.stderr)
    assert (refused.exit_code, "lists 2 of 3 records, and not höhe 2\n" in plain) == (4, True)


def test_a_schedule_in_the_folder_serves_its_records_and_is_no_record(recorded, tmp_path):
    folder = shutil.copytree(recorded, tmp_path / "c")
    (folder / "campaign.toml").unlink()
    (folder / "trials" / "lab book.csv").unlink()
    refused = nearlift("new", folder, "--from", folder)
    assert (refused.exit_code, "name the records" in refused.stderr) == (2, True)
    assert not (folder / "campaign.toml").exists()
    manifest, _, told = new(folder, folder / "trials")
    assert told.splitlines()[0] == str(folder / "campaign.toml")
    assert manifest["records"]["files"] == "trials/{trial}.csv"
    assert set(manifest["trials"]["units"].values()) == {"FILL IN"}


def test_one_long_table_of_parquet_makes_a_campaign(tmp_path):
    small_run.write(tmp_path / "c", form="parquet", visits=1)
    manifest, rows, _ = new(tmp_path / "new", tmp_path / "c" / "records.parquet")
    records = manifest["records"]
    assert (records["reader"], records["files"]) == ("parquet", "records.parquet")
    listed = pd.read_csv(tmp_path / "c" / "trials.csv")["trial"].tolist()
    assert sorted(row.partition(",")[0] for row in rows[1:]) == sorted(listed)
    # a schedule next to the table is kept
    (tmp_path / "c" / "campaign.toml").unlink()
    _, rows, _ = new(tmp_path / "c", tmp_path / "c" / "records.parquet")
    assert [row.partition(",")[0] for row in rows[1:]] == listed
    both = [tmp_path / "c" / "records.parquet", tmp_path / "new" / "records.parquet"]
    refused = nearlift("new", tmp_path / "other", "--from", *both)
    assert (refused.exit_code, "names 2 tables" in refused.stderr) == (2, True)


def test_the_head_and_sign_of_a_long_table_are_those_of_its_trials(tmp_path):
    """Rest is short, so that the table as a whole shows neither."""
    t, force = sweeps.started(1.0, 0.0, 80, 1, 8.0)
    trials = [pd.DataFrame({"trial": f"t{i}", "t_s": t, "force_N": -force}) for i in range(6)]
    pd.concat(trials).to_parquet(tmp_path / "rec.parquet", index=False)
    manifest, _, _ = new(tmp_path / "c", tmp_path / "rec.parquet")
    cell = manifest["load_cell"]
    assert (cell["sample_rate"], cell["tare"]) == ("80 Hz", "0.91 s")
    assert (float(cell["settle"].split()[0]) < 1, manifest["records"]["force"]["sign"]) == (
        True,
        -1,
    )


def test_records_alone_give_a_manifest_with_the_rest_to_fill_in(tmp_path):
    paths = [written.put(tmp_path, f"rig/run {i}.lvm", written.lvm(FORCE)) for i in range(3)]
    written.put(tmp_path, "rig/.hidden", b"no record")
    folder = tmp_path / "camp\u00e4gne"
    made, rows, told = new(folder, tmp_path / "rig")
    assert made["name"] == "campagne"
    assert made["records"] == {
        "reader": "lvm",
        "files": "trials/{trial}.lvm",
        "force": {"column": "Force", "unit": "N", "sign": 1},
        "time": {"column": "X_Value", "unit": "s"},
    }
    assert made["load_cell"]["sample_rate"] == "1000 Hz"
    assert "FILL IN" in made["rig"]["gravity"]
    assert rows[1:] == [f"run {i},FILL IN,FILL IN,FILL IN,4" for i in range(3)]
    assert (folder / "trials" / "run 2.lvm").read_bytes() == paths[2].read_bytes()
    assert "[[uncertainty]] of rotor radius and rotor spacing" in told
    # what is not filled in is refused by key
    blank = nearlift("run", folder, "--out", tmp_path)
    assert blank.exit_code == 2
    for key in (
        "vehicle.name: 'FILL IN'",
        "rig.distance_datum: 'FILL IN'",
        "rig.gravity: 'FILL IN m/s^2'",
        "load_cell.tare: 'FILL IN s'",
    ):
        assert f"{key} is still to be filled in" in blank.stderr
    again = nearlift("new", folder, "--from", *paths)
    assert (again.exit_code, "is there already" in again.stderr) == (2, True)


def test_files_in_the_folder_stay_and_both_endings_are_no_part_of_a_trials_name(tmp_path):
    for i in range(2):
        content = gzip.compress(written.rcbenchmark(FORCE))
        written.put(tmp_path, f"c/data/r.{i}.csv.gz", content)
    listing = b"file,height_mm\nlogs/r.0.csv.gz,20\nlogs/r.1.csv.gz,30\n"
    written.put(tmp_path, "c/data/list.csv", listing)
    manifest, rows, _ = new(tmp_path / "c", tmp_path / "c" / "data")
    assert manifest["records"]["files"] == "data/{trial}.csv.gz"
    assert rows[1:] == ["r.0,logs/r.0.csv.gz,20,4.01", "r.1,logs/r.1.csv.gz,30,4.01"]
    assert not (tmp_path / "c" / "trials").exists()


@pytest.mark.parametrize("listed", [False, True])
def test_sweeps_are_cut_and_asked_for_no_throttle(tmp_path, listed):
    rng, rows = np.random.default_rng(1), "record,distance_mm\n"
    for k in range(2):
        content = sweeps.text_of(sweeps.sweep(1.0 + k, rng))
        written.put(tmp_path / "logs", f"s{k}.csv", content.encode())
        rows += f"s{k},{23 + 9 * k}\n"
    if listed:
        written.put(tmp_path / "logs", "list.csv", rows.encode())
    made, schedule, _ = new(tmp_path / "stand", tmp_path / "logs")
    assert made["records"]["files"] == "trials/{record}.csv"
    assert made["segments"]["column"] == "throttle"
    assert set(made["trials"]["units"]) == {"distance"}
    blank = ["record,boundary,distance", "s0,FILL IN,FILL IN", "s1,FILL IN,FILL IN"]
    assert schedule == (["record,distance", "s0,23", "s1,32"] if listed else blank)


def test_new_refuses_a_mixture_a_folder_without_files_and_half_a_call(tmp_path):
    a = written.put(tmp_path, "a.lvm", written.lvm(FORCE))
    b = written.put(tmp_path, "b.csv", written.rcbenchmark(FORCE))
    (tmp_path / "none").mkdir()
    c = tmp_path / "c"
    for code, text, *words in (
        (4, "with other channels than a.lvm", c, "--from", a, b),
        (2, "holds no files", c, "--from", tmp_path / "none"),
        (2, "names no files", c, "--from"),
        (2, "is missing before the files", c, a),
    ):
        answer = nearlift("new", *words)
        assert (answer.exit_code, text in answer.stderr) == (code, True), answer.stderr
        assert not c.exists()


def test_new_takes_along_what_records_and_lists_hold(tmp_path: Path) -> None:
    (tmp_path / "rig").mkdir()
    for k in range(3):
        t, force = sweeps.started(1.0, 0.02, 100, k)
        columns = {"t_s": t, "thrust_g": force, "Voltage (V)": np.full(len(t), 16.0 - 0.5 * k)}
        (tmp_path / "rig" / f"r{k}.csv").write_text(sweeps.text_of(columns))
    lines = "".join(f"r{k}.csv,ground,{20 + k},50,{1 + k}\n" for k in range(3))
    (tmp_path / "rig" / "list.csv").write_text("file,surface,h_mm,thr_pct,Day\n" + lines)
    (tmp_path / "rig" / "README.txt").write_text("Kind: records of a bench\n")
    manifest, rows, told = new(tmp_path / "c", tmp_path / "rig")
    assert "supply, the mean of 'Voltage (V)'" in told
    assert "not taken as records: README.txt" in told
    assert rows[0] == "trial,file,boundary,distance,throttle,session,supply"
    assert rows[3] == "r2,r2.csv,ground,22,50,3,15"
    units = {"distance": "mm", "throttle": "percent", "supply": "V"}
    assert manifest["trials"]["units"] == units
