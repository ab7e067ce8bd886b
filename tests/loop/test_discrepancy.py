"""What has no name is carried: the size of a random discrepancy, and the interval that it
leaves.
"""

from __future__ import annotations

import numpy as np
import pytest
from tests.unit.simulated import GROUND, campaign, findings, sanchez_cuevas

from nearlift import catalogue
from nearlift.loop import discrepancy
from nearlift.loop.diagnose import set_up
from nearlift.loop.families import indicators, powers
from nearlift.loop.search_problem import Options

EFFECTS = tuple(
    e for e in catalogue.effects() if e.name in ("supply_sag", "session_gain", "gain_drift")
)


def rippled(z):
    """A ripple along distance, which none of these effects could make."""
    return sanchez_cuevas(z) * (1 + 0.012 * np.sin(9 * np.log(z)))


@pytest.fixture(scope="module")
def stage():
    return set_up(campaign(3, visits=5), GROUND, (), Options(), EFFECTS)[0]


@pytest.mark.parametrize("shape", ["distances", "curve"])
def test_moments_give_the_variance_that_was_put_in(stage, shape):
    family = (
        indicators(stage.data.z_hat)
        if shape == "distances"
        else powers(np.log(np.minimum(stage.data.z_hat, 99.0)), 3)
    )
    true = 0.01
    rng = np.random.default_rng(5)
    white = stage.space.project(family.T).T
    root = np.linalg.cholesky(stage.space.covariance.dense())
    jacobian = stage.base_fit.jacobian
    jacobian = jacobian / np.linalg.norm(jacobian, axis=0)
    variances = []
    for _ in range(400):
        # residuals of a campaign that holds the discrepancy and unit noise, and nothing that the
        # fit absorbs
        residual = white @ (true * rng.standard_normal(family.shape[1])) + stage.space.project(
            root @ rng.standard_normal(stage.data.n)
        )
        residual = residual - jacobian @ (jacobian.T @ residual)
        left = white - jacobian @ (jacobian.T @ white)
        variances.append(discrepancy._variance(left, residual)[0])
    # unbiased before it is cut at zero; 400 draws of a sum of few squares
    assert np.mean(variances) == pytest.approx(true**2, abs=4 * np.std(variances) / 20)


def test_an_unexplained_ripple_widens_the_interval_until_it_holds_the_truth():
    data = campaign(4, visits=6, ratio=rippled)
    found = findings(data, GROUND, effects=EFFECTS, confirm=False)
    assert found["verdict"] == "unexplained"
    before, after = (found["coefficients"][when]["K_b"] for when in ("before", "after"))
    assert "distance" in found["coefficients"]["carried"]
    assert after["hi90"] - after["lo90"] > 1.5 * (before["hi90"] - before["lo90"])
    assert after["lo90"] < 2.0 < after["hi90"]
    assert after["lo90"] < after["value"] < after["hi90"]


def test_what_is_adequate_carries_nothing():
    found = findings(campaign(5, visits=5), GROUND, effects=EFFECTS, confirm=False)
    assert found["verdict"] == "adequate"
    assert found["coefficients"]["carried"] == []
    assert {
        k: found["coefficients"]["after"]["K_b"][k] for k in ("value", "lo90", "hi90")
    } == found["coefficients"]["before"]["K_b"]
