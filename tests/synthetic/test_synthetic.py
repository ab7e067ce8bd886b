"""Synthetic campaigns: what is written is what is true, and the demo is small, labelled and
reproducible.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.unit import bench_campaign

from nearlift import declare
from nearlift.campaign import manifest as campaign
from nearlift.declare import Check, LiftModel, Parameter, Source, uniform
from nearlift.errors import DeclarationError, UsageError
from nearlift.run.tables import sha256
from nearlift.stages.ingest import TRIALS
from nearlift.synthetic import demo, records, table_1, trial_schedule
from nearlift.synthetic.records import SimulatedBench
from nearlift.synthetic.truth import BenchNoise, Truth

FAR = {0.25: 0.1, 0.5: 0.24, 0.75: 0.41, 0.92: 0.55}
BENCH = SimulatedBench(rate_Hz=500.0, tare_s=0.4, record_s=1.0)


def gain(z_hat: Any, /, *, k: Any) -> Any:
    return 1 + k / np.asarray(z_hat) ** 2


MODEL = LiftModel(
    "test_gain", "a gain", "1 + k / z^2", gain, boundary="ground",
    parameters=(Parameter("k", "1", 0.1, (0.0, 1.0), uniform(0.0, 1.0), "gain at one radius"),),
    source=Source("this test", doubts=("all of it",)),
    checks=(Check(1.0, 1.1, quoted_by="by hand"),),
)  # fmt: skip


def truth(**changes: Any) -> Truth:
    return Truth(**{"model": MODEL, "parameters": {"k": 0.2}, "lift_inf_N": FAR, **changes})


def plan(**changes: Any) -> trial_schedule.TrialSchedule:
    return trial_schedule.randomised(
        {"ground": [0.03, 0.05, 0.3]}, **{"seed": 1, "visits": 3, "sessions": 2, **changes}
    )


def ingested(folder: Path, out: Path) -> dict[str, Any]:
    outcome, job = bench_campaign.run_ingest(folder, out, campaign.load(folder))
    assert outcome.rejected == ()
    return job.read(TRIALS)


# ---- design


def test_every_station_throttle_and_visit_is_there_in_random_order() -> None:
    got = plan()
    assert len(got) == 3 * 4 * 3
    for z in (0.03, 0.05, 0.3):
        for throttle in trial_schedule.THROTTLES:
            assert np.sum((got.recorded_m == z) & (got.throttle == throttle)) == 3
    assert np.all(np.diff(got.start_s) > 0)
    assert got.visit.max() == 8
    # four trials a visit, one station, one side
    for visit in range(9):
        assert np.sum(got.visit == visit) == 4
        assert len(np.unique(got.recorded_m[got.visit == visit])) == 1
    assert sorted(np.unique(got.session)) == [1, 2]


def test_approach_is_the_sign_of_the_last_move() -> None:
    got = plan(visits=20)
    station = got.recorded_m[::4]
    assert np.all(np.diff(station) != 0)
    np.testing.assert_array_equal(got.approach[::4][1:], np.sign(np.diff(station)))
    assert got.approach[0] == -1


def test_another_boundary_changes_no_order() -> None:
    both = trial_schedule.randomised(
        {"ground": [0.03, 0.05, 0.3], "ceiling": [0.01, 0.3]}, seed=1, visits=3, sessions=2
    )
    np.testing.assert_array_equal(both.recorded_m[:36], plan().recorded_m)
    np.testing.assert_array_equal(both.throttle[:36], plan().throttle)


def test_a_battery_falls_within_its_session_and_a_bench_supply_does_not() -> None:
    got = plan(visits=10)
    volts = trial_schedule.battery_V(got, seed=1)
    for session in (1, 2):
        own = volts[got.session == session]
        assert own[0] - own[-1] == pytest.approx(0.15, abs=0.02)
    assert np.std(trial_schedule.bench_V(got, seed=1)) < 0.002


# ---- Table 1


def test_one_list_of_commands() -> None:
    ceiling = np.array(table_1.TABLE_1["ceiling"])
    assert set(np.array(table_1.TABLE_1["ground"]) - ceiling) <= {52, 53}
    assert set(np.array(table_1.TABLE_1["sidewall"]) - ceiling) <= {10, 11}


def test_stations_meet_the_claims_of_the_text_but_one() -> None:
    z_hat = {side: table_1.stations_m(side) / 0.023 for side in table_1.TABLE_1}
    ground, ceiling, sidewall = (z_hat[side] for side in ("ground", "ceiling", "sidewall"))
    assert (ground[0], ground[-1]) == pytest.approx((1.14, 11.54), abs=0.005)
    assert ceiling[0] < 0.18
    assert sidewall[0] == pytest.approx(0.3)
    assert not np.any((ground > 3) & (ground < 6))


# ---- truth and records


def test_expected_lift_is_the_models_times_far_lift() -> None:
    z, throttle = np.array([1.0, 2.0]), np.array([0.25, 0.92])
    np.testing.assert_allclose(truth().lift_N(z, throttle, {}), [0.12, 0.5775])


def test_effects_act_and_take_columns() -> None:
    sag = truth(effects=((demo.SUPPLY, {"exponent": 2.0}),))
    got = sag.lift_N(
        np.array([1e6, 1e6]), np.array([0.25, 0.25]), {"supply_V": np.array([3.9, 3.51])}
    )
    np.testing.assert_allclose(got, [0.1, 0.081])
    null = truth(effects=((demo.SUPPLY, {}),))
    np.testing.assert_allclose(
        null.lift_N(np.array([1e6]), np.array([0.25]), {"supply_V": np.array([3.0])}), [0.1]
    )


def test_an_effect_that_lacks_a_column_is_refused() -> None:
    with pytest.raises(DeclarationError, match="supply_V"):
        truth(effects=((demo.SUPPLY, {}),)).lift_N(np.array([1.0]), np.array([0.25]), {})


def test_ingest_gives_back_the_truth_from_either_form(tmp_path: Path) -> None:
    """Lift within its own u: 36 trials, so the reduced chi-square is within 1 +- 0.8 with a chance
    of crying wolf below 0.1 %.
    """
    lifts = []
    for form in ("parquet", "csv"):
        folder, given = tmp_path / form, {"ground": truth()}
        about: dict[str, Any] = {"name": "c", "note": "", "seed": 1, "bench": BENCH}
        true = records.write_campaign(folder, plan(), given, **about, form=form)
        got = ingested(folder, tmp_path / f"out-{form}")
        pull = (got["lift_N"] - true.lift_N) / got["u_lift_N"]
        assert np.mean(pull**2) < 1.8
        np.testing.assert_allclose(got["z_m"], plan().z_m, rtol=1e-6)
        np.testing.assert_allclose(got["n"], 500)
        assert list(got["visit"]) == list(plan().visit)
        lifts.append(got["lift_N"])
    np.testing.assert_allclose(*lifts, atol=2e-8)


def test_noise_has_the_sizes_that_were_asked_for(tmp_path: Path) -> None:
    noise = BenchNoise(sample_N=2e-3, tone_N=0.0, drift_N=0.0, trial=0.01, height_m=0.2e-3)
    many = trial_schedule.randomised({"ground": [0.03, 0.3]}, seed=1, visits=150, sessions=1)
    true = records.simulate(many, {"ground": truth(noise=noise)}, bench=BENCH, seed=1)
    assert np.std(true.lift_N / true.expected_N - 1) == pytest.approx(0.01, rel=0.1)
    away = true.z_m - many.z_m
    assert np.std(away) == pytest.approx(0.2e-3, rel=0.2)
    for visit in range(5):
        assert len(np.unique(away[many.visit == visit].round(12))) == 1
    counts = records.record("t", 0.1, 0.25, truth(noise=noise), BENCH, 1)
    assert counts.dtype == np.int32
    assert np.std(noise.quantum_N * counts[:200]) == pytest.approx(2e-3, rel=0.2)


def test_the_tone_turns_with_the_rotor() -> None:
    noise = BenchNoise(sample_N=0.0, drift_N=0.0, tone_N=1e-2, tone_Hz=100.0)
    bench = SimulatedBench(rate_Hz=1000.0, tare_s=1.0, record_s=2.0)
    for throttle, lift in FAR.items():
        live = (
            noise.quantum_N
            * records.record("t", lift, throttle, truth(noise=noise), bench, 1)[1000:]
        )
        power = np.abs(np.fft.rfft(live - live.mean()))
        assert np.argmax(power) / 2.0 == pytest.approx(100 * np.sqrt(lift / FAR[0.92]), abs=0.5)
        assert np.ptp(live) / 2 == pytest.approx(1e-2 * lift / FAR[0.92], rel=0.05)


def test_a_trials_samples_depend_on_nothing_else() -> None:
    one = records.record("t0001", 0.1, 0.25, truth(), BENCH, 1)
    np.testing.assert_array_equal(one, records.record("t0001", 0.1, 0.25, truth(), BENCH, 1))
    assert np.any(one != records.record("t0002", 0.1, 0.25, truth(), BENCH, 1))
    assert np.any(one != records.record("t0001", 0.1, 0.25, truth(), BENCH, 2))


def test_foreign_folders_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(UsageError, match="holds something other than a simulated campaign"):
        demo.write_demo(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["thesis.txt"]


# ---- the demo


@pytest.fixture(scope="module")
def demo_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return demo.write_demo(tmp_path_factory.mktemp("demo") / "demo-campaign")


def test_the_demo_is_small_and_says_what_it_is(demo_folder: Path) -> None:
    assert sum(p.stat().st_size for p in demo_folder.rglob("*") if p.is_file()) < 24e6
    text = (demo_folder / "campaign.toml").read_text()
    assert tomllib.loads(text)["simulated"] is True
    assert text.startswith("# SIMULATED")
    assert "supply" not in tomllib.loads(text)["note"]


def test_the_demo_has_its_effect_at_the_ground_only(demo_folder: Path, tmp_path: Path) -> None:
    table = ingested(demo_folder, tmp_path)
    assert set(table["boundary"]) == set(declare.BOUNDARIES)
    assert set(table["quality"]) == {""}
    spread = {
        side: float(np.std(np.log(table["supply_V"][table["boundary"] == side])))
        for side in declare.BOUNDARIES
    }
    assert spread["ground"] > 0.008
    assert max(spread["ceiling"], spread["sidewall"]) < 0.0005
    # far from the ground, lift over its throttle's mean goes with the supply squared
    far = (table["boundary"] == "ground") & (table["z_hat"] > 10)
    y, x = np.log(table["lift_N"][far]), np.log(table["supply_V"][far])
    levels = (table["throttle"][far][:, None] == np.array(trial_schedule.THROTTLES)).astype(float)
    exponent = np.linalg.lstsq(np.column_stack([levels, x]), y, rcond=None)[0][-1]
    assert exponent == pytest.approx(2.0, abs=0.6)
    # the worn battery of the near visits
    volts, near = table["supply_V"], table["z_m"] < demo.WORN_BELOW_M
    side = table["boundary"] == "ground"
    less = volts[side & ~near].mean() - volts[side & near].mean()
    assert less == pytest.approx(demo.WORN_V, abs=0.01)


def test_the_demo_is_the_papers_campaign(demo_folder: Path) -> None:
    plan = demo.design()
    stations = {side: np.unique(plan.recorded_m[plan.boundary == side]) for side in table_1.TABLE_1}
    for side in ("ceiling", "sidewall"):
        np.testing.assert_allclose(stations[side], table_1.stations_m(side))
    assert len(stations["ground"]) == 22
    assert len(plan) == 62 * 4 * demo.VISITS
    manifest = campaign.load(demo_folder)
    assert manifest.load_cell.sample_rate == 1000.0
    assert {u.on for u in manifest.uncertainty} == {"height", "rotor_radius", "rotor_spacing"}


def test_its_ceiling_gains_60_percent_at_the_nearest_station_and_the_theory_from_half_a_radius():
    truth = demo.truths()["ceiling"]
    z_hat, supply = np.array([0.1, 0.3, 0.5, 1.0]), {"supply_V": np.full(4, 3.9)}
    ratio = truth.lift_N(z_hat, np.full(4, 0.5), supply) / truth.lift_inf_N[0.5]
    assert ratio[0] == pytest.approx(1.60, abs=0.005)
    np.testing.assert_allclose(ratio[2:], [1.112372, 1.030330], atol=1e-6)
    theory = 0.5 + 0.5 * np.sqrt(1 + 0.125 / z_hat**2)
    assert ratio[1] < theory[1]


def test_the_demo_is_the_same_each_time(demo_folder: Path, tmp_path: Path) -> None:
    demo.write_demo(tmp_path / "again")
    demo.write_demo(tmp_path / "again")
    for path in (p for p in demo_folder.rglob("*") if p.is_file()):
        assert sha256(path) == sha256(tmp_path / "again" / path.relative_to(demo_folder)), path.name
