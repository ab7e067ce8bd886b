"""Records and tables as people have them: what `inspect` and `new` make of each kind."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest
from tests.unit import small_run, sweeps, written
from tests.unit.small_run import nearlift

from nearlift.campaign.parsing import validated
from nearlift.campaign.segments import Segments
from nearlift.onboarding.inspection import inspect
from nearlift.reduction.start import start_of
from nearlift.reduction.wrap import wrap_of


def block_of(*words: object) -> dict[str, object]:
    """The manifest's tables that `inspect` prints."""
    answer = nearlift("inspect", *words)
    assert answer.exit_code == 0, answer.output
    return tomllib.loads(answer.stdout.split("\n\n", 1)[1])


def table(distance: str, throttle: str, lift: str, more: str = "") -> bytes:
    """A table of means under such headings: four distances at three throttles."""
    rows = [f"{distance},{throttle},{lift}{',' + more if more else ''}"]
    for h in (20, 35, 60, 200):
        for t in (40, 55, 70):
            rows.append(f"{h},{t},{t * t / 10 + 400 / h:.2f}{',1.5' if more else ''}")
    return ("\n".join(rows) + "\n").encode()


# ---- tables of means


@pytest.mark.parametrize(
    ("heading", "unit"),
    [
        ("Thrust mean (g)", "gf"),
        ("Avg Thrust (g)", "gf"),
        ("thrust_mean_g", "gf"),
        ("thrust_avg", "FILL IN"),
        ("Average thrust [gf]", "gf"),
        ("F_mean [N]", "N"),
        ("T (N)", "N"),
        ("F (N)", "N"),
        ("Thrust (lbs)", "lbf"),
        ("Thrust (g)", "gf"),
        ("Mean thrust", "FILL IN"),
        ("Lift (N)", "N"),
        ("lift_gf", "gf"),
        ("Schub [mN]", "mN"),
        ("measured by cell (kg)", "kgf"),
        ("Thrust (lbf) avg", "lbf"),
        ("F", "FILL IN"),
    ],
)
def test_a_table_of_means_is_seen_by_its_shape(tmp_path: Path, heading: str, unit: str) -> None:
    content = table("Height (mm)", "Throttle (%)", heading, "Std dev (g)")
    path = written.put(tmp_path, "t.csv", content)
    found = block_of(path)
    assert found["records"] == {"reader": "means"}
    assert found["trials"]["units"]["lift"] == unit
    assert found["trials"]["units"]["lift_sd"] == "gf"
    assert nearlift("new", tmp_path / "c", "--from", path).exit_code == 0
    header = (tmp_path / "c" / "trials.csv").read_text().splitlines()[0]
    assert header == "trial,distance,throttle,lift,lift_sd"


@pytest.mark.parametrize(
    ("distance", "throttle", "units"),
    [
        ("h/R", "Signal (us)", {"distance": "R", "throttle": "us"}),
        ("z/R", "duty", {"distance": "R", "throttle": "FILL IN"}),
        ("Height above floor [mm]", "ESC throttle (%)", {"distance": "mm", "throttle": "percent"}),
        ("d_cm", "PWM (us)", {"distance": "cm", "throttle": "us"}),
        ("Bodenabstand (mm)", "Gas (%)", {"distance": "mm", "throttle": "percent"}),
        ("gap/R", "Throttle %", {"distance": "R", "throttle": "percent"}),
        ("h_over_R", "duty_pct", {"distance": "R", "throttle": "percent"}),
    ],
)
def test_distance_and_throttle_as_tables_call_them(
    tmp_path: Path, distance: str, throttle: str, units: dict[str, str]
) -> None:
    path = written.put(tmp_path, "t.csv", table(distance, throttle, "F [N]"))
    found = block_of(path)
    assert found["records"] == {"reader": "means"}
    assert {k: found["trials"]["units"][k] for k in units} == units


def test_a_maximum_next_to_a_mean_is_no_lift_and_two_cells_are_no_table_of_means(
    tmp_path: Path,
) -> None:
    lines = table("h_mm", "thr_pct", "Max thrust (g)", "Mean thrust (g)")
    assert block_of(written.put(tmp_path, "a.csv", lines))["records"] == {"reader": "means"}
    made = nearlift("new", tmp_path / "c", "--from", tmp_path / "a.csv")
    assert made.exit_code == 0
    assert (tmp_path / "c" / "trials.csv").read_text().splitlines()[1].endswith(
        ",180.00,1.5"
    ) is False
    both = table("h_mm", "thr_pct", "left (N)", "right (N)")
    assert block_of(written.put(tmp_path, "b.csv", both)).get("records") != {"reader": "means"}


def test_a_record_in_steps_that_logs_its_distance_is_no_table_of_means(tmp_path: Path) -> None:
    rows = [f"{20 if i < 400 else 60},{50},{3 + (i % 7) / 10}" for i in range(800)]
    path = written.put(tmp_path, "r.csv", "\n".join(["h_mm,thr_pct,thrust_g", *rows, ""]).encode())
    assert inspect(path).table is None


def test_distances_in_rotor_radii_are_read_as_such(tmp_path: Path) -> None:
    root = small_run.write_means(tmp_path / "raw", 24)
    text = (root / "campaign.toml").read_text()
    rows = (root / "trials.csv").read_text().splitlines()
    place = rows[0].split(",").index("distance")
    cells = [row.split(",") for row in rows[1:]]
    for row in cells:
        row[place] = f"{float(row[place]) / 23:.6f}"
    (root / "trials.csv").write_text("\n".join([rows[0], *map(",".join, cells)]) + "\n")
    (root / "campaign.toml").write_text(text.replace('distance = "mm"', 'distance = "R"'))
    from nearlift.campaign import manifest as manifests
    from nearlift.schedule import read_schedule

    schedule = read_schedule(manifests.load(root), root)
    expected = [float(row[place]) for row in cells]
    assert schedule.z_hat == pytest.approx(expected, rel=1e-5)


# ---- sweeps: what is proposed works


def test_the_cells_own_counts_are_no_throttle(tmp_path: Path) -> None:
    own = sweeps.sweep(2.0, np.random.default_rng(11))
    counts = np.round(-500_000 + 1000 * own["force"])
    for name in ("thrust_raw", "HX711 counts", "load cell adc"):
        columns = {"t_s": own["t"], name: counts, "force_mN": own["force"]}
        path = tmp_path / "r.csv"
        path.write_text(sweeps.text_of({**columns, "throttle_pct": own["throttle"]}))
        assert block_of(path)["segments"]["by"] == "throttle_pct"
        path.write_text(sweeps.text_of(columns))
        assert name not in str(block_of(path)["segments"])


@pytest.mark.parametrize(("hold", "clock"), [(8, False), (8, True), (25, True), (4, False)])
def test_a_staircase_of_short_levels_is_cut_as_a_ramp(
    tmp_path: Path, hold: int, clock: bool
) -> None:
    steps = np.concatenate([np.full(200, 500), np.repeat(np.arange(1000, 60_000, 900), hold)])
    rng = np.random.default_rng(3)
    force = 1e-8 * steps.astype(float) ** 2 + rng.normal(0, 0.02, len(steps))
    columns = {"pwm": steps.astype(float), "thrust_g": force}
    own = {"t_s": np.arange(len(steps)) / 100.0, **columns} if clock else columns
    path = tmp_path / "ramp.csv"
    path.write_text(sweeps.text_of(own))
    found = block_of(path)
    assert found["segments"]["by"] == "windows"
    assert found["levels"]["by"] == "curve"


@pytest.mark.parametrize("seconds", [0.5, 1.0, 4.0])
def test_proposed_cuts_keep_the_levels(tmp_path: Path, seconds: float) -> None:
    rate = 100
    throttle = np.repeat([0.0, 30, 45, 60, 75, 0], round(seconds * rate))
    rng = np.random.default_rng(4)
    force = 0.02 * throttle**1.8 + rng.normal(0, 0.3, len(throttle))
    path = tmp_path / "s.csv"
    t = np.arange(len(throttle)) / rate
    path.write_text(sweeps.text_of({"t_s": t, "throttle (%)": throttle, "thrust_g": force}))
    cut = validated(Segments, block_of(path)["segments"], "it")
    assert cut.by == "throttle (%)"
    assert cut.settle + cut.shortest < seconds


def test_without_a_rate_nothing_is_said_in_seconds_that_was_not_tried(tmp_path: Path) -> None:
    throttle = np.repeat([0.0, 30, 60, 80, 0], 300)
    force = 0.02 * throttle**1.8 + np.random.default_rng(5).normal(0, 0.3, len(throttle))
    path = tmp_path / "s.csv"
    path.write_text(sweeps.text_of({"throttle_pct": throttle, "thrust_g": force}))
    assert block_of(path)["segments"]["settle"] == "FILL IN s"
    assert "levels last 300 samples" in nearlift("inspect", path).stdout


def test_names_proposed_for_numbers_without_names_are_read_by_the_same_reader(
    tmp_path: Path,
) -> None:
    rows = "".join(f"{i} x {200 + i % 5}\n" for i in range(80))
    path = written.put(tmp_path, "a.txt", rows.encode())
    said = block_of(path)["records"]["dialect"]
    assert said == {"columns": ["column 1", "column 2", "column 3"]}
    text = 'columns = ["column 1", "column 2", "column 3"]'
    assert nearlift("inspect", path, "--dialect", text).exit_code == 0


# ---- rest heads


def record(rest_s: float, rise_s: float, rate: float, seed: int, length_s: float = 4.0):
    rng = np.random.default_rng(seed)
    t = np.arange(round(length_s * rate)) / rate
    rise = 1 - np.exp(-np.maximum(t - rest_s, 0) / max(rise_s, 1e-9))
    return t, 300 * np.where(t >= rest_s, rise, 0) + rng.normal(0, 1.0, len(t)) - 12


@pytest.mark.parametrize(
    ("rest", "rise", "rate"), [(1.0, 0.0, 80), (1.0, 0.1, 80), (0.5, 0.02, 1000), (2.0, 0.2, 10)]
)
def test_the_start_of_the_rotors_is_measured(rest: float, rise: float, rate: float) -> None:
    _, force = record(rest, rise, rate, 1, 8.0)
    force[5] = 8e6
    found = start_of(force, rate)
    assert found is not None
    assert abs(found.rest_ends / rate - rest) <= max(0.11 * rise, 1 / rate) + 1 / rate
    assert found.steady_from / rate >= rest + 1.8 * rise
    assert found.steady_from / rate <= rest + 5 * rise + 2 / rate
    assert start_of(force[round(rest * rate) + round(rise * rate * 8) :], rate) is None


def test_new_proposes_a_tare_and_settling_with_a_margin(tmp_path: Path) -> None:
    for k in range(8):
        t, force = record(1.0 + 0.02 * (k % 3), 0.05, 100, k)
        (tmp_path / "rig").mkdir(exist_ok=True)
        (tmp_path / "rig" / f"r{k}.csv").write_text(
            sweeps.text_of({"t_s": np.round(t, 4), "thrust_g": np.round(force, 3)})
        )
    assert nearlift("new", tmp_path / "c", "--from", tmp_path / "rig").exit_code == 0
    text = (tmp_path / "c" / "campaign.toml").read_text()
    cell = tomllib.loads(text)["load_cell"]
    tare, settle = (float(cell[key].split()[0]) for key in ("tare", "settle"))
    assert 0.85 <= tare <= 0.95
    assert 1.12 <= tare + settle <= 1.5
    assert "# rotors at rest: they start at 1" in text


# ---- two sensors, counters, several tables


@pytest.mark.parametrize("sensors", [2, 3])
def test_several_sensors_under_one_stamp_are_said(tmp_path: Path, sensors: int) -> None:
    rows = [f"{i / 50:.2f},{k},{5 * k + (i % 3) / 10}" for i in range(60) for k in range(sensors)]
    path = written.put(tmp_path, "a.csv", "\n".join(["t_s,unit,F_N", *rows, ""]).encode())
    said = nearlift("inspect", path).stdout
    assert f"each time of 't_s' has {sensors} rows" in said
    assert "'unit' numbers them" in said


def test_a_counter_that_wraps_is_said_and_no_other_step(tmp_path: Path) -> None:
    _, force = record(1.0, 0.0, 80, 2)
    assert wrap_of(force) is None
    wrapped = np.where(np.arange(len(force)) >= 120, force - 39946, force)
    assert wrap_of(wrapped) == pytest.approx(39946, rel=0.02)
    counts = np.round(8_300_000 + 420 * force)
    wrapping = np.where(counts > (1 << 23) - 1, counts - (1 << 24), counts)
    assert wrap_of(wrapping) == pytest.approx(1 << 24, rel=0.02)
    spike = force.copy()
    spike[100] = -39946
    assert wrap_of(spike) is None
    t = np.arange(len(force)) / 80
    path = tmp_path / "r.csv"
    path.write_text(sweeps.text_of({"t_s": t, "thrust_g": wrapped}))
    said = nearlift("inspect", path).stdout
    assert "a counter of the converter that wraps" in said
    assert "sign = -1" not in said


STACKED = "h_mm,T_g\n20,300\n30,280\n60,250\n\nh_mm,T_g\n20,410\n30,390\n60,350\n"
ASIDE = "h_mm,T_g,,h_mm,T_g\n20,300,,20,410\n30,280,,30,390\n60,250,,60,350\n"
DASHES = "h_mm,-,T_g,-\n20,1,300,1\n30,1,280,1\n60,1,250,1\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [(STACKED, "holds 2 tables"), (ASIDE, "two tables side by side"), (DASHES, "side by side")],
)
def test_several_tables_in_one_file_are_said(tmp_path: Path, text: str, said: str) -> None:
    answer = nearlift("inspect", written.put(tmp_path, "a.csv", text.encode()))
    assert (answer.exit_code, said in answer.stderr) == (4, True), answer.stderr


# ---- what files hold besides


def test_new_takes_along_what_records_and_lists_hold(tmp_path: Path) -> None:
    (tmp_path / "rig").mkdir()
    for k in range(3):
        t, force = record(1.0, 0.02, 100, k)
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
    assert rows[0] == "trial,boundary,distance,throttle,session,file,supply"
    assert rows[3] == "r2,ground,22,50,3,r2.csv,15"
    units = tomllib.loads((tmp_path / "c" / "campaign.toml").read_text())["trials"]["units"]
    assert units == {"distance": "mm", "throttle": "percent", "supply": "V"}
