"""The proposal of importance sampling: a density, and one that stays where it is right."""

from dataclasses import replace

import numpy as np
import pytest

from nearlift.declare import Parameter, uniform
from nearlift.fit.mixture import Mixture
from nearlift.fit.prior import JointPrior

WIDE = Parameter(
    name="x", unit="1", value=0.0, bounds=(-200.0, 200.0), prior=uniform(-200.0, 200.0), meaning="x"
)
MIXTURE = Mixture(
    prior=JointPrior.from_parameters([WIDE]),
    share=np.array([0.6, 0.3]),
    mean=np.array([[1.0], [6.0]]),
    scale=np.array([[[0.04]], [[0.5]]]),
)


def test_it_is_a_density():
    """To what a grid and the tails beyond it leave out."""
    x = np.linspace(-200, 200, 400_001)[:, None]
    assert np.exp(MIXTURE.log_density(x)).sum() * 1e-3 == pytest.approx(1, abs=1e-3)


def test_its_draws_have_its_density():
    x = np.linspace(-200, 200, 400_001)
    below = np.cumsum(np.exp(MIXTURE.log_density(x[:, None]))) * 1e-3
    drawn = MIXTURE.draw(np.random.default_rng(3), 40_000)[:, 0]
    for quantile in (0.05, 0.2, 0.5, 0.8, 0.95):
        # four standard errors of a share
        share = np.mean(drawn < x[np.searchsorted(below, quantile)])
        assert share == pytest.approx(quantile, abs=4 * np.sqrt(quantile * (1 - quantile) / 40_000))


def test_learning_from_its_own_draws_changes_nothing():
    """A step of maximisation, whose fixed point is the mixture that the draws come from. The
    bounds are over four standard errors of what 20 000 draws say.
    """
    one = replace(
        MIXTURE, share=np.array([0.95]), mean=np.array([[1.0]]), scale=np.full((1, 1, 1), 0.04)
    )
    drawn = one.draw(np.random.default_rng(4), 20_000)
    learnt = one.learn(drawn, np.ones(20_000))
    assert learnt.mean[0, 0] == pytest.approx(1.0, abs=0.01)
    assert learnt.scale[0, 0, 0] == pytest.approx(0.04, rel=0.1)
