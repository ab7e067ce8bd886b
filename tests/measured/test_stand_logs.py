"""Logs of real stands from file to fit. Each was measured far from any boundary; near records are
the same log with its thrust times a known ratio, so that the truth of the coefficient is known
while noise, clocks, marks and throttles are the stand's own.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from tests.unit.small_run import nearlift

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason="the measured files of ../shared are not here"
)
Z_HATS = (0.7, 0.8, 0.95, 1.2, 1.6, 2.5, 5.0, 10.0)
RADIUS_MM = 100.0
HEAD = """
schema = "nearlift.campaign/1"
name = "stand"
vehicle = { name = "rotor", rotors = 1, rotor_radius = "100 mm", mass = "0.5 kg" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.80665 m/s^2" }
[trials]
file = "records.csv"
units = { distance = "mm" }
"""


def ratio(z_hat: float) -> float:
    """Cheeseman and Bennett."""
    return 1 / (1 - 1 / (16 * z_hat**2))


def column_times(text: str, column: int, factor: float) -> str:
    """Rows of numbers between commas with one column times a factor; other lines as they are."""
    lines = []
    for line in text.splitlines():
        cells = line.split(",")
        try:
            cells[column] = f"{factor * float(cells[column]):.10g}"
        except (ValueError, IndexError):
            lines.append(line)
        else:
            lines.append(",".join(cells))
    return "\n".join(lines) + "\n"


def fitted(
    folder: Path, log: Path, manifest: str, near: Callable[[str, float], str]
) -> dict[str, float]:
    """The coefficient from records at eight distances, by way of ingest and fit."""
    root = folder / "raw"
    (root / "runs").mkdir(parents=True)
    text = log.read_text(encoding="utf-8-sig")
    rows = []
    for k, z in enumerate(Z_HATS):
        (root / "runs" / f"r{k}{log.suffix}").write_text(near(text, ratio(z)), encoding="utf-8")
        rows.append(f"r{k},ground,{RADIUS_MM * z:g}\n")
    (root / "records.csv").write_text("record,boundary,distance\n" + "".join(rows))
    # keys before tables
    (root / "campaign.toml").write_text(HEAD.replace("[trials]", f"{manifest}\n[trials]", 1))
    for stage in ("ingest", "fit"):
        answer = nearlift(stage, root, "--out", folder)
        assert answer.exit_code in (0, 3), answer.output
    drawn = nearlift("inspect", "--cuts", root, "--out", folder)
    assert drawn.exit_code == 0
    assert (folder / "reports/stand/segments.png").is_file()
    whole = json.loads((folder / "processed/stand/fit.json").read_text())
    found: dict[str, float] = whole["boundaries"]["ground"]["cheeseman_bennett"]["parameters"]["k"]
    return found


def test_steps_of_an_rcbenchmark(tmp_path: Path) -> None:
    """Steps of the ESC signal with ramps between, 8 rows a second."""
    log = DATA / "rcbenchmark-logs" / "aerostack2_xNova-SR-steps-up.csv"
    manifest = """
load_cell = { sample_rate = "8.03913 Hz", tare = "none", accuracy = "0.05 N" }
[records]
reader = "rcbenchmark"
files = "runs/{record}.csv"
force = { column = "Thrust (N)", unit = "N", sign = -1 }
[segments]
by = "ESC signal (µs)"
zero = 1000
full = 2000
settle = "1 s"
shortest = "0.7 s"
columns = { supply = { column = "Voltage (V)", unit = "V" } }
"""
    k = fitted(tmp_path, log, manifest, lambda t, f: column_times(t, 9, f))
    assert abs(k["value"] - 1.0) < 0.05


def test_a_ramp_of_a_hobby_stand_between_marks(tmp_path: Path) -> None:
    """START, a hundred levels of 17 rows at 84 a second, STOP, and rows that follow."""
    log = DATA / "pitt-ras-iarc7-thrust" / "v2_static" / "apc_12_6.txt"
    manifest = """
load_cell = { sample_rate = "84 Hz", tare = "none", accuracy = "5 gf" }
[records]
reader = "text"
files = "runs/{record}.txt"
dialect = { columns = ["thrust", "current", "voltage", "power", "throttle", "loop", "t"], ignore = ["START", "STOP"] }
force = { column = "thrust", unit = "kgf", sign = 1 }
[segments]
by = "windows"
length = "0.6 s"
settle = "0 s"
shortest = "0.5 s"
columns = { throttle = { column = "throttle", unit = "percent" }, supply = { column = "voltage", unit = "V" } }
[levels]
by = "curve"
of = ["throttle"]
[quality]
drift = 1.0
"""
    k = fitted(tmp_path, log, manifest, lambda t, f: column_times(t, 0, f))
    assert abs(k["value"] - 1.0) < 0.05
