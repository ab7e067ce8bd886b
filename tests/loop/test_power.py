"""Predicted power of a design, tested by trials drawn at random and by closed forms."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.unit.simulated import GROUND, campaign, hsiao, problem

from nearlift import catalogue
from nearlift.loop import predictions
from nearlift.loop.expected_noise import planned
from nearlift.loop.limits import unidentifiable_coefficients
from nearlift.loop.power import LIMIT_POWER, size_parameters
from nearlift.loop.search import run
from nearlift.loop.search_problem import Options
from nearlift.loop.within_trial import heating, power
from nearlift.results import Noise
from nearlift.results.answers import Power
from nearlift.synthetic.trial_schedule import _williams, balanced, from_both_sides, randomised

NOISE = Noise(relative=0.004, force_N=3e-4, height_m=1e-4)


def foresee(data, model=GROUND, theta=2.0):
    return planned(data, model, (), NOISE, Options(), np.array([theta]))[0]


@pytest.fixture(scope="module")
def design():
    return foresee(campaign(7, visits=8))


def size_parameter(name):
    return size_parameters(catalogue.effect(name))[0]


def test_without_an_effect_the_chance_is_the_false_alarm_rate(design):
    nothing = np.zeros(design.problem.hypotheses[1].shape[1])
    # 1000 draws at 5 %, and a threshold from 6000: 3 sd of their difference is 2.2 %
    assert replace(design, quiet=1.0).seen(nothing).mean() == pytest.approx(0.05, abs=0.022)
    # the floor comes out a little higher than the noise is
    assert 0.85 < design.quiet < 1.03


def test_a_limit_is_where_the_chance_is_eighty_per_cent(design):
    h = size_parameter("supply_sag")
    limit = design.limit(h)
    assert design.seen(design.visible(h, limit)).mean() == pytest.approx(LIMIT_POWER, abs=0.03)
    # four times the trials of the same kind see half the size
    data, index = design.problem.data, np.tile(np.arange(design.problem.data.n), 4)
    again = np.repeat(np.arange(4), data.n) * (data.visit.max() + 1)
    more = replace(data.take(index), visit=data.visit[index] + again)
    assert foresee(more).limit(h) / limit == pytest.approx(0.5, abs=0.13)
    size = np.array([0.0, 1.0, 2.0])
    seen, within = np.array([0.0, 0.6, 1.0]), np.array([0.0, 0.1, 0.2])
    curve = Power(size=size, seen=seen, within=within, first=size * 0, alone=size * 0)
    assert curve.limit(LIMIT_POWER) == pytest.approx(1.5)
    assert curve.limit(LIMIT_POWER, "within") is None


@pytest.mark.nightly
def test_the_predicted_chance_is_that_of_drawn_trials(design):
    """24 campaigns at the limit, seen in 80 %: 11 or fewer by chance once in a thousand, all of
    them once in two hundred.
    """
    limit = design.limit(size_parameter("session_gain"))
    searched, d = design.problem, design.problem.data
    rng, seen = np.random.default_rng(5), 0
    for _ in range(24):
        draw = rng.normal(size=5)
        gain = limit * (draw - draw.mean()) / np.std(draw)
        jitter = rng.normal(0, NOISE.height_m, d.visit.max() + 1)[d.visit] * searched.slope
        noise = NOISE.relative * rng.normal(size=d.n) + NOISE.force_N / d.lift_N * rng.normal(
            size=d.n
        )
        log_lift = np.log(d.lift_N) + np.log1p(gain[d.session]) + noise + jitter
        drawn = replace(searched, log_lift=log_lift, data=replace(d, lift_N=np.exp(log_lift)))
        seen += drawn.nothing_added[0].present
    assert 12 <= seen <= 23


def test_the_first_visible_part_is_what_theta_and_levels_leave(design):
    raw, left = design.signature(size_parameter("height_offset"), 1e-3)
    searched = design.problem
    assert np.sqrt(np.mean(left**2)) < 0.4 * np.sqrt(np.mean(raw**2))
    absorbed, levels = raw - left, np.eye(4)[searched.data.level]
    columns = np.hstack([levels, searched.candidate().jacobian(searched.base_fit.vector)])
    fitted = columns @ np.linalg.lstsq(columns, absorbed, rcond=None)[0]
    assert absorbed == pytest.approx(fitted, abs=1e-9)
    # per cent of lift per mm at z_hat = 1.14, as the declaration says
    assert raw[np.argmin(searched.data.z_hat)] == pytest.approx(-0.0043, rel=0.25)


def test_harm_is_the_shift_of_a_fit_to_trials_that_hold_the_effect(design):
    searched = design.problem
    shift = design.harm(size_parameter("height_offset"), 5e-4)[0]
    held = searched.candidate(catalogue.effect("height_offset")).log_ratio(np.array([2.0, 5e-4]))
    log_lift = np.log(searched.data.covariates["lift_inf_N"]) + held
    fitted = replace(searched, log_lift=log_lift).base_fit
    assert shift == pytest.approx(fitted.vector[0] - 2.0, abs=2e-3)
    assert shift < -0.03


def test_a_near_double_is_a_rival_and_a_stranger_is_not(design):
    contest = design.contest(size_parameter("image_strength"), 0.2)
    assert contest.seen > 0.95
    assert contest.rivals["held_quantity"] > 0.6
    assert contest.rivals["airframe_stagnation"] > 0.8
    assert contest.rivals.get("supply_sag", 0.0) < 0.05
    assert contest.alone < 0.1
    shares = design.absorbed(size_parameter("image_strength"))
    assert shares["held_quantity"] > 0.99
    assert all(0 <= s <= 1 for s in shares.values())
    assert list(shares.values()) == sorted(shares.values(), reverse=True)
    # a strong sag is named alone in the forecast, and by the search on drawn trials
    assert design.contest(size_parameter("supply_sag"), 0.5).alone > 0.99
    data = campaign(31, visits=8, gain=lambda c: (c["supply_V"] / 3.8) ** 0.5)
    assert [e.name for e in run(problem(data)).accepted] == ["supply_sag"]


def test_what_theta_absorbs_is_silent_and_has_no_limit():
    stations = (0.15, 0.2, 0.3, 0.5, 0.8, 1.5, 3.0, 10.0)
    data = campaign(3, boundary="ceiling", ratio=hsiao, stations=stations, visits=8)
    design = foresee(data, catalogue.model("hsiao_chirarattananon"), 0.125)
    row = predictions.effect_outlook(design, size_parameter("height_scale"), [1.0])
    assert (row.verdict, row.detection_limit, row.seen) == ("silent", None, 0)
    assert row.bias["alpha"].in_u != 0
    assert predictions.effect_outlook(design, size_parameter("session_gain"), [1.0]).seen > 0.5


def test_groups_are_linked_pairs():
    def row(name, verdict="detectable, confounded", **rivals):
        return SimpleNamespace(effect=name, verdict=verdict, rivals=rivals)

    small = row("f", "too small to see", a=0.9)
    rows = [row("a", b=0.9), row("b", c=0.6), row("c"), row("d", e=0.4), small, row("g", h=0.7)]
    assert predictions.groups(rows) == (("a", "b", "c"), ("g", "h"))


def test_the_same_trials_from_both_sides_let_backlash_show(design):
    """Always from afar, backlash is an offset; from both sides it is itself."""
    data, h = design.problem.data, size_parameter("approach_backlash")
    mixed = np.where(np.random.default_rng(1).random(data.visit.max() + 1) < 0.5, 1.0, -1.0)
    one, both = (
        np.linalg.norm(
            foresee(replace(data, covariates=data.covariates | {"approach": a})).visible(h, 2e-4)
        )
        for a in (np.where(np.arange(data.n) < 8, 1.0, -1.0), mixed[data.visit])
    )
    assert both > 1.8 * one


def test_heating_is_seen_at_its_limit_with_the_stated_chance():
    data, rng = campaign(4, visits=5), np.random.default_rng(1)

    def with_drift(mean):
        drift = {"drift_hat": mean + rng.normal(0, 0.02, data.n)}
        return replace(data, covariates=data.covariates | drift)

    predicted = power(with_drift(0.0), 0.05, 0.8)
    assert predicted.visits == 50
    library = catalogue.effects()
    seen = sum(heating(with_drift(predicted.limit), library, 0.05).significant for _ in range(200))
    # 160 of 200 expected; the limit itself is known to a tenth, which is worth 5 %
    assert 125 <= seen <= 190
    assert power(data, 0.05, 0.8) is None


def test_a_visit_holds_one_distance_always_and_that_is_no_finding(design):
    """Sessions hold them all; only a campaign of a few long visits has no more sessions than
    visits.
    """
    searched, data = design.problem, design.problem.data
    assert unidentifiable_coefficients(searched, searched.base_fit) == ()
    few = foresee(data.take(np.isin(data.visit, np.unique(data.visit)[:15]))).problem
    texts = [f.text for f in unidentifiable_coefficients(few, few.base_fit)]
    assert any("and a gain for every visit" in t for t in texts)


# ---- schedules


@pytest.mark.parametrize("count", [2, 3, 4, 5, 6])
def test_each_throttle_follows_each_other_equally_often(count):
    orders = _williams(count)
    follows = np.zeros((count, count), dtype=int)
    for row in orders:
        assert sorted(row) == list(range(count))
        np.add.at(follows, (row[:-1], row[1:]), 1)
    assert len(set(follows[~np.eye(count, dtype=bool)])) == 1


def test_a_balanced_schedule_keeps_visits_and_comes_from_both_sides():
    stations = [0.026, 0.03, 0.04, 0.06, 0.1, 0.25, 0.25]
    plain = randomised({"ground": stations}, seed=3, visits=8)
    drawn = from_both_sides(balanced(plain, seed=3), overshoot_m=0.005, seed=3)
    assert np.array_equal(drawn.recorded_m, plain.recorded_m)
    for visit in np.unique(drawn.visit):
        assert sorted(drawn.throttle[drawn.visit == visit]) == [0.25, 0.5, 0.75, 0.92]
    assert drawn.approach[drawn.recorded_m == 0.06].mean() == 0
    # nearest and farthest can be reached from one side alone
    assert set(drawn.approach[drawn.recorded_m == 0.026]) == {-1.0}
    via = drawn.further["via_m"]
    detour = np.isfinite(via)
    assert np.all((via[detour] >= 0.026) & (via[detour] <= 0.25))
    assert np.array_equal(np.sign(drawn.recorded_m - via)[detour], drawn.approach[detour])
    # a station that is listed twice is visited twice a round, and not twice running
    far = drawn.recorded_m[np.unique(drawn.visit, return_index=True)[1]] == 0.25
    assert far.sum() == 16
    assert np.mean(far[1:] & far[:-1]) < 0.05
