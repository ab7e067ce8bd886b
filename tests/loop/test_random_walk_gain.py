"""A gain that wanders at random is no drift with a cause, and curves that move in time no effect
that stays.
"""

import dataclasses

import numpy as np
import pytest
from tests.unit.simulated import RADIUS, campaign, problem, sanchez_cuevas

from nearlift.loop import search
from nearlift.loop.random_walk_gain import SIZES, bic_penalty, likeliest, log_evidence_gain, waves

SEEDS = range(3)


def walk(seed, rms):
    """A random walk of the gain, of this root mean square about its mean."""

    def gain(covariates):
        steps = np.random.default_rng(100 + seed).normal(size=len(covariates["start_s"]))
        path = np.cumsum(steps) - np.cumsum(steps).mean()
        return 1 + rms * path / path.std()

    return gain


def drift(rms):
    """A straight drift of the gain, of this root mean square about its mean."""
    return lambda c: 1 + rms * (2 * c["start_s"] / c["start_s"].max() - 1) * np.sqrt(3)


def answer(data):
    return search.search_to_convergence(problem(data))


@pytest.mark.nightly
def test_a_walk_of_the_gain_gets_no_name_and_a_drift_does():
    walks = [answer(campaign(s, visits=8, gain=walk(s, 3e-3))) for s in SEEDS]
    assert sum(a.first.present for a in walks) >= 2
    assert sum(bool(a.accepted) for a in walks) <= 1
    drifts = [answer(campaign(s, visits=8, gain=drift(3e-3))) for s in SEEDS]
    named = [a.accepted[0].effects for a in drifts if a.accepted]
    assert named.count(("gain_drift",)) >= 2


def test_an_effect_beside_a_walk_keeps_its_name_alone():
    def gain(covariates):
        return walk(1, 2.5e-3)(covariates) * (covariates["supply_V"] / 3.8) ** 0.5

    found = answer(campaign(1, visits=8, gain=gain))
    assert found.accepted[0].effects == ("supply_sag",)
    assert found.accepted[0].random_walk_gain > 0
    assert found.accepted[0].form_discrepancy.shape[1] > waves(found.problem.data).shape[1]


def test_a_height_that_creeps_is_no_offset():
    """The traverse loses height all day: an offset that stays is the nearest name, and wrong."""
    data = campaign(0, visits=8, height=0.02e-3)
    way = 4e-3 * (1 - data.visit / data.visit.max()) / RADIUS
    moved = sanchez_cuevas(data.z_hat + way) / sanchez_cuevas(data.z_hat)
    found = answer(dataclasses.replace(data, lift_N=data.lift_N * moved))
    assert found.first.p_value < 1e-6
    assert found.accepted == ()


def test_the_likeliest_size_is_that_of_the_dense_likelihood():
    rng = np.random.default_rng(4)
    columns = rng.normal(size=(60, 5)) * 200
    scores = rng.normal(size=60) + columns @ rng.normal(0, 2e-3, 5)

    def log(size):
        whole = np.eye(60) + size**2 * columns @ columns.T
        return -0.5 * (np.linalg.slogdet(whole)[1] + scores @ np.linalg.solve(whole, scores))

    best = likeliest(scores, columns, 60)
    assert best == max(SIZES, key=log)
    still = rng.normal(size=60)
    added = log_evidence_gain(np.stack([scores, still], axis=1), columns, 60)
    assert added == pytest.approx([log(best) - log(0.0) - bic_penalty(best, 60), 0.0])
    assert likeliest(still, columns, 60) == 0.0
    assert likeliest(scores, columns[:, :0], 60) == 0.0


@pytest.mark.parametrize("lost", ["order", "visits"])
def test_without_an_order_or_with_few_visits_nothing_wanders(lost):
    data = problem(campaign(0, visits=8)).data
    data = (
        dataclasses.replace(data, ordered=False) if lost == "order" else data.take(data.visit < 15)
    )
    assert waves(data).shape == (data.n, 0)
