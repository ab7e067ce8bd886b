"""Logs of real stands from file to fit. Each was measured far from any boundary. Near records are
the same log with its thrust times a known ratio: the truth of the coefficient is known, while
noise, clocks, marks and throttles are the stand's own.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.unit.small_run import nearlift

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"{DATA} is not here")
Z_HATS = (0.7, 0.8, 0.95, 1.2, 1.6, 2.5, 5.0, 10.0)
RADIUS_MM = 100.0
HEAD = """
schema = "nearlift.campaign/1"
name = "stand"
vehicle = { name = "rotor", rotors = 1, rotor_radius = "100 mm", mass = "0.5 kg" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.80665 m/s^2" }
"""
TRIALS = """
[trials]
file = "records.csv"
units = { distance = "mm" }
"""
#: Steps of the ESC signal with ramps between, 8 rows a second.
RCBENCHMARK = """
load_cell = { sample_rate = "8.03913 Hz", tare = "none", accuracy = "0.05 N" }
[records]
reader = "rcbenchmark"
files = "runs/{record}.csv"
force = { column = "Thrust (N)", unit = "N", sign = -1 }
[segments]
column = "ESC signal (µs)"
zero = 1000
full = 2000
settle = "1 s"
shortest = "0.7 s"
columns = { supply = { column = "Voltage (V)", unit = "V" } }
"""
#: START, a hundred levels of 17 rows at 84 a second, STOP, and rows that follow.
RAMP = """
load_cell = { sample_rate = "84 Hz", tare = "none", accuracy = "5 gf" }
[records]
reader = "text"
files = "runs/{record}.txt"
dialect = { columns = ["thrust", "current", "voltage", "power", "throttle", "loop", "t"], ignore = ["START", "STOP"] }
force = { column = "thrust", unit = "kgf", sign = 1 }
[segments]
cut = "windows"
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


@pytest.mark.parametrize(
    ("log", "thrust", "manifest"),
    [
        ("rcbenchmark-logs/aerostack2_xNova-SR-steps-up.csv", 9, RCBENCHMARK),
        ("pitt-ras-iarc7-thrust/v2_static/apc_12_6.txt", 0, RAMP),
    ],
)
@pytest.mark.nightly
def test_the_coefficient_comes_back(log: str, thrust: int, manifest: str, tmp_path: Path) -> None:
    root, path = tmp_path / "raw", DATA / log
    (root / "runs").mkdir(parents=True)
    text = path.read_text(encoding="utf-8-sig")
    rows = ["record,boundary,distance"]
    for k, z in enumerate(Z_HATS):
        near = column_times(text, thrust, 1 / (1 - 1 / (16 * z**2)))
        (root / "runs" / f"r{k}{path.suffix}").write_text(near, encoding="utf-8")
        rows.append(f"r{k},ground,{RADIUS_MM * z:g}")
    (root / "records.csv").write_text("\n".join(rows) + "\n")
    (root / "campaign.toml").write_text(HEAD + manifest + TRIALS)
    for stage in ("ingest", "fit"):
        answer = nearlift(stage, root, "--out", tmp_path)
        assert answer.exit_code in (0, 3), answer.output
    assert nearlift("inspect", "--cuts", root, "--out", tmp_path).exit_code == 0
    assert (tmp_path / "reports/stand/segments.png").is_file()
    fits = json.loads((tmp_path / "processed/stand/fit.json").read_text())["boundaries"]["ground"]
    assert fits["cheeseman_bennett"]["parameters"]["k"]["value"] == pytest.approx(1.0, abs=0.05)
