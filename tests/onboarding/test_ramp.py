"""A sweep of the throttle that is given as one trial is found, with lines that cut it."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
from tests.unit import small_run, sweeps, written
from tests.unit.small_run import nearlift

from nearlift.onboarding.inspection import inspect
from nearlift.readers.sweep import is_sweep
from nearlift.stages.ingest import TRIALS


def ramp(z_hat: float, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """A throttle that climbs without a stop, at rest for 2 s before; force in mN."""
    t = np.arange(round(42 * sweeps.RATE)) / sweeps.RATE
    throttle = np.where(t < 2, 0.0, 30 + 1.5 * (t - 2))
    lift = np.array([sweeps.lift_N(z_hat, x) for x in throttle])
    force = lift * (1 + rng.normal(0, 0.003, len(t))) + rng.normal(0, sweeps.NOISE_N, len(t))
    return {"t": t, "throttle": throttle, "force": np.round(1e3 * force, 4)}


def held(rng: np.random.Generator, lift_N: float = 0.4) -> dict[str, np.ndarray]:
    """One trial: rotors at rest, spun up, held."""
    t = np.arange(1600) / sweeps.RATE
    lift = lift_N * (1 - np.exp(-np.maximum(t - 2, 0) / 0.2))
    force = lift + rng.normal(0, 0.01, len(t))
    return {"t": t, "throttle": 50.0 * (t > 2), "force": 1e3 * force}


def campaign(folder: Path, records: dict[str, dict[str, np.ndarray]]) -> Path:
    """Records as one trial each."""
    for name, columns in records.items():
        written.put(folder, f"runs/{name}.csv", sweeps.text_of(columns).encode())
    rows = "".join(f"{name},ground,{20 + 9 * k},50\n" for k, name in enumerate(records))
    (folder / "trials.csv").write_text("trial,boundary,distance,throttle\n" + rows)
    (folder / "campaign.toml").write_text(
        """
schema = "nearlift.campaign/1"
name = "stand"
vehicle = { name = "rotor", rotors = 1, rotor_radius = "23 mm", mass = "27 g" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.8 m/s^2" }
load_cell = { sample_rate = "80 Hz", tare = "2 s", settle = "2 s" }
[records]
reader = "csv"
files = "runs/{trial}.csv"
force = { column = "force", unit = "mN", sign = 1 }
time = { column = "t", unit = "s" }
[trials.units]
distance = "mm"
throttle = "percent"
"""
    )
    return folder


def test_what_moves_and_what_does_not() -> None:
    rng, n = np.random.default_rng(1), np.arange(2000)
    noise = rng.normal(0, 0.01, 2000)
    for force in (sweeps.sweep(2.0, rng)["force"], ramp(2.0, rng)["force"]):
        assert is_sweep(force)
        assert is_sweep(-force)
    for _ in range(20):
        assert not is_sweep(held(rng)["force"])
        assert not is_sweep(rng.normal(0, 1, 2000))
    # a battery that sags by a tenth, a step by a fifth
    assert not is_sweep(1 - 0.1 * n / 2000 + noise)
    assert not is_sweep(np.where(n < 900, 1.0, 1.2) + noise)
    # three levels, a factor of 1.2 apart in all, and of 1.4
    assert not is_sweep(1 + 0.1 * (n // 700) + noise)
    assert is_sweep(1 + 0.2 * (n // 700) + noise)
    # a zero that is not tared
    for zero in (-0.3, -0.05, 0.05, 0.3):
        assert not is_sweep(zero + np.where(n < 700, 0.0, 0.25) + noise / 7)
        assert is_sweep(zero + np.repeat([0.0, 0.1, 0.2, 0.4], 500) + noise / 7)


@pytest.mark.parametrize(
    ("kind", "cut"),
    [
        ("steps", {"column": "throttle", "unit": "percent"}),
        ("ramp", {"cut": "windows"}),
        ("steps of no command", {"cut": "plateaus"}),
    ],
)
def test_inspect_tells_a_sweep_and_prints_lines_that_cut_it(
    tmp_path: Path, kind: str, cut: dict[str, str]
) -> None:
    make = ramp if kind == "ramp" else sweeps.sweep
    columns = make(2.0, np.random.default_rng(2))
    if kind == "steps of no command":
        del columns["throttle"]
    path = tmp_path / "r0.csv"
    path.write_text(sweeps.text_of(columns))
    answer = nearlift("inspect", path).stdout
    assert ("takes many lifts, along 'throttle'" in answer) == ("throttle" in columns)
    assert ("5 levels that hold" in answer) == (kind == "steps")
    assert "nearlift inspect --cuts CAMPAIGN" in answer
    block = tomllib.loads(answer.split("\n\n", 1)[1])
    assert block["records"]["files"] == "{record}.csv"
    assert cut.items() <= block["segments"].items()
    if kind == "ramp":
        throttle = {"column": "throttle", "unit": "percent"}
        assert block["segments"]["columns"]["throttle"] == throttle
        assert block["levels"] == {"by": "curve", "of": ["throttle"]}
    said = json.loads(nearlift("inspect", path, "--json").stdout)
    assert said["sweep"].startswith("takes many lifts")


@pytest.mark.parametrize(
    ("channel", "keys"),
    [
        (("ESC signal (µs)", 1000, 10), ["zero = 1000", "full = 2000"]),
        (("cmd", 0, 655.35), ["full = 65535"]),
        (("pwm", 0, 10.23), ["full = 1023"]),
        (("duty", 0, 0.01), ['unit = "fraction"']),
    ],
)
def test_what_a_commands_numbers_mean(
    tmp_path: Path, channel: tuple[str, float, float], keys: list[str]
) -> None:
    name, zero, factor = channel
    own = sweeps.sweep(2.0, np.random.default_rng(4), (0, 40, 60, 100, 0))
    own = {"t": own["t"], name: zero + factor * own["throttle"], "force": own["force"]}
    path = tmp_path / "r.csv"
    path.write_text(sweeps.text_of(own))
    swept = inspect(path).ramp
    assert swept is not None
    assert all(key in swept.segments for key in keys)


def test_ingest_rejects_sweeps_and_says_how_to_cut_them(tmp_path: Path) -> None:
    rng = np.random.default_rng(6)
    records = {f"t{k}": held(rng, 0.3 + 0.01 * k) for k in range(4)}
    root = campaign(tmp_path / "a" / "raw", {**records, "s1": sweeps.sweep(2.0, rng)})
    answer = nearlift("ingest", root, "--out", tmp_path / "a")
    assert answer.exit_code == 3
    assert "s1: MIXED" in answer.stderr
    assert "call the schedule's column of ids record" in answer.stderr
    assert "proposes for the record (runs/s1.csv)" in answer.stderr
    root = campaign(tmp_path / "b" / "raw", {f"s{k}": sweeps.sweep(1 + k, rng) for k in range(3)})
    answer = nearlift("ingest", root, "--out", tmp_path / "b")
    assert answer.exit_code == 4
    assert "the record takes many lifts" in answer.stderr
    assert "(3 records, such as runs/s0.csv)" in answer.stderr


def test_error_codes_of_a_converter_make_no_sweep_of_one_lift() -> None:
    rng = np.random.default_rng(4)
    counts = held(rng)["force"]
    counts[rng.random(len(counts)) < 0.03] = 2**23 - 1
    assert not is_sweep(counts)
    # the stretches of a short record hold three samples
    short = np.repeat([0.0, 300.0], [80, 160]) + rng.normal(0, 0.5, 240)
    for code in (-9999.0, 32767.0):
        assert not is_sweep(np.where(rng.random(240) < 0.05, code, short))


@pytest.mark.nightly
def test_ramps_cut_as_proposed_give_the_coefficient(tmp_path: Path) -> None:
    rng = np.random.default_rng(9)
    z_hats = np.repeat([0.7, 0.9, 1.2, 1.8, 3.0, 8.0], 2)
    records = {f"s{k}": ramp(z, rng) for k, z in enumerate(z_hats)}
    root = campaign(tmp_path / "raw", records)
    block = nearlift("inspect", root / "runs" / "s0.csv").stdout
    cut = block[block.rindex("[segments]") :]
    manifest = (root / "campaign.toml").read_text().replace("{trial}", "{record}")
    (root / "campaign.toml").write_text(
        manifest.replace('throttle = "percent"', "").replace(', settle = "2 s"', "") + cut
    )
    rows = [f"s{k},ground,{23 * z:.3f}\n" for k, z in enumerate(z_hats)]
    (root / "trials.csv").write_text("record,boundary,distance\n" + "".join(rows))
    for stage in ("ingest", "fit"):
        answer = nearlift(stage, root, "--out", tmp_path)
        assert answer.exit_code in (0, 3), answer.output
    trials = small_run.job(root, tmp_path).read(TRIALS)
    assert len(set(trials["throttle"].tolist())) > 60
    whole = json.loads((tmp_path / "processed/stand/fit.json").read_text())
    entry = whole["boundaries"]["ground"]["cheeseman_bennett"]
    assert entry["levels"]["curve"]["of"] == ["throttle"]
    k = entry["parameters"]["k"]
    assert abs(k["value"] - 1.0) < 4 * k["u"]
    assert k["u"] < 0.05
