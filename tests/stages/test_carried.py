"""Moments and wall forces: kept with lift, with units and uncertainty, never fitted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from tests.unit import small_run, sweeps
from tests.unit.bench_campaign import run_ingest
from tests.unit.small_run import nearlift

from nearlift.errors import ManifestError
from nearlift.observed import observe
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT

MANIFEST = """
schema = "nearlift.campaign/1"
name = "wall"
vehicle = { name = "quadrotor", rotors = 1, rotor_radius = "127 mm", mass = "1 kg" }
rig = { held = "throttle", distance_datum = "blade tip", distance_offset = "0 mm", gravity = "9.8 m/s^2" }
records = { reader = "means" }
fit = { sidewall = { rivals = [] } }
[trials]
order = "unknown"
[trials.units]
distance = "cm"
throttle = "percent"
lift = "N"
lift_sd = "N"
wall_force = "mN"
roll_moment = "mN*m"
u_roll_moment = "mN*m"
[trials.constants]
boundary = "sidewall"
lift_sd = 0.05
"""


def moment_Nm(z_cm: float, throttle: float) -> float:
    """A wall's pull, as it might be."""
    return 4e-4 * throttle * float(np.exp(-z_cm / 12))


def campaign(folder: Path) -> Path:
    """Two rounds of five distances by four throttles."""
    folder.mkdir()
    rng = np.random.default_rng(1)
    lines = ["trial,distance,throttle,lift,wall_force,roll_moment,u_roll_moment"]
    for i, (z, t) in enumerate((z, t) for z in (5, 9, 15, 25, 40) for t in (30, 45, 60, 75) * 2):
        lift = 0.1 * t * (1 - 0.05 * np.exp(-z / 10)) + rng.normal(0, 0.02)
        moment = 1e3 * (moment_Nm(z, t) + rng.normal(0, 2e-4))
        lines.append(f"t{i:02d},{z},{t},{lift:.5f},{-2 * moment:.5f},{moment:.5f},0.2")
    (folder / "campaign.toml").write_text(MANIFEST)
    (folder / "trials.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    out = tmp_path_factory.mktemp("carried")
    root = campaign(out / "raw")
    for stage in ("ingest", "reduce"):
        done = nearlift(stage, root, "--out", out)
        assert done.exit_code == 0, done.output
    return root, out


def test_units_and_uncertainty_ride_along(ran: tuple[Path, Path]) -> None:
    job = small_run.job(*ran)
    trials, cells = job.read(TRIALS), job.read(LIFT)
    assert np.abs(trials["roll_moment_Nm"]).max() < 0.05
    np.testing.assert_allclose(trials["u_roll_moment_Nm"], 2e-4)
    # two trials a cell: their own uncertainty over root two, or their scatter where it is larger
    assert (cells["u_roll_moment_Nm"] >= 2e-4 / np.sqrt(2) * (1 - 1e-12)).all()
    columns = ("z_hat", "throttle", "roll_moment_Nm", "u_roll_moment_Nm")
    for z, t, mean, u in zip(*(cells[name] for name in columns), strict=True):
        assert mean == pytest.approx(moment_Nm(12.7 * z, 100 * t), abs=5 * u + 5e-4)
    np.testing.assert_allclose(cells["wall_force_N"], -2 * cells["roll_moment_Nm"], rtol=1e-3)
    # without a stated uncertainty the scatter of the two is all there is
    assert np.isfinite(cells["u_wall_force_N"]).all()


def test_an_outcome_is_no_condition_of_lift(ran: tuple[Path, Path]) -> None:
    job = small_run.job(*ran)
    data = observe(job.read(TRIALS), job.campaign, "sidewall")
    assert not [name for name in data.covariates if "moment" in name or "wall" in name]


def test_a_campaign_without_them_has_no_such_chapter(tmp_path: Path) -> None:
    root = campaign(tmp_path / "raw")
    lines = [",".join(line.split(",")[:4]) for line in (root / "trials.csv").read_text().split()]
    (root / "trials.csv").write_text("\n".join(lines) + "\n")
    kept = [line for line in MANIFEST.splitlines() if "moment" not in line and "wall_" not in line]
    (root / "campaign.toml").write_text("\n".join(kept) + "\n")
    for stage in ("ingest", "reduce"):
        assert nearlift(stage, root, "--out", tmp_path).exit_code == 0
    assert "roll_moment_Nm" not in small_run.job(root, tmp_path).read(LIFT)


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('roll_moment = "mN*m"\nu_roll', "u_roll", "roll_moment"),
        ('\nroll_moment = "mN*m"', '\nroll_moment = "N"', "'N' is not a unit of torque"),
    ],
)
def test_a_moment_without_a_unit_or_in_newtons_is_refused(
    tmp_path: Path, old: str, new: str, text: str
) -> None:
    root = campaign(tmp_path / "raw")
    (root / "campaign.toml").write_text(MANIFEST.replace(old, new))
    answer = nearlift("ingest", root, "--out", tmp_path)
    assert (answer.exit_code, text in answer.stderr) == (2, True)


def test_pieces_of_a_record_bring_a_moment_less_its_zero(tmp_path: Path) -> None:
    root = sweeps.write(tmp_path / "raw")
    rng = np.random.default_rng(2)
    for path in sorted((root / "sweeps").glob("*.csv")):
        table = pd.read_csv(path)
        noise = rng.normal(0, 0.05, len(table))
        table.assign(torque=0.7 + 0.01 * table["throttle"] + noise).to_csv(path, index=False)
    cut = {"columns": {"pitch_moment": {"column": "torque", "unit": "mN*m"}}}
    _, job = run_ingest(root, tmp_path, sweeps.campaign(cut))
    trials = job.read(TRIALS)
    want = 1e-5 * np.array([40.0, 60.0, 80.0] * 3)
    u = trials["u_pitch_moment_Nm"]
    # 240 samples, and 160 of the zero
    np.testing.assert_allclose(u, 5e-5 * np.sqrt(1 / 240 + 1 / 160), rtol=0.5)
    assert (np.abs(trials["pitch_moment_Nm"] - want) < 5 * u).all()
    wrong = {"columns": {"pitch_moment": {"column": "torque", "unit": "N"}}}
    with pytest.raises(ManifestError, match="is not a unit of torque"):
        run_ingest(root, tmp_path / "wrong", sweeps.campaign(wrong))
