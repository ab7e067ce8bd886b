"""Where fits begin: to first order, each start is what a dense least-squares fit at its shapes is."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.unit.simulated import campaign, problem

from nearlift import catalogue
from nearlift.loop.candidate_fit import search


@pytest.fixture(scope="module")
def stage():
    data = campaign(3, visits=3, gain=lambda known: (known["supply_V"] / 3.8) ** 0.5)
    return problem(data)


def by_hand(stage, candidate, shape):
    """The penalised least-squares fit to first order about the base model, at one shape."""
    p, (mean, sd) = len(stage.theta), candidate.prior
    null = shape.copy()
    null[:p] = stage.base_fit.vector
    active = np.r_[np.arange(p), candidate.sizes()]
    slopes = stage.space.project(candidate.jacobian(null).T[active]).T
    left = stage.space.project(stage.log_lift - candidate.log_ratio(null))
    weight = 1 / sd[active]
    whole = np.vstack([slopes, np.diag(weight)])
    target = np.r_[left, weight * (mean - null)[active]]
    moved = np.linalg.lstsq(whole, target, rcond=None)[0]
    vector = null.copy()
    vector[active] += moved
    return float(np.sum((target - whole @ moved) ** 2)), vector, null


@pytest.mark.parametrize(
    "names",
    [(), ("supply_sag",), ("warm_up",), ("warm_up", "zero_drift"), ("session_gain", "tilt")],
    ids=" + ".join,
)
def test_a_start_is_a_dense_fit_to_first_order_at_its_shapes(stage, names):
    effects = tuple(e for name in names for e in stage.effects if e.name == name)
    candidate = stage.candidate(*effects)
    expected = sorted(
        (by_hand(stage, candidate, shape) for shape in candidate.shapes()), key=lambda s: s[0]
    )
    starts = stage.starts.ranked(candidate, stage.log_lift)
    assert len(starts) == len(expected)
    length = np.sqrt(np.sum(stage.space.project(candidate.jacobian(expected[0][1]).T) ** 2, axis=1))
    for (start, at), (_, vector, null) in zip(starts, expected, strict=True):
        # in standard uncertainties
        assert (start - vector) * length == pytest.approx(np.zeros(len(vector)), abs=1e-3)
        assert np.array_equal(at, null)


def test_what_the_trials_do_not_tell_stays_at_its_prior(stage):
    """An effect without any mark on these trials has a start, and its prior's size."""
    known = stage.data.covariates
    still = dataclasses.replace(
        stage.data, covariates=known | {"supply_V": np.full(stage.data.n, 3.8)}
    )
    part = dataclasses.replace(stage, data=still)
    candidate = part.candidate(catalogue.effect("supply_sag"))
    fitted = search(candidate, part.starts, part.log_lift)
    assert fitted.chi2 == pytest.approx(part.base_fit.chi2, rel=1e-9)
    assert fitted.vector[1:] == pytest.approx(candidate.prior[0][1:], abs=1e-6)
