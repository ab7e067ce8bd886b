"""Answers that depend on one trial or visit: what is reported is what a new diagnosis without it
gives.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from tests.loop.test_small_tables import BASES, table
from tests.unit.simulated import campaign

from nearlift import catalogue
from nearlift.likelihood.covariates import derive
from nearlift.loop import diagnose as loop
from nearlift.loop import search, stability
from nearlift.loop.diagnose import diagnose, set_up
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

GROUND = catalogue.model("sanchez_cuevas")


@pytest.fixture(scope="module")
def data():
    # few visits of a station, so that single trials matter
    return campaign(31, visits=3)


@pytest.fixture(scope="module")
def quoted(data):
    return diagnose(data, GROUND, (), Options()).quoted


@pytest.fixture(scope="module")
def sagging():
    """An answer that names one effect, as if nothing else had been tried, and its quotation."""
    data = campaign(31, visits=3, gain=lambda known: 1 - 0.1 * (4.05 - known["supply_V"]))
    answer = search.run(set_up(data, GROUND, (), Options())[0])
    assert answer.accepted[0].name == "supply_sag"
    (first,) = [e for e in answer.singles if e.name == "supply_sag"]
    answer = replace(answer, accepted=(first,), allowed=(first,), singles=(first,), pairs=())
    value = float(first.fitted.vector[0])
    quoted = SimpleNamespace(
        headline="K_b", coefficients={"K_b": SimpleNamespace(value=value, u=0.1)}
    )
    return answer, quoted


def test_the_shift_is_that_of_a_new_diagnosis_without_the_trial(data, quoted):
    headline = quoted.coefficients["K_b"]
    most = headline.influence.trial
    assert abs(most.shift) > LEAST_SHIFT * headline.u
    again = diagnose(data.take(data.trial != most.id), GROUND, (), Options()).quoted
    # noise is looked for from another start, until it moves the coefficient by no more than a tenth
    # of u
    assert most.shift == pytest.approx(
        again.coefficients["K_b"].value - headline.value, abs=0.1 * headline.u
    )
    assert quoted.rests_on is None
    assert again.verdict == quoted.verdict


@pytest.mark.parametrize(
    ("by", "verdict", "rests"),
    [
        (0.9, "adequate", False),
        (-0.9, "adequate", False),
        (1.1, "adequate", True),
        (0.0, "effect", True),
    ],
)
def test_an_answer_rests_on_a_trial_that_moves_it_by_u_or_changes_the_verdict(
    quoted, by, verdict, rests
):
    headline = quoted.coefficients["K_b"]
    value = headline.value + by * headline.u
    asked = []

    def without(trial):
        asked.append(trial)
        effects = ("tilt",) if verdict == "effect" else ()
        return Without(
            verdict=verdict,
            effects=effects,
            intervals={"K_b": (value, value - 1.0, value + 1.0)},
            widths={"K_b": 2.0},
        )

    found = with_decisive_trial(quoted, without)
    (trial,) = asked
    assert found.coefficients["K_b"].influence.trial.id == trial
    assert found.coefficients["K_b"].influence.trial.shift == pytest.approx(by * headline.u)
    assert (found.rests_on is not None) is rests
    assert bool(dependence(found)) is rests
    added = [d for d in found.coefficients["K_b"].doubts if d.condition == f"without trial {trial}"]
    assert [(d.value, d.lo90, d.hi90) for d in added] == (
        [(value, value - 1.0, value + 1.0)] if rests else []
    )
    if rests:
        assert trial in dependence(found)
        near = "The verdict depends on trial"
        assert dependence(found).startswith(near) is (verdict == "effect")


def test_where_no_trial_matters_nothing_is_made_again(quoted):
    headline = quoted.coefficients["K_b"]
    trial = replace(headline.influence.trial, shift=0.5 * LEAST_SHIFT * headline.u)
    small = replace(headline.influence, trial=trial)
    quiet = replace(quoted, coefficients={"K_b": replace(headline, influence=small)})
    assert with_decisive_trial(quiet, pytest.fail) is quiet
    unknown = replace(quoted, coefficients={"K_b": replace(headline, u=np.inf)})
    assert with_decisive_trial(unknown, pytest.fail) is unknown


@pytest.mark.parametrize("beyond", [-0.1, 0.1])
@pytest.mark.parametrize("ordered", [True, False])
def test_the_trials_without_which_the_test_would_turn_are_tried(data, beyond, ordered):
    if not ordered:
        # a table that somebody sorted: whitened trials stand by visit, and not as its rows
        rows = np.random.default_rng(1).permutation(data.n)
        data = replace(data.take(rows), ordered=False)
    stage = set_up(data, GROUND, (), Options(false_alarm_rate=0.99))[0]
    answer = search.run(stage)
    least = answer.first.log10_p.min()

    def at(threshold):
        return replace(answer, first=replace(answer.first, threshold=threshold))

    tried = trials_flipping_a_test(at(least + beyond))
    assert 1 <= len(tried) <= TRIES
    for trial in tried:
        keep = stage.data.trial != trial.id
        rest = replace(stage, data=stage.data.take(keep), log_lift=stage.log_lift[keep])
        again = rest.nothing_added[0].log10_p.min()
        # to first order it lies beyond
        assert (again - least) / beyond > 0.8
    # where the test is far from its threshold no trial turns it
    assert trials_flipping_a_test(at(least + 100 * beyond)) == ()


def decided(answer, quoted, label="trial"):
    """Trials or visits that decide."""
    return [
        one.id for one in influential_trials(answer, quoted, getattr(answer.problem.data, label))
    ]


def spoken_for(fitted, gains, moved=0.0):
    """The fit as if trials spoke against it by so much log evidence, with another headline."""
    residual, vector = fitted.residual.copy(), fitted.vector.copy()
    for i, gain in gains.items():
        residual[i] = np.sqrt(residual[i] ** 2 + 2 * gain)
    vector[0] += moved
    return replace(fitted, residual=residual, vector=vector)


def test_the_trials_that_decide_whether_there_is_a_name_are_tried(sagging):
    answer, quoted = sagging
    (first,) = answer.accepted
    stage = replace(answer.problem)

    def of(over_none, against=False):
        name = replace(first, unnamed=0.0, exact=over_none, discrepant=over_none)
        # trials that speak for the name, or against it
        other = spoken_for(first.fitted, {7: 3.0, 9: 1.0})
        base = replace(stage.base_fit, residual=other.residual)
        if against:
            name = replace(name, fitted=other)
            base = replace(stage.base_fit, residual=first.fitted.residual)
        about = replace(stage)
        about.__dict__["base_fit"] = base
        named = () if against else (name,)
        return replace(answer, singles=(name,), accepted=named, problem=about)

    ids, visit = stage.data.trial, stage.data.visit
    assert decided(of(CREDIT + 1.5), quoted) == [ids[7], ids[9]]
    assert decided(of(CREDIT + 4.0), quoted) == [ids[7]]
    assert decided(of(CREDIT + 7.0), quoted) == []
    # a visit speaks with the voice of all its trials
    assert visit[7] != visit[9]
    assert decided(of(CREDIT + 4.0), quoted, "visit") == [str(visit[7])]
    # for want of so much there is no name; where something else refused it, no trial did
    assert decided(of(CREDIT - 4.0, against=True), quoted) == [ids[7]]
    assert decided(of(CREDIT + 4.0, against=True), quoted) == []


def test_no_single_trial_decides_at_which_throttle_coefficients_hold():
    data = campaign(4, visits=4)
    whole = float(np.median(np.unique(data.throttle)))
    for i in range(8):
        rest = derive(data.take(np.arange(data.n) != i), np.ones(data.n - 1))
        assert rest.geometry["throttle_ref"] == whole


def test_a_visit_that_moves_the_answer_by_more_than_u_is_told_before_a_trial(quoted):
    headline = quoted.coefficients["K_b"]

    def leaning(shift):
        visit = Shift(id="7", shift=shift * headline.u, z_hat=1.25)
        influence = replace(headline.influence, visit=visit)
        moved = {**quoted.coefficients, "K_b": replace(headline, influence=influence)}
        return dependence(replace(quoted, coefficients=moved))

    assert leaning(0.9) == leaning(-0.9) == ""
    assert leaning(-1.1).startswith(
        "The answer depends on visit 7 (z_hat = 1.2): without it K_b is "
    )


def test_a_verdict_that_turns_without_a_visit_is_told(quoted):
    headline = quoted.coefficients["K_b"]
    visits = [Shift(id=str(v), shift=0.0, z_hat=1.5 + v) for v in range(4)]

    def without(visit):
        if visit == "3":
            # what is left cannot be diagnosed
            return None
        value = headline.value + 0.1 * int(visit) * headline.u
        intervals = {"K_b": (value, value - 1.0, value + 1.0)}
        verdict = quoted.verdict if visit == "0" else "effect"
        return Without(verdict=verdict, effects=("tilt",), intervals=intervals, widths={"K_b": 2.0})

    answer = SimpleNamespace(
        problem=SimpleNamespace(
            slope=np.zeros(1),
            data=SimpleNamespace(visit=np.zeros(1)),
            base=GROUND,
        ),
        best=SimpleNamespace(information=lambda: SimpleNamespace(gain=np.ones((1, 1)))),
    )
    tried = without_visits(answer, quoted, without, visits)
    assert [v.id for v, _ in tried] == ["0", "1", "2"]
    assert with_decisive_visits(quoted, tried[:1]) == quoted
    found = with_decisive_visits(quoted, tried)
    assert found.rests_on_visit.visit == "2"
    assert found.rests_on_visit.effects == ("tilt",)
    assert dependence(found) == (
        "The verdict depends on visit 2 (z_hat = 3.5): without it, it is effect (tilt)."
    )
    new = [d.condition for d in found.coefficients["K_b"].doubts if d not in headline.doubts]
    assert new == [
        "without visit 1 (z_hat = 2.5)",
        "without visit 2 (z_hat = 3.5)",
    ]
    # beside a trial that moves the headline the verdict without the visit is told, too
    trial = RestsOn(trial="t9", shift=1.5 * headline.u, verdict=quoted.verdict)
    both = dependence(replace(found, rests_on=trial))
    assert both.startswith("The answer depends on trial ")
    assert both.endswith(" Without visit 2 (z_hat = 3.5) the verdict is effect (tilt).")


@pytest.mark.parametrize(
    ("moved", "wider", "contradicts"), [(3.0, 2.0, False), (3.0, 1.5, True), (0.9, 1.0, False)]
)
def test_a_shift_is_judged_by_the_information_of_its_visit(data, quoted, moved, wider, contradicts):
    headline = quoted.coefficients["K_b"]
    value, half = headline.value + moved * headline.u, wider * (headline.hi90 - headline.lo90) / 2
    again = Without(
        verdict=quoted.verdict,
        effects=(),
        intervals={"K_b": (value, value - half, value + half)},
        widths={"K_b": 2 * half},
    )
    answer = search.run(set_up(data, GROUND, (), Options())[0])
    visit = Shift.at(float(data.z_hat[0]), str(data.visit[0]), 0.0)
    tried = without_visits(answer, quoted, lambda _: again, [visit])
    [(shift, _)] = tried
    spread = max(np.sqrt(wider**2 - 1), stability.LEAST_SPREAD)
    assert shift.standardised == pytest.approx(moved / spread, rel=1e-6)
    assert bool(contradicting(quoted, tried)) is contradicts
    # a distance that was 0.1 mm more than recorded, by a new fit
    step = np.where(data.visit == data.visit[0], 1e-4 / data.radius_m, 0.0)
    there = search.run(set_up(replace(data, z_hat=data.z_hat + step), GROUND, (), Options())[0])
    change = there.problem.base_fit.vector[0] - answer.problem.base_fit.vector[0]
    assert 0.1 * shift.shift_per_mm == pytest.approx(change, abs=0.03 * headline.u)


def test_a_visit_of_a_small_table_that_contradicts_the_rest_ends_adequate():
    whole = table("ground", distances=5, throttles=4, seed=101)
    second = whole.z_hat == np.unique(whole.z_hat)[1]
    lift = np.where(second, 1.02 * whole.lift_N, whole.lift_N)
    for data, verdict in ((whole, "adequate"), (replace(whole, lift_N=lift), "unexplained")):
        assert diagnose(data, BASES["ground"], (), Options()).findings.verdict == verdict


def test_the_visits_that_are_tried_are_all_of_a_small_table_else_those_that_move_the_answer(
    data, quoted
):
    def tried(n, quoted, accepted=(), to_try=visits_to_try):
        some = data.take(np.arange(data.n) < n)
        stage = SimpleNamespace(data=some, as_recorded=some, base=GROUND)
        answer = SimpleNamespace(problem=stage, accepted=accepted, tried=())
        return [v.id for v in to_try(answer, quoted)]

    assert tried(20, quoted) == [str(v) for v in np.unique(data.visit[:20])]
    assert tried(20, quoted, to_try=trials_to_try) == list(data.trial[:20])
    assert tried(data.n, quoted) == []
    headline = quoted.coefficients["K_b"]
    visit = Shift(id="7", shift=1.1 * headline.u, z_hat=1.25)
    moved = replace(headline, influence=replace(headline.influence, visit=visit))
    assert tried(data.n, replace(quoted, coefficients={"K_b": moved})) == ["7"]


def test_a_shortlist_changes_no_answer_without_a_trial(monkeypatch):
    data = campaign(31, visits=3, gain=lambda known: 1 - 0.1 * (4.05 - known["supply_V"]))
    ground, _, _ = set_up(data, GROUND, (), Options())
    rate = ground.options.false_alarm_rate
    like = loop.decide(ground, True, rate)
    tried = []
    run = search.run

    def counted(stage, shortlist=None):
        answer = run(stage, shortlist)
        tried.append(len(answer.singles) + len(answer.pairs))
        return answer

    monkeypatch.setattr(search, "run", counted)
    for trial in ground.data.trial[[3, 40]]:
        kept = ground.data.trial != trial
        short = loop._without(ground, kept, rate, like)
        fewer, tried[:] = sum(tried), []
        monkeypatch.setattr(search.Answer, "shortlist", lambda *_: None)
        whole = loop._without(ground, kept, rate, like)
        monkeypatch.undo()
        monkeypatch.setattr(search, "run", counted)
        assert 0 < fewer < sum(tried)
        tried.clear()
        assert (short.verdict, short.effects) == (whole.verdict, whole.effects)
        for name, interval in short.intervals.items():
            assert interval == pytest.approx(whole.intervals[name], rel=1e-9)


def test_where_a_shortlist_would_name_another_everything_is_tried(sagging, monkeypatch):
    answer, _ = sagging
    stage, given = answer.problem, []
    nothing = replace(answer, accepted=())
    shortlist = answer.shortlist(np.zeros(stage.data.n, dtype=bool))

    def search(_, shortlist):
        given.append(shortlist)
        return nothing if shortlist and len(given) > 1 else answer

    monkeypatch.setattr(loop, "search_to_convergence", search)
    assert loop.decide(stage, False, 0.05, answer, shortlist).accepted
    assert given == [shortlist]
    assert loop.decide(stage, False, 0.05, answer, shortlist).accepted
    assert given == [shortlist, shortlist, None]


@pytest.mark.parametrize("gone", ["supply", pytest.param("session", marks=pytest.mark.nightly)])
def test_without_what_spoke_for_it_nothing_is_left_of_an_effect(gone):
    """An effect of one visit alone; without that visit all is as if it had never been measured."""
    data = campaign(7, visits=2)
    odd = data.visit == data.visit.max()
    if gone == "supply":
        known = data.covariates
        data = replace(
            data,
            lift_N=np.where(odd, 0.85 * data.lift_N, data.lift_N),
            covariates=known | {"supply_V": known["supply_V"] - 0.8 * odd},
        )
    else:
        sessions = np.where(odd, 2, np.where(data.visit > np.median(data.visit), 1, 0))
        gain = np.array([1.0, 1.1, 0.9])[sessions]
        data = replace(data, session=sessions, lift_N=gain * data.lift_N)
    ground, _, _ = set_up(data, GROUND, (), Options())
    rate = ground.options.false_alarm_rate
    like = loop.decide(ground, False, rate)
    about = like.problem.about
    assert about is not None
    assert ("session_gain" in about[0].name) == (gone == "session")
    keep = ground.data.visit != ground.data.visit.max()
    without = loop._without(ground, keep, rate, like)
    afresh = diagnose(data.take(data.visit != data.visit.max()), GROUND, (), Options()).quoted
    assert without.verdict == afresh.verdict
    value, low, high = without.intervals["K_b"]
    expected = afresh.coefficients["K_b"]
    width = expected.hi90 - expected.lo90
    # the shortlist may miss a rival of few per cent
    assert value == pytest.approx(expected.value, abs=0.05 * width)
    if gone == "supply":
        assert without.verdict == "adequate"
        assert high - low == pytest.approx(width, rel=0.02)
