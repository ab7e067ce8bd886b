"""Probabilities of explanations, against dense arithmetic and on campaigns of known truth."""

from functools import cache

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from tests.unit.simulated import campaign, problem

from nearlift.loop import weigh
from nearlift.loop.search import Answer, search_to_convergence


def sagging(covariates):
    return (covariates["supply_V"] / covariates["supply_V"].mean()) ** 0.3


def first_of_a_visit_low(covariates):
    return np.where(np.arange(len(covariates["start_s"])) % 4 == 0, 0.99, 1.0)


@cache
def answer(gain=None) -> Answer:
    data = campaign(1, gain=gain)
    return search_to_convergence(problem(data))


def likeliest(found):
    return found.probabilities[0]


def test_evidence_of_a_family_is_the_mean_over_its_sizes():
    rng = np.random.default_rng(0)
    n, rank = 40, 3
    basis = np.linalg.qr(rng.normal(size=(n, rank)))[0]
    residual = rng.normal(size=n) + basis @ [3.0, -2.0, 1.0]
    each = [
        multivariate_normal(cov=np.eye(n) + size**2 * n / rank * basis @ basis.T).pdf(residual)
        for size in weigh.RELATIVE_SIZES
    ]
    expected = np.log(np.mean(each)) - multivariate_normal(cov=np.eye(n)).logpdf(residual)
    chi2 = np.array([np.sum((basis.T @ residual) ** 2)])
    assert weigh.family_log_evidence(chi2, np.array([rank]), n) == pytest.approx(expected)


@pytest.mark.parametrize("gain", [None, sagging, first_of_a_visit_low])
def test_probabilities_sum_to_one_and_fall(gain):
    listed = answer(gain).probabilities
    assert sum(e.probability for e in listed) == pytest.approx(1.0)
    alone = [e.probability for e in listed if not e.other]
    assert alone == sorted(alone, reverse=True)
    assert min(alone) >= weigh.LEAST_LISTED


def test_the_likeliest_is_the_truth():
    assert not likeliest(answer()).effects
    assert not likeliest(answer()).nameless
    assert likeliest(answer(sagging)).effects == ("supply_sag",)
    assert likeliest(answer(first_of_a_visit_low)).nameless


def test_probability_of_an_answer_is_that_of_its_verdict():
    for gain, verdict in (
        (None, "adequate"),
        (sagging, "effect"),
        (first_of_a_visit_low, "unexplained"),
    ):
        found = answer(gain)
        assert found.verdict == verdict
        assert found.probability >= found.probabilities[0].probability > 0.3


def test_first_order_evidence_of_an_effect_is_its_gain_by_least_squares():
    problem = answer().problem
    columns = next(c for e, c in problem.library if e.name == "supply_sag")
    base = problem.base_jacobian
    both = np.hstack([base, problem.space.project(columns.T).T])
    residual = problem.base_fit.residual
    left = residual - both @ np.linalg.lstsq(both, residual, rcond=None)[0]
    gain = problem.base_fit.chi2 - np.sum(left**2)
    expected = 0.5 * (gain - np.log(problem.data.n))
    assert weigh.first_order(problem)["supply_sag"] == pytest.approx(expected, abs=1e-3)


def test_the_set_is_the_smallest_that_holds_its_probability():
    log = np.log([[0.04, 0.5], [0.5, 0.05], [0.46, 0.45]])
    assert weigh.in_credible_set(log).T.tolist() == [[False, True, True], [True, False, True]]
    excluded = np.full((2, 1), -np.inf)
    assert not weigh.in_credible_set(excluded).any()


@pytest.mark.parametrize("weights", [(0.5, 0.45, 0.05), (0.9, 0.02, 0.01, 0.04), (0.7, 0.3)])
def test_membership_turns_where_the_margin_says(weights):
    for i in range(len(weights)):
        log = np.log(weights)
        margin = weigh.membership_margin(log, i)
        assert (margin > 0) == weigh.in_credible_set(log)[i]
        for past, member in ((1e-6, False), (-1e-6, True)):
            turned = log.copy()
            turned[i] -= margin / weigh.TEMPERATURE + past
            assert weigh.in_credible_set(turned)[i] == member


def test_where_nothing_is_detected_each_effect_is_weighed_against_nothing(monkeypatch):
    monkeypatch.setattr(weigh, "LEAST_LISTED", 0.0)
    problem = answer().problem
    listed = weigh.weigh(problem, problem.nothing_added[0], (), (), silent=True)
    chance = {e.effects: e.probability for e in listed if not e.nameless}
    effects = weigh.first_order(problem)
    assert len(chance) == 1 + len(effects)
    for name, value in effects.items():
        log_odds = value / weigh.TEMPERATURE + weigh.log_odds(problem, 1) - weigh.LOG_SILENT_ODDS
        assert np.log(chance[name,] / chance[()]) == pytest.approx(log_odds)
