"""Records of small loggers, cut at the lines that they write between their numbers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit import small_run, sweeps
from tests.unit.bench_campaign import run_ingest
from tests.unit.small_run import nearlift

from nearlift.errors import InputRefused
from nearlift.stages.ingest import TRIALS

PULSES = (40, 60, 80)
HOLD, HEAD = 320, 160


def force_N(z_hat: float, rng: np.random.Generator) -> list[tuple[str, np.ndarray]]:
    """Lines that begin a level, and the readings behind each; the head first, at rest."""
    rest = sweeps.ZERO_N + rng.normal(0, sweeps.NOISE_N, HEAD)
    found = [("", rest)]
    for pulse in PULSES:
        lift = sweeps.lift_N(z_hat, pulse) * (1 - np.exp(-np.arange(HOLD) / 8))
        found.append((f"PWM {pulse}", lift + sweeps.ZERO_N + rng.normal(0, sweeps.NOISE_N, HOLD)))
    return [*found, ("STOP", np.full(100, 9.9))]


def values_alone(z_hat: float, rng: np.random.Generator) -> str:
    """A value to a line, words between."""
    return "".join(
        f"{line}\n" * bool(line) + "".join(f"{1e3 * f:.4f}\n" for f in force)
        for line, force in force_N(z_hat, rng)
    )


def value_and_millis(z_hat: float, rng: np.random.Generator) -> str:
    """A value and its millis on alternate lines."""
    text, ms = "", 0.0
    for line, force in force_N(z_hat, rng):
        text += f"{line}\n" * bool(line)
        for f in force:
            text += f"{1e3 * f:.4f}\n{ms:.1f}\n"
            ms += 1000 / sweeps.RATE
    return text


WAYS = {"values alone": values_alone, "value and millis": value_and_millis}
DIALECT: dict[str, dict[str, Any]] = {
    "values alone": {"columns": ["force"]},
    "value and millis": {"columns": ["force", "millis"], "units": ["mN", "ms"], "lines": 2},
}
CUT = {
    "by": "markers",
    "begin": "PWM {level}",
    "end": "STOP",
    "unit": "percent",
    "settle": "1 s",
    "shortest": "2 s",
}


def write(folder: Path, way: str, z_hats: tuple[float, ...]) -> Path:
    rng = np.random.default_rng(3)
    (folder / "sweeps").mkdir(parents=True)
    for k, z in enumerate(z_hats):
        (folder / "sweeps" / f"r{k}.txt").write_text(WAYS[way](z, rng))
    rows = "".join(f"r{k},ground,{23 * z:g}\n" for k, z in enumerate(z_hats))
    (folder / "records.csv").write_text("record,boundary,distance\n" + rows)
    return folder


def campaign(way: str) -> Any:
    records = {
        "reader": "text",
        "files": "sweeps/{record}.txt",
        "dialect": DIALECT[way],
        "time": {"column": "millis", "unit": "ms"} if way == "value and millis" else None,
    }
    return sweeps.campaign(CUT, records=records)


@pytest.mark.parametrize("way", list(WAYS))
def test_lines_with_a_level_cut_a_record(tmp_path: Path, way: str) -> None:
    z_hats = (1.0, 2.0, 4.0)
    root = write(tmp_path / "raw", way, z_hats)
    _, job = run_ingest(root, tmp_path, campaign(way))
    trials = job.read(TRIALS)
    assert trials["trial"].tolist() == [f"r{k}#{n}" for k in range(3) for n in (1, 2, 3)]
    np.testing.assert_allclose(trials["throttle"], [0.4, 0.6, 0.8] * 3)
    # what follows STOP, and lies far off, is in none
    want = [sweeps.lift_N(z, t) for z in z_hats for t in PULSES]
    np.testing.assert_allclose(trials["lift_N"], want, atol=1.5e-3)
    assert not trials["quality"].any()


def test_a_record_without_its_marks_is_refused(tmp_path: Path) -> None:
    root = write(tmp_path / "raw", "values alone", (1.0, 2.0))
    lacking = sweeps.campaign(
        {**CUT, "begin": "LEVEL {level}", "end": None},
        records={
            "reader": "text",
            "files": "sweeps/{record}.txt",
            "dialect": {"columns": ["force"], "ignore": ["PWM *", "STOP"]},
            "time": None,
        },
    )
    with pytest.raises(InputRefused, match=r"has no line 'LEVEL \{level\}' with samples behind it"):
        run_ingest(root, tmp_path, lacking)


def test_from_marked_text_to_the_coefficient(tmp_path: Path) -> None:
    z_hats = (0.7, 0.8, 1.0, 1.3, 1.8, 2.5, 4.0, 8.0)
    root = write(tmp_path / "raw", "value and millis", z_hats)
    (root / "campaign.toml").write_text(
        """
schema = "nearlift.campaign/1"
name = "marks"
vehicle = { name = "rotor", rotors = 1, rotor_radius = "23 mm", mass = "27 g" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.8 m/s^2" }
load_cell = { sample_rate = "80 Hz", tare = "2 s" }
[records]
reader = "text"
files = "sweeps/{record}.txt"
dialect = { columns = ["force", "millis"], units = ["mN", "ms"], lines = 2 }
force = { column = "force", unit = "mN", sign = 1 }
time = { column = "millis", unit = "ms" }
[trials]
file = "records.csv"
units = { distance = "mm" }
[segments]
by = "markers"
begin = "PWM {level}"
end = "STOP"
unit = "percent"
settle = "1 s"
shortest = "2 s"
"""
    )
    for stage in ("ingest", "fit"):
        answer = nearlift(stage, root, "--out", tmp_path)
        assert answer.exit_code == 0, answer.output
    whole = json.loads((tmp_path / "processed/marks/fit.json").read_text())
    k = whole["boundaries"]["ground"]["cheeseman_bennett"]["parameters"]["k"]
    assert abs(k["value"] - 1.0) < 4 * k["u"]
    assert k["u"] < 0.05
    told = nearlift("inspect", "--cuts", root, "--out", tmp_path)
    assert "r0#1" in told.stdout
    assert (tmp_path / "reports/marks/segments.png").is_file()


def test_a_long_table_of_parquet_becomes_a_campaign(tmp_path: Path) -> None:
    small_run.write(tmp_path / "c", form="parquet")
    table = tmp_path / "c" / "records.parquet"
    answer = nearlift("new", tmp_path / "new", "--from", table)
    assert answer.exit_code == 0, answer.output
    made = (tmp_path / "new" / "campaign.toml").read_text()
    assert 'reader = "parquet"' in made
    assert 'files  = "records.parquet"' in made
    listed = (tmp_path / "new" / "trials.csv").read_text().splitlines()
    own = (tmp_path / "c" / "trials.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in listed[1:]] == sorted(
        line.split(",")[0] for line in own[1:]
    )
