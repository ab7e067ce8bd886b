"""Fits of candidates, penalised and within bounds, against lmfit's."""

from __future__ import annotations

import lmfit
import numpy as np
import pytest
from tests.unit.simulated import campaign

from nearlift import catalogue
from nearlift.loop.candidate_fit import optima
from nearlift.loop.diagnose import set_up
from nearlift.loop.search_problem import Options


@pytest.fixture(scope="module")
def problem():
    data = campaign(3, visits=3, gain=lambda known: (known["supply_V"] / 3.8) ** 0.5)
    return set_up(data, catalogue.model("sanchez_cuevas"), (), Options())[0]


def by_lmfit(candidate, problem, start):
    """The objective at lmfit's minimum from `start`."""
    (low, high), (mean, sd) = candidate.bounds, candidate.prior
    parameters = lmfit.Parameters()
    for i, (value, a, b) in enumerate(zip(start, low, high, strict=True)):
        inset = 1e-9 * (b - a) if np.isfinite(b - a) else 0.0
        parameters.add(f"x{i}", value=np.clip(value, a + inset, b - inset), min=a, max=b)

    def residuals(values):
        x = np.array([v.value for v in values.values()])
        left = problem.space.project(problem.log_lift - candidate.log_ratio(x))
        return np.nan_to_num(np.r_[left, (x - mean) / sd], nan=1e3)

    return lmfit.minimize(residuals, parameters, method="least_squares", x_scale="jac").chisqr


@pytest.mark.parametrize(
    "names",
    [
        (),
        ("supply_sag",),
        ("height_scale",),
        ("session_gain",),
        ("warm_up", "zero_drift"),
        ("supply_sag", "held_quantity"),
    ],
    ids=" + ".join,
)
def test_a_candidate_ends_where_lmfit_does(problem, names):
    effects = tuple(e for name in names for e in problem.effects if e.name == name)
    assert len(effects) == len(names)
    candidate = problem.candidate(*effects)
    best = optima(candidate, problem.starts, problem.log_lift)[0]
    expected = by_lmfit(candidate, problem, best.vector)
    # a search ends at a gain of 1e-3, and evidences differ by units
    assert best.cost == pytest.approx(expected, abs=2e-3)
    perturbed = best.vector + 0.3 * np.sqrt(np.diag(best.covariance))
    assert by_lmfit(candidate, problem, perturbed) > best.cost - 2e-3
