"""What `nearlift inspect` and `nearlift new --from` propose: nothing that no file says, and what can
be used as it stands.
"""

from __future__ import annotations

import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.unit import small_run, written
from tests.unit.small_run import nearlift

from nearlift.campaign import manifest as manifests
from nearlift.campaign.parsing import validated
from nearlift.campaign.piv import Piv
from nearlift.onboarding import headings
from nearlift.onboarding.inspection import inspect
from nearlift.readers.base import Channel
from nearlift.run import tables
from nearlift.stages.ingest import TRIALS


def channels(*columns: tuple[str, str]) -> list[Channel]:
    return [Channel(name=name, unit=unit, values=np.arange(5.0)) for name, unit in columns]


@pytest.mark.parametrize(
    ("columns", "force"),
    [
        ((("u1[N]", "N"), ("u2[N]", "N"), ("fz[mN]", "mN")), "fz[mN]"),
        ((("u1[N]", "N"), ("u2[N]", "N")), None),
        ((("thrust_cmd", "N"), ("thrust", "N")), "thrust"),
        ((("motor 1 (N)", "N"), ("F", "N")), "F"),
        ((("setpoint", "N"), ("t", "s")), None),
        ((("Thrust target (gf)", "gf"), ("Thrust (gf)", "gf")), "Thrust (gf)"),
        ((("pwm", ""), ("vbat", "V"), ("thrust_g", "g")), "thrust_g"),
        # no telling which
        ((("A", "N"), ("B", "N")), None),
        ((("fz1", "N"), ("fz2", "N")), None),
        ((("motor thrust (N)", "N"), ("rpm", "rpm")), "motor thrust (N)"),
    ],
)
def test_a_motors_command_is_no_force_and_of_two_forces_none_is_picked(columns, force):
    found = headings.likely_force(channels(*columns))
    assert (found and found.name) == force


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("t_s", ("t", "s")),
        ("h_m", ("h", "m")),
        ("vbat_V", ("vbat", "V")),
        ("Thrust (gf)", ("Thrust", "gf")),
        ("fz_n", ("fz", "N")),
        ("millis", ("millis", "ms")),
        # counts, and names that end like a unit by chance
        ("sample_n", ("sample_n", "")),
        ("m_1", ("m_1", "")),
        ("_s", ("_s", "")),
        ("rows", ("rows", "")),
    ],
)
def test_units_stand_in_names(name, meant):
    assert headings.named(name) == meant


def test_units_from_names_reach_the_block_with_the_rate_of_the_clock(tmp_path):
    lines = "".join(f"{i / 200},{0.1},{3.9},{9.5 + i % 3}\n" for i in range(60))
    path = written.put(tmp_path, "a.csv", ("t_s,h_m,vbat_V,thrust_g\n" + lines).encode())
    block = tomllib.loads(nearlift("inspect", path).stdout.split("\n\n", 1)[1])
    assert block["load_cell"]["sample_rate"] == "200 Hz"
    assert block["records"]["force"] == {"column": "thrust_g", "unit": "gf", "sign": 1}
    assert block["records"]["time"] == {"column": "t_s", "unit": "s"}


def test_a_rate_that_cannot_be_is_no_rate(tmp_path):
    """Microseconds under a header that says ms; the clock is left out, or every record would be
    refused for its unit.
    """
    lines = "".join(f"{10_000 * i},{200 + i % 3}\n" for i in range(60))
    path = written.put(tmp_path, "a.csv", ("t[ms],fz[mN]\n" + lines).encode())
    told = nearlift("inspect", path).stdout
    assert "note: the file says 0.1 Hz, which no load cell has" in told
    assert "its clock is in us (100 Hz)" in told
    block = tomllib.loads(told.split("\n\n", 1)[1])
    assert block["load_cell"]["sample_rate"] == "FILL IN Hz"
    assert "time" not in block["records"]
    made = nearlift("new", tmp_path / "c", "--from", path)
    assert 'sample_rate = "FILL IN Hz"' in made.stdout
    for rate, clock in ((100.0, "s"), (1.0, "s"), (1e6, "us")):
        assert not headings.doubtful_rate(rate, channels(("t", clock))[0])
    assert headings.doubtful_rate(3e6, None)


GRID = (
    'TITLE="a" VARIABLES="X mm", "Y mm", "U m/s", "V m/s", "CHC", ZONE I=6, J=5, F=POINT\n'
    + "".join(
        f"{2 * i}, {2 * j}, {0.1 * i - 0.2}, {-1 - 0.1 * j}, 1\n"
        for j in range(5)
        for i in range(6)
    )
)


def test_a_velocity_grid_gets_a_piv_section_that_can_be_filled_in(tmp_path):
    path = written.put(tmp_path, "free.vec", GRID.encode())
    told = nearlift("inspect", path).stdout
    assert "velocity grid, TSI Insight" in told
    assert "[records]" not in told
    text = told.split("\n\n", 1)[1]
    for blank, value in (
        ('thrust   = "FILL IN"', 'thrust = "+y"'),
        ('"FILL IN mm"', '"1 mm"'),
        ('z_hat    = "FILL IN"', "z_hat = 1.5"),
    ):
        text = text.replace(blank, value)
    section = validated(Piv, tomllib.loads(text)["piv"], "it")
    assert (section.control, section.format) == ("free", "insight")
    assert section.case[0].files == "piv/free/*.vec"
    refused = nearlift("new", tmp_path / "c", "--from", path)
    assert (refused.exit_code, "no record of force" in refused.stderr) == (2, True)
    assert not (tmp_path / "c").exists()


def test_a_grid_in_pixels_is_asked_for_its_scale(tmp_path):
    rows = "".join(
        f"{16 * i} {16 * j} 0.5 -2.5 {30 + i}\n" for j in range(1, 5) for i in range(1, 6)
    )
    section = tomllib.loads(
        nearlift("inspect", written.put(tmp_path, "a.txt", rows.encode())).stdout.split("\n\n", 1)[
            1
        ]
    )["piv"]
    assert section["format"] == "openpiv"
    blank = {key for key, value in section.items() if "FILL IN" in str(value)}
    assert {"length_unit", "velocity_unit", "scale", "frame_time"} <= blank


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
    assert "lift_sd, if it is known: 12 rows without it give no diagnosis" in made.stdout
    rows = (tmp_path / "c" / "trials.csv").read_text().splitlines()
    assert rows[0] == "trial,boundary,distance,throttle,rpm,lift"
    assert rows[1] == "1,ceiling,5,1100,2000.5,1.060"
    assert len(rows) == 13


def test_what_every_row_lacks_is_filled_in_once(tmp_path):
    plain = "\n".join(line.partition(";")[2] for line in TABLE.splitlines())
    path = written.put(tmp_path, "table.csv", plain.encode() + b"\n")
    assert nearlift("new", tmp_path / "c", "--from", path).exit_code == 0
    manifest = tomllib.loads((tmp_path / "c" / "campaign.toml").read_text())
    assert manifest["trials"]["constants"] == {"boundary": "FILL IN"}


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
    assert "more trials" not in made.stdout
    written.fill_in(folder)
    ran = nearlift("ingest", folder, "--out", tmp_path)
    assert ran.exit_code == 0, ran.output
    ours = tables.read_table(tmp_path / "processed" / "new" / "trials.parquet", TRIALS)
    assert nearlift("ingest", recorded, "--out", tmp_path).exit_code == 0
    theirs = tables.read_table(tmp_path / "processed" / "small" / "trials.parquet", TRIALS)
    for column in ("trial", "boundary", "z_hat", "throttle", "lift_N"):
        assert (ours[column] == theirs[column]).all()


def test_too_few_trials_for_a_diagnosis_are_told_before_the_run(tmp_path):
    for i in range(40):
        written.put(tmp_path, f"rig/r{i}.csv", b"t_s,F_N\n0,1\n0.1,1\n0.2,1\n")
    rows = "".join(f"r{i},ground,{20 + i // 4},{25 * (1 + i % 4)}\n" for i in range(40))
    written.put(tmp_path, "rig/list.csv", f"name,surface,h_mm,thr_percent\n{rows}".encode())
    made = nearlift("new", tmp_path / "c", "--from", tmp_path / "rig")
    assert "more trials, if there are any: 40 near a boundary give a coefficient, 45" in made.stdout


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
    from nearlift.onboarding.new import trial_of

    assert [trial_of(name) for name in ("a.csv", "a.1.txt.gz", "a")] == ["a", "a.1", "a"]


def test_a_record_of_a_logger_is_neither_grid_nor_table(tmp_path):
    force = [float(x) for x in np.round(np.linspace(0.1, 3, 60), 3)]
    for name, (write, _, _, suffix) in written.WRITERS.items():
        found = inspect(written.put(tmp_path, f"{name}.{suffix}", write(force)))
        assert (found.grid, found.table) == (None, None), name
