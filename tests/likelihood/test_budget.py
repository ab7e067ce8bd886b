"""The budget: each declared component widens what linear theory says it widens, and no repeat
averages it down.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from tests.unit import manifests, sweeps
from tests.unit.manifests import raw_manifest
from tests.unit.simulated import RADIUS, campaign, part, sanchez_cuevas

from nearlift import catalogue
from nearlift.campaign import manifest
from nearlift.campaign.manifest import Campaign
from nearlift.fit.least_squares import assemble, fit
from nearlift.likelihood import budget
from nearlift.likelihood.budget import Component
from nearlift.likelihood.problem import height_slope
from nearlift.results import Noise, Observations

MODEL = catalogue.model("sanchez_cuevas")
SCATTER = Noise(relative=0.004)
THETA = np.array([2.0])


def u_K_b(data: Observations, *parts: Component) -> float:
    return fit(MODEL, data, parts, SCATTER).estimates["K_b"].u


def curvature(data: Observations, theta: float) -> tuple[float, float, float]:
    """J'J, J's and s's with L_inf taken out by hand, of K_b and of a shared height error of one
    metre, under SCATTER alone.
    """
    variance = SCATTER.relative**2 + (data.u_lift_N / data.lift_N) ** 2
    step_m = 1e-6
    columns = [
        (
            np.log(sanchez_cuevas(data.z_hat, theta + 1e-4))
            - np.log(sanchez_cuevas(data.z_hat, theta - 1e-4))
        )
        / 2e-4,
        (
            np.log(sanchez_cuevas(data.z_hat + step_m / RADIUS, theta))
            - np.log(sanchez_cuevas(data.z_hat - step_m / RADIUS, theta))
        )
        / (2 * step_m),
    ]
    free = []
    for column in columns:
        centred = column.copy()
        for throttle in data.levels:
            mine = data.throttle == throttle
            centred[mine] -= np.average(column[mine], weights=1 / variance[mine])
        free.append(centred / np.sqrt(variance))
    return float(free[0] @ free[0]), float(free[0] @ free[1]), float(free[1] @ free[1])


@pytest.mark.parametrize("datum_m", [0.05e-3, 0.2e-3, 2e-3])
def test_a_datum_widens_K_b_by_exactly_what_linear_theory_says(datum_m):
    """One unknown height d ~ N(0, datum): the K_b entry of the inverse of [[J'J, J's], [J's, s's +
    1/datum^2]].
    """
    data = campaign(3, visits=4)
    without, found = (
        fit(MODEL, data, parts, SCATTER, offset_m=0.0).estimates["K_b"]
        for parts in ((), (part(standard=datum_m),))
    )
    assert without.u == pytest.approx(curvature(data, without.value)[0] ** -0.5, rel=1e-4)
    jj, js, ss = curvature(data, found.value)
    expected = np.linalg.inv([[jj, js], [js, ss + datum_m**-2]])[0, 0] ** 0.5
    assert found.u == pytest.approx(expected, rel=1e-4)
    assert expected > 1.003 * without.u  # or the test would say nothing


def test_the_datum_does_not_average_down_and_scatter_does():
    """Sixteen times as many trials: the scatter's part falls to a quarter, that of a datum too
    small for them to find stays.
    """
    few, many = campaign(3, visits=4), campaign(3, visits=64)
    assert u_K_b(many) == pytest.approx(u_K_b(few) / 4, rel=0.05)
    datum = part(standard=0.1e-3)
    own = [np.sqrt(u_K_b(d, datum) ** 2 - u_K_b(d) ** 2) for d in (few, many)]
    assert own[1] == pytest.approx(own[0], rel=0.15)


@pytest.mark.parametrize("scope", ["throttle", "boundary", "campaign"])
def test_a_gain_that_L_inf_absorbs_leaves_K_b_and_its_uncertainty_unmoved(scope):
    data = campaign(3, visits=3)
    without, given = (
        fit(MODEL, data, (), SCATTER),
        fit(MODEL, data, (part("gain", 0.05, scope),), SCATTER),
    )
    assert given.estimates["K_b"].value == pytest.approx(without.estimates["K_b"].value, abs=1e-7)
    assert given.estimates["K_b"].u == pytest.approx(without.estimates["K_b"].u, rel=1e-8)
    for throttle, level in given.levels.items():
        # but each L_inf is as uncertain as the gain
        assert level.u / level.value == pytest.approx(
            np.hypot(0.05, without.levels[throttle].u / without.levels[throttle].value), rel=1e-6
        )


@pytest.mark.parametrize("scope", ["sample", "trial"])
def test_an_independent_component_widens_each_trials_own_variance(scope):
    data = campaign(3, visits=2)
    bare = assemble(MODEL, data, (), SCATTER, THETA).covariance
    given = assemble(
        MODEL, data, (part("force", 2e-3, scope), part("gain", 0.01, scope)), SCATTER, THETA
    ).covariance
    over = 50.0 if scope == "sample" else 1.0  # n_eff of every trial
    assert given.variance - bare.variance == pytest.approx(
        ((2e-3 / data.lift_N) ** 2 + 0.01**2) / over
    )
    assert given.shared.shape == (data.n, 0)


@pytest.mark.parametrize("scope", budget.GROUPED)
@pytest.mark.parametrize("on", ["height", "force", "gain"])
def test_trials_of_one_element_share_one_unknown_and_others_none(on, scope):
    data = campaign(3, visits=2)
    slope = height_slope(MODEL, data, {"K_b": 2.0})
    element = {"distance": data.z_hat, "throttle": data.throttle, "session": data.session}.get(
        scope, np.zeros(data.n)
    )
    size = {"height": 2e-4 * slope, "force": 2e-4 / data.lift_N, "gain": np.full(data.n, 2e-4)}[on]
    shared = budget.shared(data, (part(on, scope=scope),), slope)
    assert shared.shape[1] == len(np.unique(element))
    assert shared @ shared.T == pytest.approx(
        np.equal.outer(element, element) * np.outer(size, size), abs=1e-18
    )


def test_a_cells_line_bends_by_its_accuracy_at_full_range_and_not_at_zero():
    bend = part("linearity", 0.008, "campaign", range_N=9.8)
    lift = np.array([1e-9, 4.9, 9.8])
    data = dataclasses.replace(campaign(3, visits=1), lift_N=lift)
    departure_N = bend.sensitivity(data, np.zeros(3)) * lift
    assert departure_N == pytest.approx([0.0, 0.008 / 4, 0.008], abs=1e-15)


def test_the_manifest_declares_the_budget():
    raw = raw_manifest(
        load_cell={"range": "1 kgf", "accuracy": "1.5 gf", "tare": "none"},
        uncertainty=[
            {"name": "datum", "on": "height", "value": "0.2 mm", "scope": "boundary"},
            {
                "name": "supply",
                "on": "gain",
                "value": "1 percent",
                "distribution": "uniform",
                "scope": "session",
            },
        ],
    )
    found = {c.name: c for c in budget.components(manifest.parse(raw))}
    assert found["datum"].standard == pytest.approx(0.2e-3)
    assert found["supply"].standard == pytest.approx(0.01 / np.sqrt(3))  # a half-width
    half_width = 1.5e-3 * 9.80665 / np.sqrt(3)
    line, zero = found["load cell linearity"], found["untared zero"]
    assert (line.on, line.scope, line.range_N) == ("linearity", "campaign", pytest.approx(9.80665))
    assert (zero.on, zero.scope) == ("force", "session")
    assert line.standard == zero.standard == pytest.approx(half_width)
    assert [c.name for c in budget.components(manifest.parse(raw_manifest()))] == ["distance datum"]


def names(campaign: Campaign) -> set[str]:
    return {c.name for c in budget.components(campaign)}


@pytest.mark.parametrize(
    ("tare", "zero"), [("2 s", "zero of a record"), ("0 s", ""), ("none", "untared zero")]
)
def test_trials_of_a_record_share_its_zero_and_untared_ones_an_offset(tare: str, zero: str) -> None:
    """Where nothing was tared off, no zero was measured."""
    cell = {"tare": tare, "accuracy": "1.5 gf", "range": "1 kgf"}
    assert names(sweeps.campaign(load_cell=cell)) == {"load cell linearity", zero} - {""}
    # a record of one trial has its zero for itself
    one_each = {"load cell linearity", zero} - {"", "zero of a record"}
    assert names(manifests.manifest(load_cell=cell)) == one_each
