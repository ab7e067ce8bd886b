"""The next visits of a campaign: which, in which order, what they bring, and what they give up."""

from dataclasses import replace

import numpy as np
import pytest
from tests.unit import simulated
from tests.unit.simulated import GROUND, STATIONS, part

from nearlift import catalogue
from nearlift.likelihood.covariates import derive
from nearlift.loop import coefficients, next_visits, separation
from nearlift.loop.search_problem import Options, SearchProblem
from nearlift.results import Noise
from nearlift.results.diagnosis import FORM_SD

#: Of all visits go round the stations.
HALF = 0.5
NOISE = Noise(relative=0.004, force_N=3e-4, height_m=1e-4)


def problem_of(data, parts=()):
    data = derive(data, np.array([simulated.L_INF[t] for t in data.throttle]))
    searched = SearchProblem(
        data=data,
        base=GROUND,
        effects=tuple(catalogue.effect(n) for n in ("supply_sag", "gain_drift")),
        parts=parts,
        noise=NOISE,
        log_lift=np.log(data.lift_N),
        theta=np.array([2.0]),
        options=Options(),
    )
    return replace(searched, theta=searched.base_fit.vector)


def plan_of(searched, question=None, stations=STATIONS, move_supply=False):
    """The plan for K_b, or for another question."""
    question = question or next_visits.of_coefficient(searched.base_fit, 0)
    menu = next_visits.menu(searched.data, np.array(stations), move_supply)
    return next_visits.plan(searched, question, menu, HALF)


def u_of(searched):
    return coefficients.spread(searched, searched.base_fit)[1][0]


@pytest.fixture(scope="module")
def searched():
    return problem_of(simulated.campaign(3, visits=2))


@pytest.fixture(scope="module")
def plan(searched):
    return plan_of(searched)


def test_a_seed_decides_the_batch_and_another_changes_its_order(plan):
    one, again, other = (plan.batch(10, np.random.default_rng(s)) for s in (1, 1, 2))
    assert np.array_equal(one, again)
    assert not np.array_equal(one, other)
    assert sorted(one) == sorted(other)
    # no two visits of a station follow each other
    for seed in range(20):
        at = np.r_[plan.last, plan.batch(10, np.random.default_rng(seed))]
        assert np.all(at[1:] != at[:-1]), at


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
    plan = plan_of(problem_of(data.take(~np.isin(data.z_hat, (1.8, 6.0)))))
    assert {1.8, 6.0} <= set(plan.menu.z_hat[plan.batch(4, np.random.default_rng(0))])


def test_the_predicted_uncertainty_is_that_of_a_campaign_with_these_visits(searched, plan):
    assert plan.u(plan.now) == pytest.approx(u_of(searched), rel=1e-6)
    visits = plan.until(0.6 * float(plan.u(plan.now)), 10, np.random.default_rng(8))
    extra = simulated.campaign(11, visits=40)
    first = {z: list(np.unique(extra.visit[extra.z_hat == z])) for z in STATIONS}
    rows = [np.flatnonzero(extra.visit == first[plan.menu.z_hat[v]].pop()) for v in visits]
    later = extra.take(np.concatenate(rows))
    number = np.repeat(np.arange(len(visits)), 4) + 100
    later = replace(later, visit=number, session=np.full(later.n, 4))
    logged = extra.covariates.keys()
    joined = separation.join(
        *(
            replace(data, covariates={k: data.covariates[k] for k in logged})
            for data in (searched.data, later)
        )
    )
    start = {"start_s": 21.0 * np.arange(searched.data.n + later.n)}
    then = problem_of(replace(joined, covariates=joined.covariates | start))
    assert float(plan.u(plan.after(visits))) == pytest.approx(u_of(then), rel=0.05)


def test_it_stops_where_the_aim_is_reached_and_not_before(plan):
    aim = 0.7 * float(plan.u(plan.now))
    visits = plan.until(aim, 10, np.random.default_rng(0))
    assert plan.u(plan.after(visits)) <= aim < plan.u(plan.after(visits[:-1]))


def test_what_all_trials_share_cannot_be_visited_away(searched):
    two = np.array([1.14, 11.5])
    datum = part(standard=1e-3)
    own = problem_of(searched.data.take(np.isin(searched.data.z_hat, two)), (datum,))
    plan = plan_of(own, stations=two)
    assert plan.u(plan.now) == pytest.approx(u_of(own), rel=1e-6)
    # a millimetre moves the nearest station by so much of K_b, whoever goes there how often
    near = own.data.z_hat == two[0]
    moves = 1e-3 * own.slope[near][0] / own.candidate().jacobian(own.theta)[near][0, 0]
    assert plan.least == pytest.approx(abs(moves), rel=0.1)
    assert plan.until(0.9 * plan.least, 10, np.random.default_rng(0)) is None


def test_the_less_goes_round_the_sooner_the_answer(plan):
    known = []
    for share in (1.0, 0.5, 0.3, 0.0):
        own = replace(plan, rotating=share)
        visits = own.batch(40, np.random.default_rng(0))
        often = np.bincount(plan.menu.station[visits], minlength=len(plan.made))
        # rounds of a third of 40 visits still come to most of the stations
        assert often.min() >= int(share * 40) // len(plan.made)
        known.append(float(plan.u(plan.after(visits))))
    assert known[3] < known[2] < known[1] < known[0]


def test_expected_evidence_is_what_the_rival_cannot_imitate(searched):
    """By a fit of its own: of the one as it is, what the other leaves with its form free."""
    one, other = searched.effects
    mine, theirs = (searched.candidate(e) for e in (one, other))
    vectors = np.r_[2.0, 2.0], np.r_[2.0, 0.01]
    question = next_visits.of_rivals(searched, ((one,), vectors[0]), ((other,), vectors[1]))
    plan = plan_of(searched, question, move_supply=True)
    left = searched.space.project(mine.log_ratio(vectors[0]) - theirs.log_ratio(vectors[1]))
    columns = np.hstack([theirs.jacobian(vectors[1]), theirs.form_discrepancy(vectors[1], FORM_SD)])
    weight = np.r_[1 / theirs.prior[1], np.ones(columns.shape[1] - theirs.size)]
    white = np.vstack([searched.space.project(columns.T).T, np.diag(weight)])
    target = np.r_[left, np.zeros(len(weight))]
    rest = target - white @ np.linalg.lstsq(white, target, rcond=None)[0]
    assert float(plan.u(plan.now)) ** -2 == pytest.approx(rest @ rest, rel=1e-3)


def test_the_supply_is_moved_to_distinguish_it_from_time(searched):
    one, other = (((e,), np.r_[2.0, x]) for e, x in zip(searched.effects, (2.0, 0.0), strict=True))
    question = next_visits.of_rivals(searched, one, other)
    still, moved = (plan_of(searched, question, move_supply=move) for move in (False, True))
    rng = np.random.default_rng(0)
    volts = moved.menu.supply_V[moved.batch(10, rng)]
    assert np.sum(volts > volts.mean()) in range(3, 8)
    gain = [p.u(p.after(p.batch(10, rng))) ** -2 - p.u(p.now) ** -2 for p in (still, moved)]
    assert gain[1] > 3 * gain[0]


@pytest.mark.parametrize("count", [4, 7, 8, 9])
def test_a_session_holds_160_trials_at_most_every_throttle_at_each_visit(searched, count):
    """Of more than eight throttles, four."""
    throttle = np.resize(np.linspace(0.3, 0.9, count), searched.data.n)
    data = replace(searched.data, throttle=throttle)
    session = separation.session(data, (1.2, 2.0, 9.0))
    each = count if count <= 8 else 4
    assert session.n == 160 // each * each
    assert all(len(set(session.throttle[session.visit == v])) == each for v in set(session.visit))
    assert session.z_hat[::each].tolist() == np.resize([1.2, 2.0, 9.0], 160 // each).tolist()
    assert session.visit.min() > data.visit.max()
    supply = np.median(data.covariates["supply_V"])
    assert session.covariates["supply_V"] == pytest.approx(supply)
