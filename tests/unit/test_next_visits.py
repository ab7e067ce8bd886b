"""The next visits of a campaign: which, in which order, what they bring, and what they give up."""

import dataclasses
import json

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.errors import InputRefused, UsageError
from nearlift.likelihood import budget
from nearlift.likelihood.covariates import derive
from nearlift.loop import coefficients, next_visits, separation
from nearlift.loop.search_problem import Options, SearchProblem
from nearlift.products import RESULTS
from nearlift.readers import schedule as schedules
from nearlift.results import Noise
from nearlift.results.diagnosis import FORM_SD
from nearlift.results.next_visits import NextVisits
from nearlift.stages import next_rows
from nearlift.stages import next_visits as stage_of_next
from nearlift.stages.asked import ROUNDS, Asked
from nearlift.stages.traverse import Traverse

from . import simulated, small_run

BASE = catalogue.model("sanchez_cuevas")
NOISE = Noise(relative=0.004, force_N=3e-4, height_m=1e-4)


def stage_of(data, parts=()):
    data = derive(data, np.array([simulated.L_INF[t] for t in data.throttle]))
    stage = SearchProblem(
        data=data,
        base=BASE,
        effects=tuple(catalogue.effect(n) for n in ("supply_sag", "gain_drift")),
        parts=parts,
        noise=NOISE,
        log_lift=np.log(data.lift_N),
        theta=np.array([2.0]),
        options=Options(),
    )
    return dataclasses.replace(stage, theta=stage.base_fit.vector)


@pytest.fixture(scope="module")
def stage():
    return stage_of(simulated.campaign(3, visits=2))


@pytest.fixture(scope="module")
def plan(stage):
    menu = next_visits.menu(stage.data, np.array(simulated.STATIONS))
    return next_visits.plan(stage, next_visits.of_coefficient(stage.base_fit, 0), menu, ROUNDS)


def test_what_is_known_now_is_what_the_fit_says(stage, plan):
    u = coefficients.spread(stage, stage.base_fit)[1][0]
    assert plan.u(plan.now) == pytest.approx(u, rel=1e-6)


def test_a_seed_decides_the_batch_and_another_changes_its_order(plan):
    one, again, other = (plan.batch(10, np.random.default_rng(s)) for s in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    assert sorted(one) == sorted(other)


@pytest.mark.parametrize("count", [1, 4, 10])
def test_half_of_all_visits_go_round_all_stations(plan, count):
    made = np.zeros(0, dtype=int)
    rng = np.random.default_rng(5)
    while len(made) < 40:
        made = np.r_[made, plan.batch(count, rng, made)]
    # two rounds of ten stations; by the coefficient alone it would be two or three of them
    often = np.bincount(made[:40], minlength=10)
    assert often.min() >= 2
    assert often.max() > 8


def test_a_station_that_nobody_visited_comes_first():
    data = simulated.campaign(3, visits=2)
    own = stage_of(data.take(~np.isin(data.z_hat, (1.8, 6.0))))
    menu = next_visits.menu(own.data, np.array(simulated.STATIONS))
    plan = next_visits.plan(own, next_visits.of_coefficient(own.base_fit, 0), menu, ROUNDS)
    assert {1.8, 6.0} <= set(menu.z_hat[plan.batch(4, np.random.default_rng(0))])


def test_no_two_visits_of_a_station_follow_each_other(plan):
    for seed in range(20):
        at = np.r_[plan.last, plan.batch(10, np.random.default_rng(seed))]
        assert np.all(at[1:] != at[:-1]), at


def test_the_uncertainty_foretold_is_that_of_a_campaign_with_these_visits(stage, plan):
    rng = np.random.default_rng(8)
    visits = plan.until(0.6 * float(plan.u(plan.now)), 10, rng)
    extra = simulated.campaign(11, visits=40)
    first = {z: list(np.unique(extra.visit[extra.z_hat == z])) for z in simulated.STATIONS}
    rows = np.concatenate(
        [np.flatnonzero(extra.visit == first[plan.menu.z_hat[v]].pop()) for v in visits]
    )
    later = extra.take(rows)
    n = stage.data.n + later.n
    later = dataclasses.replace(
        later, visit=np.repeat(np.arange(len(visits)), 4) + 100, session=np.full(later.n, 4)
    )
    keep = dict.fromkeys(simulated.campaign(3, visits=2).covariates)
    joined = separation.join(
        dataclasses.replace(stage.data, covariates={k: stage.data.covariates[k] for k in keep}),
        dataclasses.replace(later, covariates={k: later.covariates[k] for k in keep}),
    )
    then = stage_of(
        dataclasses.replace(
            joined, covariates={**joined.covariates, "start_s": 21.0 * np.arange(n)}
        )
    )
    u = coefficients.spread(then, then.base_fit)[1][0]
    assert float(plan.u(plan.after(visits))) == pytest.approx(u, rel=0.05)


def test_it_stops_where_the_aim_is_reached_and_not_before(plan):
    aim = 0.7 * float(plan.u(plan.now))
    visits = plan.until(aim, 10, np.random.default_rng(0))
    assert plan.u(plan.after(visits)) <= aim < plan.u(plan.after(visits[:-1]))
    assert len(visits) < plan.evenly(aim)


def test_what_all_trials_share_cannot_be_visited_away(stage):
    datum = budget.Component(
        name="datum", on="height", standard=1e-3, distribution="normal", scope="boundary"
    )
    two = np.array([1.14, 11.5])
    own = stage_of(stage.data.take(np.isin(stage.data.z_hat, two)), (datum,))
    question = next_visits.of_coefficient(own.base_fit, 0)
    plan = next_visits.plan(own, question, next_visits.menu(own.data, two), ROUNDS)
    u = coefficients.spread(own, own.base_fit)[1][0]
    assert plan.u(plan.now) == pytest.approx(u, rel=1e-6)
    # a millimetre moves the nearest station by so much of K_b, whoever goes there how often
    near = own.data.z_hat == two[0]
    moves = 1e-3 * own.slope[near][0] / own.candidate().jacobian(own.theta)[near][0, 0]
    assert plan.least == pytest.approx(abs(moves), rel=0.1)
    assert plan.until(0.9 * plan.least, 10, np.random.default_rng(0)) is None
    assert plan.evenly(0.9 * plan.least) is None


def test_going_round_gives_nothing_up_and_asking_for_one_thing_nearly_all(plan):
    aim = 0.6 * float(plan.u(plan.now))
    chance = {}
    for rotating in (1.0, 0.5, 0.0):
        visits, rng = np.zeros(0, dtype=int), np.random.default_rng(0)
        own = dataclasses.replace(plan, rotating=rotating)
        while plan.u(plan.after(visits)) > aim:
            visits = np.r_[visits, own.batch(10, rng, visits)]
        evenly = plan.now + plan.evenly(float(plan.u(plan.after(visits)))) * plan.of_round
        chance[rotating] = plan.sees(plan.after(visits), evenly, 1e-3)
    assert chance[1.0] == pytest.approx(next_visits.SEEN, abs=0.05)
    assert chance[0.0] < 0.7 * chance[0.5] < chance[0.5] < 0.9 * chance[1.0]


def test_the_less_goes_round_the_sooner_the_answer(plan):
    known = []
    for share in (1.0, 0.5, 0.3, 0.0):
        own = dataclasses.replace(plan, rotating=share)
        visits = own.batch(40, np.random.default_rng(0))
        often = np.bincount(plan.menu.station[visits], minlength=len(plan.made))
        # rounds of a third of 40 visits still come to most of the stations
        assert often.min() >= int(share * 40) // len(plan.made)
        known.append(float(plan.u(plan.after(visits))))
    assert known == sorted(known, reverse=True)
    assert known[3] < known[2] < known[1] < known[0]


def test_expected_evidence_is_what_the_rival_cannot_imitate(stage):
    """By a fit of its own: of the one as it stands, what the other leaves with its form free."""
    one, other = stage.effects
    mine, theirs = (stage.candidate(e) for e in (one, other))
    vectors = np.r_[2.0, 2.0], np.r_[2.0, 0.01]
    question = next_visits.of_rivals(stage, ((one,), vectors[0]), ((other,), vectors[1]))
    menu = next_visits.menu(stage.data, np.array(simulated.STATIONS), move_supply=True)
    plan = next_visits.plan(stage, question, menu, ROUNDS)
    left = stage.space.project(mine.log_ratio(vectors[0]) - theirs.log_ratio(vectors[1]))
    columns = np.hstack([theirs.jacobian(vectors[1]), theirs.tube(vectors[1], FORM_SD)])
    forms = columns.shape[1] - theirs.size
    weight = np.r_[1 / theirs.prior[1], np.ones(forms)]
    white = np.vstack([stage.space.project(columns.T).T, np.diag(weight)])
    target = np.r_[left, np.zeros(len(weight))]
    rest = target - white @ np.linalg.lstsq(white, target, rcond=None)[0]
    assert float(plan.u(plan.now)) ** -2 == pytest.approx(rest @ rest, rel=1e-3)


def test_the_supply_is_moved_to_part_it_from_time(stage):
    one, other = stage.effects
    question = next_visits.of_rivals(stage, ((one,), np.r_[2.0, 2.0]), ((other,), np.r_[2.0, 0.0]))
    still, moved = (
        next_visits.plan(
            stage,
            question,
            next_visits.menu(stage.data, np.array(simulated.STATIONS), move),
            ROUNDS,
        )
        for move in (False, True)
    )
    rng = np.random.default_rng(0)
    picks = moved.batch(10, rng)
    volts = moved.menu.supply_V[picks]
    assert np.sum(volts > volts.mean()) in range(3, 8)
    gain = [p.u(p.after(p.batch(10, rng))) ** -2 - p.u(p.now) ** -2 for p in (still, moved)]
    assert gain[1] > 3 * gain[0]


def test_the_words_say_where_to_stop_and_what_is_given_up():
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
        visits_evenly=30,
        best=0.0,
        sees=0.31,
        sees_evenly=0.9,
        visits=(),
    )
    assert told.stop == (
        "u(K_b) = 0.05 after about 40 more trials; 120 at all stations equally often"
    )
    assert "with a chance of 90 %" in told.lines[-1]
    assert told.lines[-1].endswith("these visits see with 31 %")
    never = dataclasses.replace(told, visits_wanted=None, best=0.06)
    assert never.stop.startswith("u(K_b) = 0.05: out of reach of these stations")
    assert (
        "reached; for structure in distance go on"
        in dataclasses.replace(told, visits_wanted=0).stop
    )


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
    campaign = small_run.manifests.load(raw)
    read = schedules.read_schedule(campaign, tmp_path)
    old = schedules.read_schedule(campaign, raw)
    assert len(read) == len(old) + 24
    assert read.visit[-1] == old.visit[-1] + 6
    assert set(np.round(read.z_m, 9)) == set(np.round(old.z_m, 9))
    assert np.all(np.diff(read.covariates["start_s"][-25:]) > 0)
    found = json.loads(ask(ingested, "--for", "K_b", "--json", "--count", "6").stdout)
    ways = [v["approach"] for v in found["boundaries"]["ground"]["visits"]]
    assert read.covariates["approach"][-24::4].tolist() == ways
    for visit in range(old.visit[-1] + 1, read.visit[-1] + 1):
        assert sorted(read.throttle[read.visit == visit]) == sorted(small_run.FAR)


def test_either_side_of_a_station_comes_as_often():
    shown = {1.2: 0.03, 2.0: 0.05, 4.0: 0.1, 12.0: 0.3}
    along = Traverse(shown_m=shown, balance={2.0: 2.0}, overshoot_m=2e-3)
    rng = np.random.default_rng(0)
    z_hat = [12.0 if i % 2 else z for i, z in enumerate(np.repeat([2.0, 4.0, 1.2], 8))]
    ways = along.ways(z_hat, 12.0, rng)
    sides = {z: [way for own, (way, _) in zip(z_hat, ways, strict=True) if own == z] for z in shown}
    # what was unbalanced is balanced first, and both ends have one side only
    assert sides[2.0] == [-1, -1, *sides[2.0][2:]]
    assert sum(sides[2.0]) == -2
    assert sum(sides[4.0]) == 0
    assert set(sides[1.2]) == {-1}
    assert set(sides[12.0]) == {1}
    last = 12.0
    for z, (way, via) in zip(z_hat, ways, strict=True):
        arrived_from = shown[last] if via is None else via
        assert way == (1 if shown[z] > arrived_from else -1)
        assert via is None or abs(via - shown[z]) == pytest.approx(2e-3)
        last = z
    # nobody drives past a station where sides are not logged
    free = dataclasses.replace(along, overshoot_m=0.0).ways(z_hat, 12.0, rng)
    assert all(via is None for _, via in free)


def test_a_table_for_the_eye_and_one_for_programs(ingested):
    shown = ask(ingested, "--for", "K_b", "--until", "0.02")
    assert shown.exit_code == 0, shown.output
    assert "more trials;" in shown.stdout
    found = json.loads(ask(ingested, "--for", "K_b", "--until", "0.02", "--json").stdout)
    own = found["boundaries"]["ground"]
    assert len(own["visits"]) == 10
    assert own["visits_wanted"] < own["visits_evenly"]
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
        (("--for", "separate"), "names no two explanations that it cannot tell apart"),
        (("--for", "separate=supply_sag,supply_sag"), "wants two different effects"),
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
    ((found,), _) = stage_of_next.run(job, Asked.of("drift"), 4)
    (job.root / "trials.csv").write_text("trial,boundary,distance,throttle\nt0000,ground,30,25\n")
    header, *rows = next_rows.as_schedule(job, (found,)).splitlines()
    assert header == "trial,boundary,distance,throttle,supply"
    volts = [float(row.split(",")[4]) for row in rows]
    assert len(set(volts)) == 2
    assert max(volts) / min(volts) == pytest.approx(1.025 / 0.975, rel=1e-3)
    assert rows[0].split(",")[0] == f"t{len(job.read(stage_of_next.TRIALS)['trial']):04d}"


def job_of(make_job, **given):
    return make_job(("ground",), repeats=3, **given)


def test_every_boundary_has_its_own_visits(small_job):
    asked = Asked.of("separate=height_offset,approach_backlash")
    found, notes = stage_of_next.run(small_job, asked, 4)
    assert [of.boundary for of in found] == ["ground", "ceiling"]
    # there the amplitude absorbs an offset altogether
    assert notes[0].startswith("sidewall: height_offset leaves no mark")
    assert all(len(of.visits) == 4 and of.parts for of in found)


def test_one_throttle_is_enough(make_job):
    ((found,), _) = stage_of_next.run(job_of(make_job, throttles=(0.5,)), Asked.of("K_b"))
    # 19 trials: too few for a diagnosis
    assert "too few" in found.notes[0]
    assert found.throttles == 1
    assert found.after < found.now


def test_a_curve_of_lift_is_planned_for_at_its_throttles(make_job):
    job = job_of(make_job, levels={"by": "curve", "of": ["throttle"], "degree": 2})
    ((found,), _) = stage_of_next.run(job, Asked.of("K_b"), 3)
    assert found.throttles == 4
    assert found.after < found.now


def test_a_table_of_means_is_told_what_to_fill_in(make_job):
    ((found,), _) = stage_of_next.run(job_of(make_job), Asked.of("K_b"), 2)
    assert any("fill in the mean lift" in note for note in found.notes)


def test_a_quoted_uncertainty_of_another_kind_is_told(make_job):
    job = job_of(make_job)
    results = job.read_json(RESULTS)
    own = results["boundaries"]["ground"]["coefficients"]["K_b"]
    assert not any("results.json" in n for n in stage_of_next.run(job, Asked.of("K_b"))[0][0].notes)
    own["u"] *= 10
    job.write_json(RESULTS, results)
    ((found,), _) = stage_of_next.run(job, Asked.of("K_b"), 2)
    assert any(f"results.json quotes u(K_b) = {own['u']:.2g}" in note for note in found.notes)


def test_nothing_to_plan_from_is_refused(make_job):
    job = job_of(make_job)
    trials = job.read(stage_of_next.TRIALS)
    trials["quality"][:] = "SATURATED"
    job.write(stage_of_next.TRIALS, trials)
    with pytest.raises(InputRefused, match="no trial was accepted"):
        stage_of_next.run(job, Asked.of("K_b"))


def test_the_question_is_read_as_it_is_written():
    assert Asked.of("drift").pair == ("supply_sag", "gain_drift")
    assert Asked.of("separate= tilt , reynolds").pair == ("tilt", "reynolds")
    with pytest.raises(UsageError, match="wants two different effects"):
        Asked.of("drift=tilt,reynolds")
