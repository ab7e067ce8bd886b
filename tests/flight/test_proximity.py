"""Detection ranges and distances from readings: products, figure, chapter and command."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
from markupsafe import escape
from tests.unit import quoted, small_run
from tests.unit.small_run import nearlift

from nearlift.campaign.forecasts import LiftReading
from nearlift.errors import ManifestError
from nearlift.flight.proximity import read
from nearlift.report.figures.files import render
from nearlift.report.figures.style import Style
from nearlift.report.registry import FIGURES
from nearlift.results.fit import FitResults
from nearlift.stages import detect
from nearlift.stages.detect import DETECTION, PROXIMITY
from nearlift.stages.diagnose import DIAGNOSIS, quoted_lifts
from nearlift.stages.fit import RESULTS
from nearlift.stages.gathering import gather

SENSOR = {"force_noise": "3 mN", "force_bandwidth": "50 Hz"}


@pytest.fixture(scope="module")
def done(remake):
    job = remake(detect=SENSOR)
    return job, detect.run(job)


def test_ranges(done):
    job, _ = done
    table = job.read(DETECTION)
    assert set(table["boundary"]) == {"ground", "ceiling", "sidewall"}
    ground = {
        (p, t): z
        for b, p, t, z in zip(
            *(table[k] for k in ("boundary", "payload", "averaging_s", "range_z_hat")), strict=True
        )
        if b == "ground"
    }
    assert ground[0.0, 0.1] < ground[0.0, 10.0]
    assert not ground[0.05, 100.0] > 0.5 * ground[0.0, 100.0]
    assert table["range_m"] == pytest.approx(0.023 * table["range_z_hat"], nan_ok=True)
    wall = (table["boundary"] == "sidewall") & (table["payload"] >= 0.05)
    assert np.isnan(table["range_z_hat"][wall]).all()
    assert (table["hi90"][wall] == 0).all()


def test_located(done):
    job, outcome = done
    content = job.read_json(PROXIMITY)["boundaries"]
    for side in ("ground", "ceiling", "sidewall"):
        near, far = content[side]["located"][0], content[side]["located"][-1]
        assert near["lo90"] <= near["median"] <= near["hi90"]
        assert far["beyond"] > near["beyond"]
    assert content["sidewall"]["largest_change"] < 0 < content["ground"]["largest_change"]
    assert outcome.notes == ()


def test_supply_costs_range(remake, done):
    job, _ = done
    both = remake(detect=SENSOR | {"supply": ["0 percent", "2 percent"]})
    detect.run(both)
    before, after = job.read(DETECTION), both.read(DETECTION)
    worse = after["voltage"] == 0.02
    assert after["supply"][worse] == pytest.approx(0.04)  # lift as the square of the supply
    assert after["needed"][~worse] == pytest.approx(before["needed"])
    assert (after["needed"][worse] > before["needed"]).all()
    evidence = gather(both)
    (spec,) = (s for s in FIGURES if s.name == "detection")
    table = spec.table(evidence)
    drawn = set(table["case"][table["row"] == "range"])
    assert drawn == {
        "weight and supply known exactly",
        "weight ±1 %",
        "weight ±5 %",
        "supply voltage ±2 %",
    }
    assert "e+0" not in spec.caption(evidence, table)
    # one number stands for a list of one
    assert remake("ground", detect={"supply": "2 percent"}).campaign.detect.supply == [0.02]


def test_a_reading_becomes_a_distance(done):
    """The ratio that the fitted model has at 1.5 radii, and the throttle at which a vehicle would
    hover there, say 1.5 radii.
    """
    job, _ = done
    belief = quoted.fitted_lift(job, "ground", 50)
    ratio = float(belief.ratio()(np.array([1.5]))[0])
    found = read(
        quoted_lifts(job),
        LiftReading.model_validate({"boundary": "ground", "ratio": ratio, "u": "0.3 percent"}),
    )
    assert found.z_hat.lo90 < 1.5 < found.z_hat.hi90
    assert found.z_hat.median == pytest.approx(1.5, rel=0.05)
    assert found.z_m.median == pytest.approx(0.023 * found.z_hat.median)
    assert found.beyond < 1e-3
    assert "11.5: below 0.01 % (50 % before" in found.text
    assert "z_hat = 1.5 (90 %: 1." in found.text.replace("1.49 ", "1.5 ").replace(
        "1.51 ", "1.5 "
    ).replace("1.52 ", "1.5 ")
    # lift goes as throttle^1.4 here: the throttle that lifts weight / ratio far away
    hover = (0.027 * 9.8 / ratio / 0.6) ** (1 / 1.4)
    given = {"boundary": "ground", "throttle": f"{100 * hover} percent", "u": "0 percent"}
    told = read(quoted_lifts(job), LiftReading.model_validate(given))
    assert told.ratio == pytest.approx(ratio, rel=0.02)
    assert told.z_hat.lo90 < 1.5 < told.z_hat.hi90
    wider = read(
        quoted_lifts(job),
        LiftReading.model_validate(given | {"weight": "1 percent", "supply": "1 percent"}),
    )
    assert wider.u == pytest.approx(
        math.hypot(told.u, 0.01 * told.ratio, 0.02 * told.ratio), rel=1e-3
    )
    heavier = read(
        quoted_lifts(job),
        LiftReading.model_validate(given | {"mass": "28 g", "weight": "2 percent"}),
    )
    assert heavier.ratio == pytest.approx(told.ratio * 28 / 27)


def test_readings_in_the_manifest(remake):
    readings = [
        {"boundary": "ground", "ratio": 1.1, "u": "1 percent"},
        {"boundary": "ground", "throttle": "99 percent", "u": "1 percent"},
        {"boundary": "ceiling", "ratio": 1.1, "u": "1 percent"},
    ]
    job = remake("ground", detect=SENSOR | {"reading": readings})
    outcome = detect.run(job)
    good, outside, elsewhere = job.read_json(PROXIMITY)["readings"]
    assert 1.2 < good["z_hat"]["median"] < 2.2
    assert "0.99 is outside 0.25 to 0.92" in outside["refused"]
    assert "nothing was fitted at the ceiling" in elsewhere["refused"]
    assert [n[:17] for n in outcome.notes] == ["detect.reading[1]", "detect.reading[2]"]
    evidence = gather(job)
    text = small_run.chapter(evidence, "proximity")
    first, second, _ = text.partition("Readings of the manifest")[2].split('<th scope="row">')[1:]
    assert 'data-source="proximity.json#/readings/0/z_hat/median"' in first
    assert f'<td colspan="5">{escape(outside["refused"])}</td>' in second
    (spec,) = (s for s in FIGURES if s.name == "detection")
    table = spec.table(evidence)
    assert (table["row"] == "reading").sum() == 1
    assert render(spec.draw, table, Style())["png"].startswith(b"\x89PNG")
    with pytest.raises(ManifestError, match="one of both"):
        remake("ground", detect={"reading": [{"boundary": "ground", "u": "1 percent"}]})


def test_the_command_line_takes_a_reading(tmp_path):
    raw = small_run.write(tmp_path / "raw")
    for stage in ("ingest", "reduce", "fit"):
        assert nearlift(stage, raw, "--out", tmp_path, "-q").exit_code == 0
    reading = ("--boundary", "ground", "--ratio", "1.1", "--u", "1 percent")
    found = nearlift("detect", raw, "--out", tmp_path, *reading)
    assert found.exit_code == 0, found.output
    assert "ground, sanchez_cuevas: L/L_inf = 1.1 +- 0.01\nz_hat = " in found.stdout
    told = json.loads(nearlift("detect", raw, "--out", tmp_path, *reading, "--json").stdout)
    assert told["z_hat"]["lo90"] < told["z_hat"]["median"] < told["z_hat"]["hi90"]
    hover = nearlift(
        "detect",
        raw,
        "--out",
        tmp_path,
        "--boundary",
        "ground",
        "--throttle",
        "50 percent",
        "--u",
        "0.5 percent",
        "--mass",
        "27 g",
    )
    assert "(hover at 50 % throttle)" in hover.stdout
    assert not (tmp_path / "processed" / small_run.NAME / "proximity.json").exists()
    for words, code, said in (
        (("--ratio", "1.1"), 2, "--boundary: is missing"),
        (
            ("--boundary", "ceiling", "--ratio", "1.1", "--u", "1 percent"),
            2,
            "nothing was fitted at the ceiling",
        ),
        (("--boundary", "ground", "--ratio", "1.1"), 2, "u: is missing"),
        (("--boundary", "ground", "--u", "1 percent"), 2, "one of both"),
        (
            ("--boundary", "ground", "--ratio", "3", "--u", "1 percent"),
            4,
            "standard uncertainties from everything",
        ),
    ):
        found = nearlift("detect", raw, "--out", tmp_path, *words)
        assert found.exit_code == code
        assert said in found.stderr


def test_without_a_sensor_the_bench_s_own_noise_counts(remake):
    job = remake("ground", detect={})
    detect.run(job)
    own, fitted = job.read_json(PROXIMITY)["boundaries"]["ground"], job.load(FitResults)
    far = fitted.of_base("ground").L_inf_N.values()
    floor = math.hypot(fitted.noise["ground"].relative, np.median([e.u / e.value for e in far]))
    assert own["floor"] == pytest.approx(floor)
    # a sensor in the vehicle reads against the same bench's model and L_inf
    flown = remake("ground", detect=SENSOR)
    detect.run(flown)
    ground = flown.read_json(PROXIMITY)["boundaries"]["ground"]
    assert ground["floor"] == pytest.approx(floor)
    weight_N = flown.campaign.vehicle.mass * flown.campaign.rig.gravity
    # 3 mN, white up to 50 Hz
    assert ground["short_per_sqrt_Hz"] == pytest.approx(3e-3 / weight_N / 10)


def test_distances_of_significance(remake, done):
    """From how near lift changes by more than 2 %, and by what the manifest asks."""
    job, _ = done
    for side in ("ground", "ceiling", "sidewall"):
        own = job.read_json(PROXIMITY)["boundaries"][side]
        found, lift = own["significant"], quoted.fitted_lift(job, side, 2)
        assert abs(float(lift.ratio()(np.array([found["z_hat"]]))[0]) - 1) == pytest.approx(
            0.02, abs=1e-4
        )
        assert found["lo90"] <= found["z_hat"] <= found["hi90"]
    never = remake("sidewall", detect=SENSOR | {"significant": "20 percent"})
    detect.run(never)
    assert never.read_json(PROXIMITY)["boundaries"]["sidewall"]["significant"]["z_hat"] is None
    assert ">not measured<" in small_run.chapter(gather(never), "proximity")


def test_one_reading_does_not_tell_ground_from_ceiling(done):
    job, _ = done
    asked = {"boundary": "ground", "ratio": 1.08, "u": "0.5 percent"}
    found = read(quoted_lifts(job), LiftReading.model_validate(asked))
    (at,) = found.alike.values()
    assert set(found.alike) == {"ceiling"}
    ceiling = quoted.fitted_lift(job, "ceiling", 2)
    assert float(ceiling.ratio()(np.array([at]))[0]) == pytest.approx(1.08, abs=1e-4)
    assert "one reading does not tell them apart" in found.text
    lower = LiftReading.model_validate(asked | {"boundary": "sidewall", "ratio": 0.98})
    assert read(quoted_lifts(job), lower).alike == {}


def test_a_model_that_folds_is_not_inverted_and_said_so(remake):
    job = remake("ground", detect=SENSOR)
    content = job.read_json(RESULTS)
    content["boundaries"]["ground"]["coefficients"]["K_b"] |= {"value": -3.0}
    job.write_json(RESULTS, content)
    (note,) = detect.run(job).notes
    assert "the model folds at z_hat" in note
    assert "located" not in job.read_json(PROXIMITY)["boundaries"]["ground"]


def test_figure_and_chapter(done):
    job, _ = done
    evidence = gather(job)
    (spec,) = (s for s in FIGURES if s.name == "detection")
    table = spec.table(evidence)
    assert render(spec.draw, table, Style())["png"].startswith(b"\x89PNG")
    assert "1 % false alarms and 10 % misses" in spec.caption(evidence, table)
    assert set(table[table["row"] == "floor"]["panel"]) <= {"ground", "ceiling", "sidewall"}
    text = small_run.chapter(evidence, "proximity")
    table = text.partition("Distance of a significant change of lift")[2]
    rows = re.findall(r'<tr><th scope="row">(\w+)</th>', table)
    assert rows[:3] == ["Ground", "Ceiling", "Sidewall"]


def test_lift_far_away_and_its_noise_are_those_of_the_accepted_model(remake):
    """The base fit, which a named effect rejects, has another L_inf and a larger scatter."""
    job = remake("ground", detect=SENSOR)
    base = job.load(FitResults).of_base("ground").L_inf_N
    accepted = {str(t): {"value": 1.02 * e.value, "u": 0.001 * e.value} for t, e in base.items()}
    sag = {"value": 2.0, "lo90": 1.9, "hi90": 2.1}
    block = {
        "verdict": "effect",
        "effects": [{"name": "supply_sag", "parameters": {"sag_exponent": sag}}],
        "noise_floor": quoted.EMPTY_BLOCK["noise_floor"] | {"relative": 0.003},
        "L_inf_N": accepted,
    }
    job.write_json(DIAGNOSIS, quoted.diagnosis({"ground": block}))
    quoted.write(job, {"ground": block})
    detect.run(job)
    floor = job.read_json(PROXIMITY)["boundaries"]["ground"]["floor"]
    assert floor == pytest.approx(math.hypot(0.003, 0.001 / 1.02))
    hover = {"boundary": "ground", "throttle": "50 percent", "u": "0 percent"}
    found = read(quoted_lifts(job), LiftReading.model_validate(hover | {"mass": "26 g"}))
    assert found.ratio == pytest.approx(0.026 * 9.8 / (1.02 * base[0.5].value))
    assert found.u == pytest.approx(found.ratio * 0.001 / 1.02)
