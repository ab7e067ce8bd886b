"""The manifest's tables that `inspect` and `new` propose: nothing that no file says."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit import sweeps, written
from tests.unit.small_run import nearlift

from nearlift.campaign.manifest import validated
from nearlift.campaign.piv import Piv
from nearlift.campaign.rig import Segments
from nearlift.onboarding.inspection import inspect
from nearlift.onboarding.shown import block, notes


def proposed(path: Path, **columns: np.ndarray) -> dict[str, Any]:
    """The manifest's tables for a record with these columns."""
    path.write_text(sweeps.text_of(columns))
    return tomllib.loads(block(inspect(path)))


def test_the_cells_own_counts_are_no_throttle(tmp_path: Path) -> None:
    own = sweeps.sweep(2.0, np.random.default_rng(11))
    counts = np.round(-500_000 + 1000 * own["force"])
    for name in ("thrust_raw", "HX711 counts", "load cell adc"):
        columns = {"t_s": own["t"], name: counts, "force_mN": own["force"]}
        whole = proposed(tmp_path / "r.csv", **columns, throttle_pct=own["throttle"])
        assert whole["segments"]["column"] == "throttle_pct"
        assert name not in str(proposed(tmp_path / "r.csv", **columns)["segments"])


@pytest.mark.parametrize(("hold", "clock"), [(8, False), (8, True), (25, True), (4, False)])
def test_a_staircase_of_short_levels_is_cut_as_a_ramp(
    tmp_path: Path, hold: int, clock: bool
) -> None:
    steps = np.concatenate([np.full(200, 500.0), np.repeat(np.arange(1000.0, 60_000, 900), hold)])
    force = 1e-8 * steps**2 + np.random.default_rng(3).normal(0, 0.02, len(steps))
    columns = {"t_s": np.arange(len(steps)) / 100.0} if clock else {}
    tables = proposed(tmp_path / "ramp.csv", **columns, pwm=steps, thrust_g=force)
    assert tables["segments"]["cut"] == "windows"
    assert tables["levels"]["by"] == "curve"


@pytest.mark.parametrize("seconds", [0.5, 1.0, 4.0])
def test_proposed_cuts_keep_the_levels(tmp_path: Path, seconds: float) -> None:
    """Without a clock nothing is given in seconds: it could not be tried."""
    throttle = np.repeat([0.0, 30, 45, 60, 75, 0], round(seconds * 100))
    force = 0.02 * throttle**1.8 + np.random.default_rng(4).normal(0, 0.3, len(throttle))
    columns = {"throttle (%)": throttle, "thrust_g": force}
    clock = {"t_s": np.arange(len(throttle)) / 100}
    cut = validated(Segments, proposed(tmp_path / "s.csv", **clock, **columns)["segments"], "it")
    assert cut.column == "throttle (%)"
    assert cut.settle + cut.shortest < seconds
    assert proposed(tmp_path / "s.csv", **columns)["segments"]["settle"] == "FILL IN s"
    levels = f"levels last {100 * seconds:.0f} samples"
    assert levels in nearlift("inspect", tmp_path / "s.csv").stdout


def test_names_proposed_for_numbers_without_names_are_read_by_the_same_reader(
    tmp_path: Path,
) -> None:
    rows = "".join(f"{i} x {200 + i % 5}\n" for i in range(80))
    path = written.put(tmp_path, "a.txt", rows.encode())
    dialect = tomllib.loads(block(inspect(path)))["records"]["dialect"]
    assert dialect == {"columns": ["column 1", "column 2", "column 3"]}
    assert inspect(path, dialect).reader == "text"


@pytest.mark.parametrize("zero", [0.0, 700.0, -700.0, 100.0])
@pytest.mark.parametrize("way", [1, -1])
def test_the_sign_is_that_of_the_change_from_rest(tmp_path: Path, zero: float, way: int) -> None:
    """Whatever a cell reads at rest, in a record of one lift and in a sweep from rest."""
    t, force = sweeps.started(1.5, 0.05, 100, 7)
    tables = proposed(tmp_path / "one.csv", t_s=t, thrust_g=zero + way * force)
    assert tables["records"]["force"]["sign"] == way
    columns = sweeps.sweep(2.0, np.random.default_rng(6))
    force = {"force_mN": way * columns["force"]}
    tables = proposed(
        tmp_path / "r.csv", t_s=columns["t"], **force, throttle_pct=columns["throttle"]
    )
    assert tables["records"]["force"]["sign"] == way


def test_codes_of_a_converter_are_no_start(tmp_path: Path) -> None:
    t, force = sweeps.started(1.5, 0.05, 100, 7)
    force[20:40] = force[250:260] = -32768.0
    tables = proposed(tmp_path / "a.csv", t_s=t, thrust_g=force)
    assert tables["load_cell"]["tare"] == "1.3 s"
    assert tables["records"]["force"]["sign"] == 1


def test_without_a_rest_the_sign_is_asked_for(tmp_path: Path) -> None:
    columns = {"t_s": np.arange(400) / 100, "thrust_g": -300 + np.sin(np.arange(400.0))}
    assert proposed(tmp_path / "a.csv", **columns)["records"]["force"]["sign"] == 1
    assert "sign = -1 if lift makes" in block(inspect(tmp_path / "a.csv"))


def test_new_proposes_a_tare_and_settling_with_a_margin(tmp_path: Path) -> None:
    (tmp_path / "rig").mkdir()
    for k in range(8):
        t, force = sweeps.started(1.0 + 0.02 * (k % 3), 0.05, 100, k)
        columns = {"t_s": np.round(t, 4), "thrust_g": np.round(force, 3)}
        (tmp_path / "rig" / f"r{k}.csv").write_text(sweeps.text_of(columns))
    assert nearlift("new", tmp_path / "c", "--from", tmp_path / "rig").exit_code == 0
    text = (tmp_path / "c" / "campaign.toml").read_text()
    cell = tomllib.loads(text)["load_cell"]
    tare, settle = (float(cell[key].split()[0]) for key in ("tare", "settle"))
    assert 0.85 <= tare <= 0.95
    assert 1.12 <= tare + settle <= 1.5
    assert "# rotors at rest: they start at 1" in text


def test_a_rate_that_cannot_be_is_no_rate(tmp_path):
    """Microseconds under a header that says ms; the clock is left out, or every record would be
    refused for its unit.
    """
    lines = "".join(f"{10_000 * i},{200 + i % 3}\n" for i in range(60))
    seen = inspect(written.put(tmp_path, "a.csv", ("t[ms],fz[mN]\n" + lines).encode()))
    (note,) = notes(seen)
    assert "the file says 0.1 Hz, which no load cell has" in note
    assert "its clock is in another unit" in note
    tables = tomllib.loads(block(seen))
    assert tables["load_cell"]["sample_rate"] == "FILL IN Hz"
    assert "time" not in tables["records"]


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
    rows = (f"{16 * i} {16 * j} 0.5 -2.5 {30 + i}\n" for j in range(1, 5) for i in range(1, 6))
    pixels = tomllib.loads(block(inspect(written.put(tmp_path, "a.txt", "".join(rows).encode()))))
    blank = {key for key, value in pixels["piv"].items() if "FILL IN" in str(value)}
    assert {"length_unit", "velocity_unit", "scale", "frame_time"} <= blank
    assert (section.control, section.format) == ("free", "insight")
    assert section.case[0].files == "piv/free/*.vec"
    refused = nearlift("new", tmp_path / "c", "--from", path)
    assert (refused.exit_code, "no record of force" in refused.stderr) == (2, True)
    assert not (tmp_path / "c").exists()
