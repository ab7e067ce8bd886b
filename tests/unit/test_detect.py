"""The stage `detect`: products, what payload and supply cost, the sidewall's number, folds, figure and chapter."""

from __future__ import annotations

import numpy as np
import pytest

from nearlift.figures.render import render
from nearlift.figures.style import style
from nearlift.pages import proximity as chapter
from nearlift.products import DETECTION, FIT, PROXIMITY
from nearlift.stages import detect
from nearlift.stages.gallery import FIGURES
from nearlift.stages.report import gather

SENSOR = {"force_noise": "3 mN", "force_bandwidth": "50 Hz"}


@pytest.fixture(scope="module")
def done(make_job):
    job = make_job(detect=SENSOR)
    return job, detect.run(job)


def test_ranges(done):
    job, _ = done
    table = job.read(DETECTION)
    assert set(table["boundary"]) == {"ground", "ceiling", "sidewall"}
    ground = {
        (p, t): z for b, p, t, z in zip(*(table[k] for k in ("boundary", "payload", "averaging_s", "range_z_hat")), strict=True) if b == "ground"
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


def test_supply_costs_range(make_job, done):
    job, _ = done
    worse = make_job(detect=SENSOR | {"supply": "2 percent"})
    detect.run(worse)
    before, after = job.read(DETECTION), worse.read(DETECTION)
    assert after["supply"] == pytest.approx(0.04)  # lift as the square of the supply
    assert (after["needed"] > before["needed"]).all()


def test_without_a_sensor_the_bench_s_own_noise_counts(make_job):
    job = make_job(("ground",), detect={})
    detect.run(job)
    own = job.read_json(PROXIMITY)["boundaries"]["ground"]
    assert own["floor"] == pytest.approx(job.read_json(FIT)["noise"]["ground"]["relative"])


def test_a_model_that_folds_is_not_inverted_and_said_so(make_job):
    job = make_job(("ground",), detect=SENSOR)
    content = job.read_json(FIT)
    entry = content["boundaries"]["ground"]["sanchez_cuevas"]
    entry["parameters"]["K_b"] |= {"value": -3.0}
    job.write_json(FIT, content)
    (note,) = detect.run(job).notes
    assert "the model folds at z_hat" in note
    assert "located" not in job.read_json(PROXIMITY)["boundaries"]["ground"]


def test_figure_and_chapter(done):
    job, _ = done
    evidence = gather(job)
    (spec,) = (s for s in FIGURES if s.name == "detection")
    table = spec.summarise(evidence)
    assert render(spec.draw, table, style("screen"))["png"].startswith(b"\x89PNG")
    assert "1 % false alarms and 10 % misses" in spec.caption(evidence, table)
    assert "ground: noticed from" in spec.alt(evidence, table)
    facts = chapter.facts(evidence)
    assert [r["boundary"] for r in facts["rows"]] == ["ground", "ceiling", "sidewall"]
    assert facts["rows"][2]["cells"][1]["range_z_hat"].text == "nowhere"
