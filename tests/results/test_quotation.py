"""results.json obeys its contract for every verdict, follows the rule of quotation, and comes back
as it was saved.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.stats import norm
from tests.unit import verdicts
from tests.unit.simulated import campaign

from nearlift import catalogue
from nearlift.fit.estimator import Estimator, ends
from nearlift.fit.least_squares import fit
from nearlift.likelihood import student
from nearlift.report.phrases import coefficient_text
from nearlift.results.document import typed
from nearlift.results.quotation import Results
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import FIT, RESULTS

ENDS = ("lo95", "lo90", "lo68", "value", "hi68", "hi90", "hi95")
KEYS = {*ENDS, "u", "dof", "unit", "holds", "budget", "influence", "doubts"}
BOUNDARY = {"verdict", "reason", "base_model", "effects", "rivals", "coefficients", "error"}


@pytest.fixture(scope="module", params=verdicts.MADE)
def job(request, make_job):
    before, made = (
        make_job(("ground",), diagnosed=diagnosed, **verdicts.MADE[request.param])
        for diagnosed in (False, True)
    )
    return request.param, made, before.read_json(RESULTS)


@pytest.fixture
def quoted(job):
    verdict, made, _ = job
    own = made.load(Results).boundaries["ground"]
    assert own.verdict == verdict
    return own


def test_the_file_has_the_keys_of_the_contract(job):
    verdict, made, _ = job
    content = made.read_json(RESULTS)
    assert content["schema"] == "nearlift.results/1"
    for own in content["boundaries"].values():
        assert own.keys() >= BOUNDARY
        assert bool(own["effects"]) == (verdict == "effect")
        assert bool(own["reason"]) == (verdict == "not_diagnosed")
        if verdict != "not_diagnosed":
            assert own["error"].keys() == {"unit", "before", "after", "noise_floor"}
        for c in own["coefficients"].values():
            assert c.keys() >= KEYS
            assert [c[end] for end in ENDS] == sorted(c[end] for end in ENDS)
            assert all(line.keys() >= {"source", "type", "u", "u_without"} for line in c["budget"])
            assert c["influence"].keys() == {"trial", "visit"}
            assert c["influence"]["visit"].keys() == {"id", "shift", "z_hat"}
            keys = {"if", "value", "lo90", "hi90"}
            assert all(d.keys() - {"explanation"} == keys for d in c["doubts"])
    assert set(content["boundaries"]) == set(made.read_json(DIAGNOSIS)["boundaries"])


def test_plus_minus_is_printed_only_where_it_says_the_interval(quoted):
    c = dataclasses.replace(quoted.coefficients["K_b"], value=0.093, u=0.005)
    even, lopsided = (
        dataclasses.replace(c, lo90=low, hi90=high)
        for low, high in ((0.0848, 0.1012), (0.092, 0.110))
    )
    assert coefficient_text(even, "K_b") == "K_b = 0.093 ± 0.005 (90 %: 0.085 to 0.101)"
    assert coefficient_text(lopsided, "alpha") == "α = 0.093 (90 %: 0.092 to 0.110)"
    two = dataclasses.replace(even, answers=2, unit="m", at_bound=True)
    assert coefficient_text(two) == "0.093 m (90 %: 0.085 to 0.101), at a bound"


def test_the_interval_is_that_of_the_rule(job, quoted):
    verdict, made, _ = job
    c = quoted.coefficients["K_b"]
    own = (c.value, c.lo90, c.hi90)
    if verdict == "not_diagnosed":
        e = made.read_json(FIT)["boundaries"]["ground"]["sanchez_cuevas"]["parameters"]["K_b"]
        assert own == pytest.approx((e["value"], e["lo90"], e["hi90"]), rel=1e-9)
        assert c.u == pytest.approx(e["u"], rel=1e-9)
        return
    loop = made.read_json(DIAGNOSIS)["boundaries"]["ground"]["coefficients"]
    assert own == pytest.approx(
        [loop["after"]["K_b"][k] for k in ("value", "lo90", "hi90")], rel=1e-9
    )
    if verdict == "adequate":
        assert own == pytest.approx(
            [loop["before"]["K_b"][k] for k in ("value", "lo90", "hi90")], rel=1e-9
        )
    assert (verdict == "unexplained") == bool(loop["carried"])


def test_fit_alone_quotes_the_base_fit_and_says_that_nobody_looked(job):
    _, made, before = job
    own = typed(Results, before).boundaries["ground"]
    assert own.verdict == "not_diagnosed"
    assert "nearlift diagnose" in own.reason
    assert (
        own.coefficients["K_b"].value
        == made.read_json(FIT)["boundaries"]["ground"]["sanchez_cuevas"]["parameters"]["K_b"][
            "value"
        ]
    )


def test_the_lines_of_the_budget_make_up_u_and_no_knowledge_widens_it(quoted):
    c = quoted.coefficients["K_b"]
    assert math.hypot(*(line.u for line in c.budget)) == pytest.approx(c.u, rel=1e-6)
    assert all(0 <= line.u_without <= c.u * (1 + 1e-6) for line in c.budget)
    assert [line.u for line in c.budget] == sorted((line.u for line in c.budget), reverse=True)


def test_u_and_the_interval_are_one_statement(quoted):
    c = quoted.coefficients["K_b"]
    assert c.hi90 - c.lo90 == pytest.approx(2 * student.quantile(0.95, c.dof) * c.u, rel=1e-9)


def test_doubts_say_what_each_verdict_leaves_open(job, quoted):
    verdict, made, _ = job
    doubts = {d.condition: d for d in quoted.coefficients["K_b"].doubts}
    assert "free exponent of the lift ratio" in doubts
    assert ("base model without any effect" in doubts) == (verdict in ("effect", "unexplained"))
    unseen = doubts.get("every undetected effect at its plausible size")
    assert (unseen is not None) == (verdict != "not_diagnosed")
    if verdict != "not_diagnosed":
        loop = made.read_json(DIAGNOSIS)["boundaries"]["ground"]["coefficients"]
        assert [unseen.lo90, unseen.hi90] == pytest.approx(loop["after"]["K_b"]["constrained"])
        if (nothing := doubts.get("base model without any effect")) is not None:
            assert nothing.value == loop["before"]["K_b"]["value"]
    if verdict == "effect":
        assert "supply_sag alone, exactly in its stated form" in doubts
    assert all(d.lo90 <= d.value <= d.hi90 for d in doubts.values())


def test_how_estimates_go_together_is_on_record_for_all_who_draw_from_them(job, quoted):
    verdict, _, _ = job
    found = np.array(quoted.correlation.values)
    more = {"not_diagnosed": (), "effect": ("offset_m", "sag_exponent")}
    assert quoted.correlation.parameters == ("K_b", *more.get(verdict, ("offset_m",)))
    assert (np.diag(found) == 1.0).all()
    assert (found == found.T).all()
    assert verdict != "effect" or 1e-4 < abs(found[0, -1]) < 1.0


def test_influence_is_what_the_fit_does_without_the_visit():
    """The closed form, scatter held fixed, against a refit at the same scatter."""
    data, model = campaign(7, visits=5), catalogue.model("sanchez_cuevas")
    found = fit(model, data)
    quoted = Estimator.from_fit(found).quoted(
        0, [((1.0, float(found.theta[0]), float(found.estimates["K_b"].u)),)], "", []
    )
    shift = quoted.influence.visit
    again = fit(model, data.take(data.visit != int(shift.id)), (), found.noise)
    assert again.theta[0] - found.theta[0] == pytest.approx(
        shift.shift, rel=0.05, abs=0.02 * quoted.u
    )
    assert abs(shift.shift) > 0.1 * quoted.u


def test_an_interval_ends_where_its_coefficient_does():
    found = ends([((1.0, 0.005, 0.084),)], 50.0, (0.0, 4.0))
    assert found["lo68"] == found["lo90"] == found["lo95"] == 0.0
    assert found["hi90"] == pytest.approx(0.005 + student.quantile(0.95, 50.0) * 0.084)
    endless = ends([((1.0, 2.0, 0.1),)], 0.0, (-10.0, 20.0))
    assert (endless["lo90"], endless["hi90"]) == (-10.0, 20.0)
    held = ends([((1.0, 2.0, 0.0),)], 0.0, (-10.0, 20.0))
    assert (held["lo90"], held["hi90"]) == (2.0, 2.0)


def test_several_answers_are_one_interval():
    """Each tail of the mixture holds half of what a single answer's would."""
    members = ((0.75, 1.0, 0.1), (0.25, 1.5, 0.2))
    cut = ends([members], math.inf, (-10.0, 20.0))
    for end, of_all in (("lo90", 0.05), ("hi90", 0.95), ("lo68", 0.16), ("hi95", 0.975)):
        below = sum(p * norm.cdf((cut[end] - v) / u) for p, v, u in members)
        tail = below if of_all < 0.5 else 1 - below
        assert 2 * tail == pytest.approx(min(of_all, 1 - of_all), abs=1e-6)
    twice = ends([((0.5, 1.0, 0.1), (0.5, 1.0, 0.1))], 9.0, (-10.0, 20.0))
    assert twice["hi90"] == pytest.approx(1 + student.quantile(0.975, 9.0) * 0.1)
    assert ends([((0.9, 1.0, 0.1), (0.1, 2.0, math.inf))], 9.0, (0.0, 20.0))["hi90"] == 20.0
    both = ends([((1.0, 1.0, 0.1),), ((1.0, 2.0, 0.2),)], math.inf, (-10.0, 20.0))
    assert (both["lo90"], both["hi90"]) == pytest.approx((0.8355, 2.3290), abs=1e-4)
