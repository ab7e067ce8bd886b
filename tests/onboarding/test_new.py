"""The campaign that `nearlift new` writes, empty and from files."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.unit import small_run, sweeps, written
from tests.unit.small_run import nearlift

from nearlift.campaign import manifest as manifests
from nearlift.onboarding.new import trial_of
from nearlift.run import tables
from nearlift.stages.ingest import TRIALS

FORCE = [float(x) for x in np.round(np.linspace(0.1, 3, 60), 3)]


TABLE = "surface;distance_cm;pwm;rpm_mean;fz_n\n" + "".join(
    f"ceiling;{d};{p};2000,5;{(p - 1000) / 100 * (1 + 0.3 / d):.3f}\n".replace(".", ",")
    for d in (5, 10, 20, 40)
    for p in (1100, 1200, 1300)
)


def test_a_table_of_means_becomes_a_campaign_of_means(tmp_path):
    path = written.put(tmp_path, "table.csv", TABLE.encode())
    told = nearlift("inspect", path).stdout
    assert tomllib.loads(told.split("\n\n", 1)[1])["records"] == {"reader": "means"}
    assert "fz_n -> lift" in told
    made = nearlift("new", tmp_path / "c", "--from", path)
    assert made.exit_code == 0, made.output
    manifest = tomllib.loads((tmp_path / "c" / "campaign.toml").read_text())
    assert manifest["trials"]["units"] == {
        "distance": "cm",
        "throttle": "FILL IN",
        "rpm": "rpm",
        "lift": "N",
    }
    assert manifest["trials"]["order"] == "FILL IN"
    assert "load_cell" not in manifest
    assert "# below 45 rows, as a column" in (tmp_path / "c" / "campaign.toml").read_text()
    rows = (tmp_path / "c" / "trials.csv").read_text().splitlines()
    assert rows[0] == "trial,boundary,distance,throttle,rpm,lift"
    assert rows[1] == "1,ceiling,5,1100,2000.5,1.060"
    assert len(rows) == 13


def test_a_schedule_without_its_manifest_gets_one_and_stays(tmp_path):
    folder = small_run.write_means(tmp_path / "c", 24)
    (folder / "campaign.toml").unlink()
    before = (folder / "trials.csv").read_bytes()
    made = nearlift("new", folder, "--from", folder / "trials.csv")
    assert made.exit_code == 0, made.output
    assert (folder / "trials.csv").read_bytes() == before
    assert 'reader = "means"' in (folder / "campaign.toml").read_text()
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
    folder = small_run.write(tmp_path_factory.mktemp("rig") / "c")
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
    made = nearlift("new", folder, "--from", recorded / "trials")
    assert made.exit_code == 0, made.output
    manifest = tomllib.loads((folder / "campaign.toml").read_text())
    assert "FILL IN" not in str(manifest["trials"])
    assert not (folder / "trials" / "lab book.csv").exists()
    written.fill_in(folder)
    ran = nearlift("ingest", folder, "--out", tmp_path)
    assert ran.exit_code == 0, ran.output
    ours = tables.read_table(tmp_path / "processed" / "new" / "trials.parquet", TRIALS)
    assert nearlift("ingest", recorded, "--out", tmp_path).exit_code == 0
    theirs = tables.read_table(tmp_path / "processed" / "small" / "trials.parquet", TRIALS)
    for column in ("trial", "boundary", "z_hat", "throttle", "lift_N"):
        assert (ours[column] == theirs[column]).all()


def test_a_schedule_of_the_folder_is_found_beside_its_records(recorded, tmp_path):
    folder = shutil.copytree(recorded, tmp_path / "c")
    (folder / "campaign.toml").unlink()
    (folder / "trials" / "lab book.csv").unlink()
    made = nearlift("new", folder, "--from", folder / "trials")
    assert made.exit_code == 0, made.output
    assert made.stdout.splitlines()[0] == str(folder / "campaign.toml")
    manifest = tomllib.loads((folder / "campaign.toml").read_text())
    assert manifest["records"]["files"] == "trials/{trial}.csv"
    assert set(manifest["trials"]["units"].values()) == {"FILL IN"}


def test_a_schedule_by_itself_is_no_record(recorded, tmp_path):
    folder = shutil.copytree(recorded, tmp_path / "c")
    (folder / "campaign.toml").unlink()
    refused = nearlift("new", folder, "--from", folder)
    assert (refused.exit_code, "name the records" in refused.stderr) == (2, True)
    assert not (folder / "campaign.toml").exists()


def test_one_long_table_of_parquet_makes_a_campaign(tmp_path):
    small_run.write(tmp_path / "c", form="parquet")
    made = nearlift("new", tmp_path / "new", "--from", tmp_path / "c" / "records.parquet")
    assert made.exit_code == 0, made.output
    manifest = tomllib.loads((tmp_path / "new" / "campaign.toml").read_text())
    assert manifest["records"]["reader"] == "parquet"
    assert manifest["records"]["files"] == "records.parquet"
    listed = pd.read_csv(tmp_path / "c" / "trials.csv")["trial"].tolist()
    rows = (tmp_path / "new" / "trials.csv").read_text().splitlines()[1:]
    assert sorted(row.partition(",")[0] for row in rows) == sorted(listed)
    both = [tmp_path / "c" / "records.parquet", tmp_path / "new" / "records.parquet"]
    refused = nearlift("new", tmp_path / "other", "--from", *both)
    assert (refused.exit_code, "names 2 tables" in refused.stderr) == (2, True)


def test_compressed_records_keep_both_endings_out_of_the_trials_name():
    assert [trial_of(name) for name in ("a.csv", "a.1.txt.gz", "a")] == ["a", "a.1", "a"]


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


def test_sweeps_that_a_table_lists_as_records_keep_its_ids(tmp_path):
    rng, rows = np.random.default_rng(1), "record,distance_mm\n"
    for k in range(3):
        content = sweeps.text_of(sweeps.sweep(1.0 + k, rng))
        written.put(tmp_path / "logs", f"s{k}.csv", content.encode())
        rows += f"s{k},{23 + 9 * k}\n"
    written.put(tmp_path / "logs", "list.csv", rows.encode())
    made = nearlift("new", tmp_path / "c", "--from", tmp_path / "logs")
    assert made.exit_code == 0, made.output
    schedule = (tmp_path / "c" / "trials.csv").read_text()
    assert schedule == "record,distance\ns0,23\ns1,32\ns2,41\n"


def test_a_clock_that_is_called_by_its_unit_gives_the_rate(tmp_path):
    rows = "".join(f"{12.5 * i},{i % 7}\n" for i in range(200))
    path = written.put(tmp_path, "a.csv", b"ms,thrust_g\n" + rows.encode())
    assert 'sample_rate = "80 Hz"' in nearlift("inspect", path).output


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


def test_new_takes_along_what_records_and_lists_hold(tmp_path: Path) -> None:
    (tmp_path / "rig").mkdir()
    for k in range(3):
        t, force = sweeps.started(1.0, 0.02, 100, k)
        own = {"t_s": t, "thrust_g": force, "Voltage (V)": np.full(len(t), 16.0 - 0.5 * k)}
        (tmp_path / "rig" / f"r{k}.csv").write_text(sweeps.text_of(own))
    lines = "".join(f"r{k}.csv,ground,{20 + k},50,{1 + k}\n" for k in range(3))
    (tmp_path / "rig" / "list.csv").write_text("file,surface,h_mm,thr_pct,Day\n" + lines)
    (tmp_path / "rig" / "README.txt").write_text("Kind: records of a bench\n")
    made = nearlift("new", tmp_path / "c", "--from", tmp_path / "rig")
    assert made.exit_code == 0, made.output
    assert "supply, the mean of 'Voltage (V)'" in made.stdout
    assert "not taken as records: README.txt" in made.stdout
    rows = (tmp_path / "c" / "trials.csv").read_text().splitlines()
    assert rows[0] == "trial,file,boundary,distance,throttle,session,supply"
    assert rows[3] == "r2,r2.csv,ground,22,50,3,15"
    units = tomllib.loads((tmp_path / "c" / "campaign.toml").read_text())["trials"]["units"]
    assert units == {"distance": "mm", "throttle": "percent", "supply": "V"}


def test_every_new_manifest_asks_how_well_radius_and_spacing_are_known(tmp_path):
    files = [
        written.put(tmp_path, "t.csv", TABLE.encode()),
        written.put(tmp_path, "r.lvm", written.lvm(FORCE)),
    ]
    for i, more in enumerate(([], ["--from", files[0]], ["--from", files[1]])):
        made = nearlift("new", tmp_path / str(i), *more)
        assert "[[uncertainty]] of rotor radius and rotor spacing" in made.stdout
        text = (tmp_path / str(i) / "campaign.toml").read_text()
        for on in ("rotor_radius", "rotor_spacing"):
            assert re.search(rf'# on    = "{on}".*\n# value = "FILL IN percent"', text)
