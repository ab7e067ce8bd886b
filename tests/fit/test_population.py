"""Many campaigns together: the interval of the population's mean covers, shared errors do not
average down, a spread is distinguished from none.
"""

from __future__ import annotations

import numpy as np
import pytest

from nearlift.errors import InputRefused
from nearlift.fit.population import population


def drawn(
    rng: np.random.Generator, n: int, spread: float, shared: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    u = rng.uniform(0.02, 0.2, n)
    covariance = np.diag(u**2) + shared**2
    value = (
        2.0
        + spread * rng.standard_normal(n)
        + u * rng.standard_normal(n)
        + shared * rng.standard_normal()
    )
    return value, covariance


@pytest.mark.parametrize(
    ("n", "spread", "shared"), [(4, 0.0, 0.0), (6, 0.15, 0.0), (12, 0.3, 0.1), (5, 0.05, 0.2)]
)
@pytest.mark.nightly
def test_the_interval_of_the_mean_covers(n, spread, shared):
    """Of 300, 90 % should cover; fewer than 84 % happen by chance once in 800. Few campaigns may
    only err on the wide side.
    """
    rng = np.random.default_rng(n)
    hits = 0
    for _ in range(300):
        found = population(*drawn(rng, n, spread, shared)).mean
        hits += found.lo90 <= 2.0 <= found.hi90
    assert hits >= 0.84 * 300


def test_the_next_campaign_falls_into_its_interval():
    rng = np.random.default_rng(1)
    hits = 0
    for _ in range(300):
        found = population(*drawn(rng, 10, 0.2)).next
        hits += found.lo90 <= 2.0 + 0.2 * rng.standard_normal() <= found.hi90
    assert 0.84 * 300 <= hits <= 0.965 * 300


def test_an_error_that_all_share_does_not_average_down():
    value = np.full(40, 2.0)
    alone = population(value, 0.1**2 * np.eye(40))
    together = population(value, 0.01**2 * np.eye(40) + 0.1**2)
    assert alone.mean.u < 0.03
    assert together.mean.u == pytest.approx(0.1, rel=0.02)


def test_with_no_spread_to_see_the_mean_is_the_weighted_one():
    u = np.array([0.01, 0.02, 0.02, 0.03, 0.01, 0.02])
    rng = np.random.default_rng(3)
    value = 2.0 + 0.02 * u * rng.standard_normal(6)
    found = population(value, np.diag(u**2))
    assert found.mean.value == pytest.approx(np.average(value, weights=u**-2), abs=0.1 * u.min())
    assert found.p_value > 0.99
    assert found.spread.lo90 < 0.3 * np.median(u)


def test_a_large_spread_is_found():
    value = np.array([1.0, 1.5, 2.0, 2.5, 3.0])
    found = population(value, 1e-4 * np.eye(5))
    assert found.p_value < 1e-12
    assert found.spread.lo90 < np.std(value, ddof=1) < found.spread.hi90


def test_the_unit_of_the_values_does_not_matter():
    value, covariance = drawn(np.random.default_rng(5), 6, 0.1)
    one, thousand = population(value, covariance), population(1e3 * value, 1e6 * covariance)
    assert thousand.mean.hi90 == pytest.approx(1e3 * one.mean.hi90, rel=1e-9)
    assert thousand.p_value == pytest.approx(one.p_value, rel=1e-9)


def test_two_campaigns_are_too_few():
    with pytest.raises(
        InputRefused,
        match="compare: 2 campaigns do not determine how much campaigns differ\n  give at least 3",
    ):
        population(np.array([1.0, 2.0]), np.eye(2))


def test_a_value_without_uncertainty_is_refused():
    with pytest.raises(InputRefused, match="compare: a value has no uncertainty"):
        population(np.ones(3), np.diag([1.0, 0.0, 1.0]))
