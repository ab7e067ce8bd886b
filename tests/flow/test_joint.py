"""Lift and downwash informing one coefficient: more is known when they agree, and it is said when
they do not.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from nearlift import catalogue
from nearlift.errors import InputRefused
from nearlift.fit.joint import DownwashRatio, JointProblem, fit_joint
from nearlift.fit.least_squares import assemble, fit
from nearlift.results import Observations

GEOMETRY = {"spacing_hat": 65 / 23, "diagonal_hat": 92 / 23}
MODEL = catalogue.model("sanchez_cuevas")


def trials(K_b: float, seed: int = 0, noise: float = 0.01) -> Observations:
    z = np.repeat([1.14, 1.4, 1.8, 2.5, 4.0, 12.0], 8)
    rng = np.random.default_rng(seed)
    n = len(z)
    return Observations(
        boundary="ground",
        trial=np.array([f"t{i}" for i in range(n)], dtype=object),
        z_hat=z,
        lift_N=0.4 * MODEL(z, **GEOMETRY, K_b=K_b) * np.exp(noise * rng.standard_normal(n)),
        u_lift_N=np.zeros(n),
        n_eff=np.full(n, 100.0),
        throttle=np.full(n, 0.5),
        visit=np.arange(n),
        session=np.zeros(n, dtype=np.int64),
        radius_m=0.023,
        geometry=GEOMETRY,
    )


def wash(K_b: float, seed: int = 0, u: float = 0.005, u_control: float = 0.003) -> DownwashRatio:
    z = np.array([4.5, 3.0, 2.0])
    rng = np.random.default_rng(seed)
    error = u * rng.standard_normal(3) - u_control * rng.standard_normal()
    return DownwashRatio(
        z_hat=z,
        ratio=MODEL.downwash(z, **GEOMETRY, K_b=K_b) * np.exp(error),
        u_own=np.full(3, u),
        u_control=u_control,
    )


def test_together_they_know_more_than_lift_alone_and_are_unbiased():
    """40 joint estimates of K_b = 2: their mean within 4 of its standard errors, their spread
    within 5 sd (44 %) of what they claim.
    """
    found = []
    for seed in range(40):
        data = trials(2.0, seed)
        alone = fit(MODEL, data)
        both = fit_joint(alone, data, wash(2.0, 100 + seed))
        assert both.parameters["K_b"].u < alone.estimates["K_b"].u
        found.append((both.parameters["K_b"].value, both.parameters["K_b"].u, both.p_value))
    value, u, p = np.array(found).T
    assert abs(value.mean() - 2.0) < 4 * value.std() / np.sqrt(40)
    assert value.std() == pytest.approx(u.mean(), rel=0.44)
    assert (p < 1e-3).sum() <= 1


def test_its_uncertainty_is_that_of_the_added_information():
    data = trials(2.0)
    alone = fit(MODEL, data)
    precise = fit_joint(alone, data, wash(2.0, u=1e-5, u_control=1e-5))
    assert precise.parameters["K_b"].value == pytest.approx(2.0, abs=0.01)
    assert precise.parameters["K_b"].u < 0.01
    vague = fit_joint(alone, data, wash(2.0, u=10.0))
    assert vague.parameters["K_b"].value == pytest.approx(alone.estimates["K_b"].value, abs=1e-3)
    assert vague.parameters["K_b"].u == pytest.approx(alone.estimates["K_b"].u, rel=1e-3)


def test_derivatives_at_several_values_are_those_at_each():
    alone = fit(MODEL, trials(2.0))
    both = JointProblem(
        model=MODEL,
        data=alone.problem.data,
        covariance=alone.problem.covariance,
        downwash=wash(2.0),
    )
    theta = np.array([[1.5], [2.0], [2.5]])
    found = both.derivatives(theta)
    assert found.shape == (3, 1, len(both.residuals(theta[0])))
    for one, each in zip(theta, found, strict=True):
        assert each == pytest.approx(both.derivatives(one))


def test_a_contradiction_is_told():
    data = trials(2.0)
    assert fit_joint(fit(MODEL, data), data, wash(8.0, u=0.002, u_control=0.001)).p_value < 1e-4


def test_the_control_s_error_is_shared():
    """A control that is off moves all cases alike: as many as there are know no more of a common
    factor than the control's own error.
    """
    many = DownwashRatio(
        z_hat=np.full(400, 3.0), ratio=np.full(400, 0.95), u_own=np.full(400, 1e-3), u_control=0.01
    )
    w = many.whitener()
    assert 1 / np.sqrt((w @ np.ones(400)) @ (w @ np.ones(400))) == pytest.approx(0.01, rel=0.01)


def test_residuals_are_those_of_lift_then_of_downwash_and_broadcast():
    data = trials(2.0)
    alone = fit(MODEL, data)
    problem = assemble(MODEL, data, (), alone.noise, alone.theta)
    both = JointProblem(model=MODEL, data=data, covariance=problem.covariance, downwash=wash(2.0))
    many = both.residuals(np.array([[1.0], [2.0]]))
    assert many.shape == (2, data.n + 3)
    np.testing.assert_allclose(many[1], both.residuals(np.array([2.0])))
    np.testing.assert_allclose(many[1, : data.n], problem.residuals(np.array([2.0])))
    assert both.chi2(np.array([2.0])) == pytest.approx((many[1] ** 2).sum())


def test_what_cannot_be_joined_is_refused():
    data = trials(2.0)
    empty = DownwashRatio(z_hat=np.zeros(0), ratio=np.zeros(0), u_own=np.zeros(0), u_control=0.0)
    alone = fit(MODEL, data)
    with pytest.raises(InputRefused, match=r"no case of \[piv\] stands for the inflow"):
        fit_joint(alone, data, empty)
    with pytest.raises(InputRefused, match="declares no downwash"):
        fit_joint(fit(catalogue.model("exponential"), data), data, wash(2.0))
    with pytest.raises(InputRefused, match="has no free coefficient"):
        fit_joint(
            fit(
                catalogue.model("images"),
                dataclasses.replace(data, geometry=GEOMETRY | {"layout_hat": np.zeros((1, 2))}),
            ),
            data,
            wash(2.0),
        )
