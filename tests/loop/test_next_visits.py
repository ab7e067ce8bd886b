"""The next visits of a campaign: which, in which order, what they bring, and what they give up."""

import dataclasses

import numpy as np
import pytest
from tests.unit import simulated

from nearlift import catalogue
from nearlift.likelihood import budget
from nearlift.likelihood.covariates import derive
from nearlift.loop import coefficients, next_visits, separation
from nearlift.loop.search_problem import Options, SearchProblem
from nearlift.results import Noise
from nearlift.results.diagnosis import FORM_SD

BASE = catalogue.model("sanchez_cuevas")
#: Of all visits go round the stations.
HALF = 0.5
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
    return next_visits.plan(stage, next_visits.of_coefficient(stage.base_fit, 0), menu, HALF)


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
    plan = next_visits.plan(own, next_visits.of_coefficient(own.base_fit, 0), menu, HALF)
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


def test_what_all_trials_share_cannot_be_visited_away(stage):
    datum = budget.Component(
        name="datum", on="height", standard=1e-3, distribution="normal", scope="boundary"
    )
    two = np.array([1.14, 11.5])
    own = stage_of(stage.data.take(np.isin(stage.data.z_hat, two)), (datum,))
    question = next_visits.of_coefficient(own.base_fit, 0)
    plan = next_visits.plan(own, question, next_visits.menu(own.data, two), HALF)
    u = coefficients.spread(own, own.base_fit)[1][0]
    assert plan.u(plan.now) == pytest.approx(u, rel=1e-6)
    # a millimetre moves the nearest station by so much of K_b, whoever goes there how often
    near = own.data.z_hat == two[0]
    moves = 1e-3 * own.slope[near][0] / own.candidate().jacobian(own.theta)[near][0, 0]
    assert plan.least == pytest.approx(abs(moves), rel=0.1)
    assert plan.until(0.9 * plan.least, 10, np.random.default_rng(0)) is None


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
    plan = next_visits.plan(stage, question, menu, HALF)
    left = stage.space.project(mine.log_ratio(vectors[0]) - theirs.log_ratio(vectors[1]))
    columns = np.hstack([theirs.jacobian(vectors[1]), theirs.form_discrepancy(vectors[1], FORM_SD)])
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
            HALF,
        )
        for move in (False, True)
    )
    rng = np.random.default_rng(0)
    picks = moved.batch(10, rng)
    volts = moved.menu.supply_V[picks]
    assert np.sum(volts > volts.mean()) in range(3, 8)
    gain = [p.u(p.after(p.batch(10, rng))) ** -2 - p.u(p.now) ** -2 for p in (still, moved)]
    assert gain[1] > 3 * gain[0]


@pytest.mark.parametrize("count", [4, 7, 8, 9])
def test_a_session_holds_160_trials_at_most_every_throttle_at_each_visit(stage, count):
    """Of more than eight throttles, four."""
    throttle = np.resize(np.linspace(0.3, 0.9, count), stage.data.n)
    data = dataclasses.replace(stage.data, throttle=throttle)
    found = separation.session(data, (1.2, 2.0, 9.0))
    each = count if count <= 8 else 4
    assert found.n == 160 // each * each
    assert all(len(set(found.throttle[found.visit == v])) == each for v in set(found.visit))
    assert found.z_hat[::each].tolist() == np.resize([1.2, 2.0, 9.0], 160 // each).tolist()
    assert found.visit.min() > data.visit.max()
    supply = np.median(data.covariates["supply_V"])
    assert found.covariates["supply_V"] == pytest.approx(supply)
