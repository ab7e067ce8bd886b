"""The command `next`: rows behind those of the schedule, tables, words, and what is refused."""

import dataclasses
import json

import numpy as np
import pytest
from tests.unit import small_run

from nearlift import schedule as schedules
from nearlift.campaign import manifest as manifests
from nearlift.errors import InputRefused, UsageError
from nearlift.planning.question import ROUNDS, VisitQuestion
from nearlift.report import visits
from nearlift.results.answers import NextVisits
from nearlift.stages.fit import RESULTS
from nearlift.stages.forecasts import next_rows, next_visits
from nearlift.stages.ingest import TRIALS


def test_the_words_say_where_to_stop():
    told = NextVisits(
        boundary="ground",
        base_model="sanchez_cuevas",
        trials=100,
        throttles=4,
        aim=("K_b",),
        now=0.08,
        after=0.07,
        wanted=0.05,
        visits_wanted=10,
        best=0.0,
        visits=(),
    )
    assert visits.stop(told) == ("u(K_b) = 0.05 after about 40 more trials")
    never = dataclasses.replace(told, visits_wanted=None, best=0.06)
    assert visits.stop(never).startswith("u(K_b) = 0.05: out of reach of these stations")
    assert visits.stop(dataclasses.replace(told, visits_wanted=0)).endswith(": reached")


@pytest.fixture(scope="module")
def ingested(tmp_path_factory):
    folder = tmp_path_factory.mktemp("next")
    small_run.write(folder / "raw" / "small")
    made = small_run.nearlift("ingest", folder / "raw" / "small", "--out", folder)
    assert made.exit_code == 0, made.output
    return folder


def ask(folder, *words):
    return small_run.nearlift("next", folder / "raw" / "small", "--out", folder, *words)


def test_its_rows_are_read_behind_those_of_the_schedule(ingested, tmp_path):
    raw = ingested / "raw" / "small"
    before = small_run.state(raw)
    answer = ask(ingested, "--for", "K_b", "--csv", "--count", "6")
    assert answer.exit_code == 0, answer.output
    assert small_run.state(raw) == before
    table = (raw / "trials.csv").read_text()
    header, *rows = answer.stdout.splitlines()
    assert header == table.splitlines()[0]
    (tmp_path / "trials.csv").write_text(table + "\n".join(rows) + "\n")
    campaign = manifests.load(raw)
    read = schedules.read_schedule(campaign, tmp_path)
    old = schedules.read_schedule(campaign, raw)
    assert len(read) == len(old) + 24
    assert read.visit[-1] == old.visit[-1] + 6
    assert set(np.round(read.z_m, 9)) == set(np.round(old.z_m, 9))
    assert np.isnan(read.covariates["start_s"][-24:]).all()
    found = json.loads(ask(ingested, "--for", "K_b", "--json", "--count", "6").stdout)
    ways = [v["approach"] for v in found["boundaries"]["ground"]["visits"]]
    assert read.covariates["approach"][-24::4].tolist() == ways
    for visit in range(old.visit[-1] + 1, read.visit[-1] + 1):
        assert sorted(read.throttle[read.visit == visit]) == sorted(small_run.FAR)


def test_a_table_for_the_eye_and_one_for_programs(ingested):
    shown = ask(ingested, "--for", "K_b", "--until", "0.02")
    assert shown.exit_code == 0, shown.output
    assert "more trials" in shown.stdout
    found = json.loads(ask(ingested, "--for", "K_b", "--until", "0.02", "--json").stdout)
    own = found["boundaries"]["ground"]
    assert len(own["visits"]) == 10
    assert all(line in shown.stdout for line in own["text"])


def test_the_share_that_goes_round_is_the_users(ingested):
    def after(*words):
        found = json.loads(ask(ingested, "--for", "K_b", "--json", *words).stdout)
        return found["boundaries"]["ground"]["after"]

    assert after() == after("--rounds", str(ROUNDS))
    assert after("--rounds", "0") < after() < after("--rounds", "1")
    assert ask(ingested, "--for", "K_b", "--rounds", "1.5").exit_code == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--for", "K_x"), "no base model of this campaign has that coefficient"),
        (("--for", "separate"), "names no two explanations that it cannot distinguish"),
        (("--for", "separate=supply_sag,supply_sag"), "needs two different effects"),
        (("--for", "separate", "--until", "1"), "is u of a coefficient"),
        (("--for", "K_b", "--csv", "--json"), "was asked for with --json"),
        (("--for", "separate=supply_sag,gain_drift"), "supply_sag cannot be tested"),
    ],
)
def test_what_cannot_be_asked_is_refused_with_a_remedy(ingested, words, said):
    answer = ask(ingested, *words)
    assert answer.exit_code in (2, 4)
    assert said in answer.output


def test_what_the_supply_is_to_be_set_to_stands_in_the_rows(make_job):
    job = job_of(make_job, trials={"units": {"distance": "mm", "throttle": "percent"}})
    ((found,), _) = next_visits(job, VisitQuestion.parsed("separate=supply_sag,gain_drift"), 4)
    (job.root / "trials.csv").write_text("trial,boundary,distance,throttle\nt0000,ground,30,25\n")
    header, *rows = next_rows(job, (found,)).splitlines()
    assert header == "trial,boundary,distance,throttle,supply"
    volts = [float(row.split(",")[4]) for row in rows]
    assert len(set(volts)) == 2
    assert max(volts) / min(volts) == pytest.approx(1.025 / 0.975, rel=1e-3)
    assert rows[0].split(",")[0] == f"t{len(job.read(TRIALS)['trial']):04d}"


def job_of(make_job, **given):
    return make_job(("ground",), repeats=3, **given)


def test_every_boundary_has_its_own_visits(small_job):
    asked = VisitQuestion.parsed("separate=height_offset,approach_backlash")
    found, notes = next_visits(small_job, asked, 4)
    assert [of.boundary for of in found] == ["ground", "ceiling"]
    # there the amplitude absorbs an offset altogether
    assert notes[0].startswith("sidewall: height_offset is absorbed by the coefficients")
    assert all(len(of.visits) == 4 and of.parts for of in found)


@pytest.mark.parametrize(
    ("given", "throttles"),
    [({"throttles": (0.5,)}, 1), ({"levels": {"by": "curve", "of": ["throttle"], "degree": 2}}, 4)],
    ids=["one throttle", "a curve of lift"],
)
def test_any_levels_can_be_planned_for(make_job, given, throttles):
    ((found,), _) = next_visits(job_of(make_job, **given), VisitQuestion.parsed("K_b"), 3)
    assert found.throttles == throttles
    assert found.after < found.now
    assert any("fill in the mean lift" in note for note in found.notes)
    # 19 trials at one throttle are too few for a diagnosis
    assert ("too few" in found.notes[0]) == (throttles == 1)


def test_a_quoted_uncertainty_of_another_kind_is_told(make_job):
    job = job_of(make_job)
    results = job.read_json(RESULTS)
    own = results["boundaries"]["ground"]["coefficients"]["K_b"]
    assert not any(
        "results.json" in n for n in next_visits(job, VisitQuestion.parsed("K_b"))[0][0].notes
    )
    own["u"] *= 10
    job.write(RESULTS, results)
    ((found,), _) = next_visits(job, VisitQuestion.parsed("K_b"), 2)
    assert any(f"results.json quotes u(K_b) = {own['u']:.2g}" in note for note in found.notes)


def test_nothing_to_plan_from_is_refused(make_job):
    job = job_of(make_job)
    trials = job.read(TRIALS)
    trials["quality"][:] = "SATURATED"
    job.write(TRIALS, trials)
    with pytest.raises(InputRefused, match="no trial was accepted"):
        next_visits(job, VisitQuestion.parsed("K_b"))


def test_the_question_is_read_as_it_is_written():
    assert VisitQuestion.parsed("separate= tilt , reynolds").pair == ("tilt", "reynolds")
    with pytest.raises(UsageError, match="needs two different effects"):
        VisitQuestion.parsed("separate=tilt,tilt")
