"""The commands `design` and `explain`: what they write, say and refuse."""

import csv
import json
import shutil

import pytest
from tests.unit.small_run import nearlift, state

from nearlift.campaign import manifest as manifests
from nearlift.planning.plans import draw, schedule_text
from nearlift.results.answers import DesignOutlook, EffectAccount
from nearlift.results.document import as_json, typed
from nearlift.schedule import read_schedule

PLAN = """
[design]
distances = { ground = ["26 mm", "35 mm", "52 mm", "92 mm", "265 mm"] }
throttles = ["25 percent", "50 percent", "92 percent"]
lift = ["10.9 gf", "24.4 gf", "56.2 gf"]
visits = 5
sessions = 3
supply = ["4.05 V", "3.75 V"]
logs = ["supply"]
noise = { relative = "0.4 percent", force = "0.3 mN", height = "0.05 mm" }
"""
MANIFEST = """
schema = "nearlift.campaign/1"
name = "planned"
vehicle = { name = "Crazyflie 2.0", rotors = 4, rotor_radius = "23 mm", rotor_spacing = "65 mm", mass = "27 g" }
rig = { held = "throttle", distance_datum = "rotor plane", distance_offset = "0 mm", gravity = "9.8 m/s^2" }
load_cell = { sample_rate = "1000 Hz", tare = "2 s" }
records = { reader = "csv", files = "trials/{trial}.csv", force = { column = "force", unit = "mN", sign = 1 } }
[trials.units]
distance = "mm"
throttle = "percent"
start = "s"
supply = "V"
"""


@pytest.fixture
def plan(tmp_path):
    folder = tmp_path / "plan"
    folder.mkdir()
    (folder / "campaign.toml").write_text(MANIFEST + PLAN)
    return folder


@pytest.fixture(scope="module")
def weighed(tmp_path_factory):
    base = tmp_path_factory.mktemp("design")
    folder = base / "plan"
    folder.mkdir()
    (folder / "campaign.toml").write_text(MANIFEST + PLAN)
    before = state(folder)
    answer = nearlift("design", folder, "--out", base / "out", "--json")
    assert (answer.exit_code, answer.stderr) == (0, "")
    assert state(folder) == before
    return base, json.loads(answer.stdout)


def test_design_writes_a_schedule_that_nearlift_reads(weighed):
    base, found = weighed
    text = (base / "out/reports/planned/design/trials.csv").read_text()
    rows = list(csv.DictReader(text.splitlines()))
    assert len(rows) == 75
    assert found["schedule"]["trials"] == 75
    assert {r["supply"] for r in rows} == {""}
    assert found["schedule"]["hours"] == pytest.approx((75 * 20 + 25 * 8 + 2 * 300) / 3600, rel=0.1)
    # each distance in each session, but for the rounding of five rounds over three sessions
    for session in "123":
        assert len({r["distance"] for r in rows if r["session"] == session}) == 5
    copied = base / "copied"
    copied.mkdir()
    (copied / "campaign.toml").write_text(MANIFEST)
    (copied / "trials.csv").write_text(text)
    loaded = manifests.load(copied)
    schedule = read_schedule(loaded, copied)
    assert len(schedule) == 75
    assert schedule.visit.max() == 24


def test_design_says_what_it_assumes_and_finds(weighed):
    base, found = weighed
    assert as_json(typed(DesignOutlook, found)) == found
    at = found["boundaries"]["ground"]
    assert at["trials"] == 75
    rows = {r["effect"]: r for r in at["effects"]}
    assert rows["supply_sag"]["verdict"] == "named"
    assert rows["height_scale"]["verdict"] == "too small to see"
    assert 0.02 < at["coefficients"]["K_b"]["u"] < 0.1
    assert (
        at["coefficients"]["K_b"]["u_with_undetected_effects"] > 3 * at["coefficients"]["K_b"]["u"]
    )
    assert {u["effect"] for u in at["untestable"]} >= {"tilt", "air_density"}
    assert any("supply falls from 4.05 to 3.75 V" in said for said in found["assumed"])
    assert json.loads((base / "out/reports/planned/design/design.json").read_text()) == found


def test_the_same_seed_draws_the_same_schedule_and_another_another(weighed, plan, tmp_path):
    base, _ = weighed
    drawn = (base / "out/reports/planned/design/trials.csv").read_bytes()
    loaded = manifests.load(plan)
    assert schedule_text(draw(loaded, 0), loaded).encode() == drawn
    assert schedule_text(draw(loaded, 1), loaded).encode() != drawn
    target = tmp_path / "trials.csv"
    target.write_bytes(drawn)
    for path in (target, tmp_path):
        refused = nearlift("design", plan, "--out", tmp_path / "o", "--write", path)
        assert refused.exit_code == 2
        assert "a schedule that may have been run is never overwritten" in refused.stderr
    assert target.read_bytes() == drawn


def test_a_plan_without_a_plan_is_refused(plan, tmp_path):
    (plan / "campaign.toml").write_text(MANIFEST)
    found = nearlift("design", plan, "--out", tmp_path)
    assert found.exit_code == 2
    assert "has neither a schedule with trials nor a [design]" in found.stderr


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            ('lift = ["10.9 gf", "24.4 gf", "56.2 gf"]', 'lift = ["10.9 gf"]'),
            "lift lists 1 values for 3 throttles",
        ),
        (
            ('throttles = ["25 percent", "50', 'throttles = ["50 percent", "50'),
            "design.throttles: names one of its values twice",
        ),
        (("visits = 5", "visits = 0"), "design.visits"),
        (('"26 mm", ', '"26", '), "design.distances"),
        (("sessions = 3", "sesions = 3"), "did you mean 'sessions'?"),
        (("logs", "expected = { ground = { K_c = 2.0 } }\nlogs"), "sanchez_cuevas has no K_c"),
    ],
)
def test_a_design_with_a_slip_is_refused(plan, tmp_path, change, text):
    (plan / "campaign.toml").write_text(MANIFEST + PLAN.replace(*change))
    found = nearlift("design", plan, "--out", tmp_path)
    assert found.exit_code == 2
    assert text in found.stderr


# ---- one effect explained


@pytest.fixture(scope="module")
def explained(small_campaign, tmp_path_factory):
    out = tmp_path_factory.mktemp("explain") / "out"
    shutil.copytree(small_campaign, out)
    return out / "raw", out


def test_explain_says_what_why_and_how_large(explained):
    raw, out = explained
    answer = nearlift("diagnose", raw, "--out", out, "--explain", "height_offset", "--json")
    assert (answer.exit_code, answer.stderr) == (0, "")
    found = json.loads(answer.stdout)
    assert as_json(typed(EffectAccount, found)) == found
    at = found["boundaries"]["ground"]
    size = at["sizes"][0]
    assert (size["parameter"], size["unit"]) == ("offset_m", "m")
    assert size["signature"]["rms_left"] < size["signature"]["rms"]
    assert size["bias"]["K_b"]["shift"] != 0
    alike = sorted(size["confused_with"], key=lambda c: -c["energy_absorbed"])[:4]
    assert {"image_strength", "held_quantity", "near_wall_saturation"} <= {
        c["effect"] for c in alike
    }
    words = nearlift("explain", raw, "height_offset", "--out", out).stdout
    for part in (
        "Mechanism: the traverse's zero is not the rotor plane",
        "Source: ",
        "In small, ground",
        "Confounded with",
        "Undetected at that size",
    ):
        assert part in words
    # no stage is stale by it
    planned = nearlift("run", raw, "--dry-run", "--out", out)
    assert all("up to date" in line for line in planned.stdout.splitlines())


def test_explain_names_what_to_log_and_what_does_not_exist(explained):
    raw, out = explained
    words = nearlift("diagnose", raw, "--out", out, "--explain", "supply_sag").stdout
    assert "Untestable: supply_V, supply_ref_V are unknown" in words
    assert "Log next time: supply" in words
    heating_words = nearlift("diagnose", raw, "--out", out, "--explain", "motor_heating").stdout
    assert "would be detected with 80 % chance" in heating_words
    refused = nearlift("diagnose", raw, "--out", out, "--explain", "suply_sag")
    assert refused.exit_code == 2
    assert "did you mean supply_sag" in refused.stderr
