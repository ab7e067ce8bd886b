"""Answers that depend on one trial or visit: what is reported is what a new diagnosis without it
gives.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.loop.test_small_tables import BASES, table
from tests.unit.simulated import GROUND, campaign, problem

from nearlift.likelihood.covariates import derive
from nearlift.loop import diagnose as loop
from nearlift.loop import search, stability
from nearlift.loop.diagnose import diagnose
from nearlift.loop.evidence import CREDIT
from nearlift.loop.search_problem import Options
from nearlift.loop.stability import (
    LEAST_SHIFT,
    TRIES,
    Without,
    contradicting,
    influential_trials,
    trials_flipping_a_test,
    trials_to_try,
    visits_to_try,
    with_decisive_trial,
    with_decisive_visits,
    without_visits,
)
from nearlift.report.phrases import dependence
from nearlift.results.quotation import RestsOn, Shift


def fading(known):
    return 1 - 0.1 * (4.05 - known["supply_V"])


def without(value, verdict="adequate", half=1.0):
    """What is quoted of K_b without a trial or visit."""
    effects = ("tilt",) if verdict == "effect" else ()
    ends = {"K_b": (value, value - half, value + half)}
    return Without(verdict=verdict, effects=effects, intervals=ends, widths={"K_b": 2 * half})


def influenced(quoted, **influence):
    """The quotation, its headline coefficient most influenced by another trial or visit."""
    headline = quoted.coefficients["K_b"]
    moved = replace(headline, influence=replace(headline.influence, **influence))
    return replace(quoted, coefficients=quoted.coefficients | {"K_b": moved})


@pytest.fixture(scope="module")
def data():
    # few visits of a station, so that single trials matter
    return campaign(31, visits=3)


@pytest.fixture(scope="module")
def quoted(data):
    return diagnose(data, GROUND, (), Options()).quoted


@pytest.fixture
def headline(quoted):
    return quoted.coefficients["K_b"]


@pytest.fixture(scope="module")
def sagging():
    """An answer that names one effect, as if nothing else had been tried, and its quotation."""
    answer = search.run(problem(campaign(31, visits=3, gain=fading)))
    assert answer.accepted[0].name == "supply_sag"
    (first,) = [e for e in answer.singles if e.name == "supply_sag"]
    answer = replace(answer, accepted=(first,), allowed=(first,), singles=(first,), pairs=())
    value = SimpleNamespace(value=float(first.fitted.vector[0]), u=0.1)
    return answer, SimpleNamespace(headline="K_b", coefficients={"K_b": value})


def test_the_shift_is_that_of_a_new_diagnosis_without_the_trial(data, quoted, headline):
    most = headline.influence.trial
    assert abs(most.shift) > LEAST_SHIFT * headline.u
    again = diagnose(data.take(data.trial != most.id), GROUND, (), Options()).quoted
    shift = again.coefficients["K_b"].value - headline.value
    # noise is looked for from another start, until it moves the coefficient by no more than a tenth
    # of u
    assert most.shift == pytest.approx(shift, abs=0.1 * headline.u)
    assert quoted.rests_on is None
    assert again.verdict == quoted.verdict


@pytest.mark.parametrize(
    ("by", "verdict", "decisive"),
    [
        (0.9, "adequate", False),
        (-0.9, "adequate", False),
        (1.1, "adequate", True),
        (0.0, "effect", True),
    ],
)
def test_a_trial_decides_that_moves_the_answer_by_u_or_changes_the_verdict(
    quoted, headline, by, verdict, decisive
):
    value, asked = headline.value + by * headline.u, []
    answered = with_decisive_trial(quoted, lambda t: asked.append(t) or without(value, verdict))
    (trial,) = asked
    again = answered.coefficients["K_b"]
    assert again.influence.trial.id == trial
    assert again.influence.trial.shift == pytest.approx(by * headline.u)
    assert (answered.rests_on is not None) is decisive
    added = [d for d in again.doubts if d.condition == f"without trial {trial}"]
    expected = [(value, value - 1.0, value + 1.0)] * decisive
    assert [(d.value, d.lo90, d.hi90) for d in added] == expected
    text = dependence(answered)
    assert bool(text) is (trial in text) is decisive
    assert text.startswith("The verdict depends on trial") is (verdict == "effect")


def test_where_no_trial_matters_nothing_is_made_again(quoted, headline):
    trial = replace(headline.influence.trial, shift=0.5 * LEAST_SHIFT * headline.u)
    unknown = replace(quoted, coefficients={"K_b": replace(headline, u=np.inf)})
    for quiet in (influenced(quoted, trial=trial), unknown):
        assert with_decisive_trial(quiet, pytest.fail) is quiet


@pytest.mark.parametrize("beyond", [-0.1, 0.1])
@pytest.mark.parametrize("ordered", [True, False])
def test_the_trials_without_which_the_test_would_turn_are_tried(data, beyond, ordered):
    if not ordered:
        # a table that somebody sorted: whitened trials are by visit, and not as its rows
        rows = np.random.default_rng(1).permutation(data.n)
        data = replace(data.take(rows), ordered=False)
    searched = problem(data, false_alarm_rate=0.99)
    answer = search.run(searched)
    least = answer.first.log10_p.min()

    def at(threshold):
        return replace(answer, first=replace(answer.first, threshold=threshold))

    tried = trials_flipping_a_test(at(least + beyond))
    assert 1 <= len(tried) <= TRIES
    for trial in tried:
        keep = searched.data.trial != trial.id
        rest = replace(searched, data=searched.data.take(keep), log_lift=searched.log_lift[keep])
        # to first order it lies beyond
        assert (rest.nothing_added[0].log10_p.min() - least) / beyond > 0.8
    # where the test is far from its threshold no trial turns it
    assert trials_flipping_a_test(at(least + 100 * beyond)) == ()


def test_the_trials_that_decide_whether_there_is_a_name_are_tried(sagging):
    answer, quoted = sagging
    (first,) = answer.accepted
    searched = answer.problem
    # trials 7 and 9 speak by 3 and 1 of log evidence against this fit
    residual = first.fitted.residual.copy()
    for i, gain in ((7, 3.0), (9, 1.0)):
        residual[i] = np.sqrt(residual[i] ** 2 + 2 * gain)

    def decided(over_none, label="trial", against=False):
        """Trials or visits that decide, where they speak for the name or against it."""
        name = replace(first, unnamed=0.0, exact=over_none, discrepant=over_none)
        base = replace(searched.base_fit, residual=first.fitted.residual if against else residual)
        if against:
            name = replace(name, fitted=replace(first.fitted, residual=residual))
        about = replace(searched)
        about.__dict__["base_fit"] = base
        named = () if against else (name,)
        own = replace(answer, singles=(name,), accepted=named, problem=about)
        return [one.id for one in influential_trials(own, quoted, getattr(searched.data, label))]

    ids, visit = searched.data.trial, searched.data.visit
    assert decided(CREDIT + 1.5) == [ids[7], ids[9]]
    assert decided(CREDIT + 4.0) == [ids[7]]
    assert decided(CREDIT + 7.0) == []
    # a visit speaks with the voice of all its trials
    assert visit[7] != visit[9]
    assert decided(CREDIT + 4.0, "visit") == [str(visit[7])]
    # for want of so much there is no name; where something else refused it, no trial did
    assert decided(CREDIT - 4.0, against=True) == [ids[7]]
    assert decided(CREDIT + 4.0, against=True) == []


def test_no_single_trial_decides_at_which_throttle_coefficients_hold():
    data = campaign(4, visits=4)
    whole = float(np.median(np.unique(data.throttle)))
    for i in range(8):
        rest = derive(data.take(np.arange(data.n) != i), np.ones(data.n - 1))
        assert rest.geometry["throttle_ref"] == whole


def test_a_visit_that_moves_the_answer_by_more_than_u_is_said(quoted, headline):
    def said(shift):
        visit = Shift(id="7", shift=shift * headline.u, z_hat=1.25)
        return dependence(influenced(quoted, visit=visit))

    assert said(0.9) == said(-0.9) == ""
    start = "The answer depends on visit 7 (z_hat = 1.2): without it K_b is "
    assert said(-1.1).startswith(start)


def test_a_verdict_that_turns_without_a_visit_is_said(quoted, headline):
    def again(visit):
        if visit == "3":
            # what is left cannot be diagnosed
            return None
        verdict = quoted.verdict if visit == "0" else "effect"
        return without(headline.value + 0.1 * int(visit) * headline.u, verdict)

    one = np.zeros(1)
    answer = SimpleNamespace(
        problem=SimpleNamespace(slope=one, data=SimpleNamespace(visit=one), base=GROUND),
        best=SimpleNamespace(information=lambda: SimpleNamespace(gain=np.ones((1, 1)))),
    )
    visits = [Shift(id=str(v), shift=0.0, z_hat=1.5 + v) for v in range(4)]
    tried = without_visits(answer, quoted, again, visits)
    assert [v.id for v, _ in tried] == ["0", "1", "2"]
    assert with_decisive_visits(quoted, tried[:1]) == quoted
    turned = with_decisive_visits(quoted, tried)
    decisive = turned.rests_on_visit
    assert (decisive.visit, decisive.effects) == ("2", ("tilt",))
    assert dependence(turned) == (
        "The verdict depends on visit 2 (z_hat = 3.5): without it, it is effect (tilt)."
    )
    new = [d.condition for d in turned.coefficients["K_b"].doubts if d not in headline.doubts]
    assert new == ["without visit 1 (z_hat = 2.5)", "without visit 2 (z_hat = 3.5)"]
    # the verdict without the visit is said after a trial that moves the headline, too
    trial = RestsOn(trial="t9", shift=1.5 * headline.u, verdict=quoted.verdict)
    both = dependence(replace(turned, rests_on=trial))
    assert both.startswith("The answer depends on trial ")
    assert both.endswith(" Without visit 2 (z_hat = 3.5) the verdict is effect (tilt).")


@pytest.mark.parametrize(
    ("moved", "wider", "contradicts"), [(3.0, 2.0, False), (3.0, 1.5, True), (0.9, 1.0, False)]
)
def test_a_shift_is_judged_by_the_information_of_its_visit(
    data, quoted, headline, moved, wider, contradicts
):
    half = wider * (headline.hi90 - headline.lo90) / 2
    again = without(headline.value + moved * headline.u, quoted.verdict, half)
    answer = search.run(problem(data))
    visit = Shift.at(float(data.z_hat[0]), str(data.visit[0]), 0.0)
    tried = without_visits(answer, quoted, lambda _: again, [visit])
    [(shift, _)] = tried
    spread = max(np.sqrt(wider**2 - 1), stability.LEAST_SPREAD)
    assert shift.standardised == pytest.approx(moved / spread, rel=1e-6)
    assert bool(contradicting(quoted, tried)) is contradicts
    # a distance that was 0.1 mm more than recorded, by a new fit
    step = np.where(data.visit == data.visit[0], 1e-4 / data.radius_m, 0.0)
    there = search.run(problem(replace(data, z_hat=data.z_hat + step))).problem
    change = there.base_fit.vector[0] - answer.problem.base_fit.vector[0]
    assert 0.1 * shift.shift_per_mm == pytest.approx(change, abs=0.03 * headline.u)


def test_a_visit_of_a_small_table_that_contradicts_the_rest_ends_adequate():
    whole = table("ground", distances=5, throttles=4, seed=101)
    second = whole.z_hat == np.unique(whole.z_hat)[1]
    moved = replace(whole, lift_N=np.where(second, 1.02 * whole.lift_N, whole.lift_N))
    for data, verdict in ((whole, "adequate"), (moved, "unexplained")):
        assert diagnose(data, BASES["ground"], (), Options()).findings.verdict == verdict


def test_all_visits_of_a_small_table_are_tried_else_those_that_move_the_answer(
    data, quoted, headline
):
    def tried(n, quoted, to_try=visits_to_try):
        some = data.take(np.arange(data.n) < n)
        searched = SimpleNamespace(data=some, as_recorded=some, base=GROUND)
        answer = SimpleNamespace(problem=searched, accepted=(), tried=())
        return [v.id for v in to_try(answer, quoted)]

    assert tried(20, quoted) == [str(v) for v in np.unique(data.visit[:20])]
    assert tried(20, quoted, trials_to_try) == list(data.trial[:20])
    assert tried(data.n, quoted) == []
    visit = Shift(id="7", shift=1.1 * headline.u, z_hat=1.25)
    assert tried(data.n, influenced(quoted, visit=visit)) == ["7"]


def test_a_shortlist_changes_no_answer_without_a_trial(monkeypatch):
    ground = problem(campaign(31, visits=3, gain=fading))
    rate = ground.options.false_alarm_rate
    like = loop.decide(ground, True, rate)
    counts, run = [], search.run

    def counted(searched, shortlist=None):
        answer = run(searched, shortlist)
        counts.append(len(answer.singles) + len(answer.pairs))
        return answer

    monkeypatch.setattr(search, "run", counted)
    for trial in ground.data.trial[[3, 40]]:
        kept = ground.data.trial != trial
        counts.clear()
        short, fewer = loop._without(ground, kept, rate, like), sum(counts)
        with monkeypatch.context() as patch:
            patch.setattr(search.Answer, "shortlist", lambda *_: None)
            counts.clear()
            whole = loop._without(ground, kept, rate, like)
        assert 0 < fewer < sum(counts)
        assert (short.verdict, short.effects) == (whole.verdict, whole.effects)
        for name, interval in short.intervals.items():
            assert interval == pytest.approx(whole.intervals[name], rel=1e-9)


def test_where_a_shortlist_would_name_another_everything_is_tried(sagging, monkeypatch):
    answer, _ = sagging
    given, nothing = [], replace(answer, accepted=())
    shortlist = answer.shortlist(np.zeros(answer.problem.data.n, dtype=bool))

    def converged(_, shortlist):
        given.append(shortlist)
        return nothing if shortlist and len(given) > 1 else answer

    monkeypatch.setattr(loop, "search_to_convergence", converged)
    for expected in ([shortlist], [shortlist, shortlist, None]):
        assert loop.decide(answer.problem, False, 0.05, answer, shortlist).accepted
        assert given == expected


@pytest.mark.parametrize("gone", ["supply", pytest.param("session", marks=pytest.mark.nightly)])
def test_without_what_spoke_for_it_nothing_is_left_of_an_effect(gone):
    """An effect of one visit alone; without that visit all is as if it had never been measured."""
    data = campaign(7, visits=2)
    odd = data.visit == data.visit.max()
    if gone == "supply":
        supply = {"supply_V": data.covariates["supply_V"] - 0.8 * odd}
        lift = np.where(odd, 0.85 * data.lift_N, data.lift_N)
        data = replace(data, lift_N=lift, covariates=data.covariates | supply)
    else:
        sessions = np.where(odd, 2, np.where(data.visit > np.median(data.visit), 1, 0))
        gain = np.array([1.0, 1.1, 0.9])[sessions]
        data = replace(data, session=sessions, lift_N=gain * data.lift_N)
    ground = problem(data)
    rate = ground.options.false_alarm_rate
    like = loop.decide(ground, False, rate)
    about = like.problem.about
    assert about is not None
    assert ("session_gain" in about[0].name) == (gone == "session")
    rest = loop._without(ground, ground.data.visit != ground.data.visit.max(), rate, like)
    afresh = diagnose(data.take(~odd), GROUND, (), Options()).quoted
    assert rest.verdict == afresh.verdict
    value, low, high = rest.intervals["K_b"]
    expected = afresh.coefficients["K_b"]
    width = expected.hi90 - expected.lo90
    # the shortlist may miss a rival of few per cent
    assert value == pytest.approx(expected.value, abs=0.05 * width)
    if gone == "supply":
        assert rest.verdict == "adequate"
        assert high - low == pytest.approx(width, rel=0.02)
