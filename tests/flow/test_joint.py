"""Lift and downwash informing one coefficient: more is known when they agree, and it is said when
they do not.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from tests.unit import small_run

from nearlift import catalogue
from nearlift.errors import InputRefused, ManifestError
from nearlift.fit.joint import Downwash, JointProblem, fit_joint
from nearlift.fit.least_squares import assemble, fit
from nearlift.manifest import campaign as manifests
from nearlift.products import DOWNWASH, JOINT
from nearlift.results import Observations
from nearlift.run import graph
from nearlift.stages import flow, joint

from .conftest import HEAD

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


def wash(K_b: float, seed: int = 0, u: float = 0.005, u_control: float = 0.003) -> Downwash:
    z = np.array([4.5, 3.0, 2.0])
    rng = np.random.default_rng(seed)
    error = u * rng.standard_normal(3) - u_control * rng.standard_normal()
    return Downwash(
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
        assert both.estimates["K_b"].u < alone.estimates["K_b"].u
        found.append((both.estimates["K_b"].value, both.estimates["K_b"].u, both.p_value))
    value, u, p = np.array(found).T
    assert abs(value.mean() - 2.0) < 4 * value.std() / np.sqrt(40)
    assert value.std() == pytest.approx(u.mean(), rel=0.44)
    assert (p < 1e-3).sum() <= 1


def test_its_uncertainty_is_that_of_the_added_information():
    data = trials(2.0)
    alone = fit(MODEL, data)
    precise = fit_joint(alone, data, wash(2.0, u=1e-5, u_control=1e-5))
    assert precise.estimates["K_b"].value == pytest.approx(2.0, abs=0.01)
    assert precise.estimates["K_b"].u < 0.01
    vague = fit_joint(alone, data, wash(2.0, u=10.0))
    assert vague.estimates["K_b"].value == pytest.approx(alone.estimates["K_b"].value, abs=1e-3)
    assert vague.estimates["K_b"].u == pytest.approx(alone.estimates["K_b"].u, rel=1e-3)


def test_a_contradiction_is_told():
    data = trials(2.0)
    assert fit_joint(fit(MODEL, data), data, wash(8.0, u=0.002, u_control=0.001)).p_value < 1e-4


def test_the_control_s_error_is_shared():
    """A control that is off moves all cases alike: as many as there are know no more of a common
    factor than the control's own error.
    """
    many = Downwash(
        z_hat=np.full(400, 3.0), ratio=np.full(400, 0.95), u_own=np.full(400, 1e-3), u_control=0.01
    )
    w = many.whitener()
    assert 1 / np.sqrt((w @ np.ones(400)) @ (w @ np.ones(400))) == pytest.approx(0.01, rel=0.01)


def test_residuals_are_those_of_lift_then_of_downwash_and_broadcast():
    data = trials(2.0)
    alone = fit(MODEL, data)
    problem = assemble(MODEL, data, (), alone.noise, alone.theta)
    both = JointProblem(
        model=MODEL, data=data, covariance=problem.covariance, downwash=wash(2.0), geometry=GEOMETRY
    )
    many = both.residuals(np.array([[1.0], [2.0]]))
    assert many.shape == (2, data.n + 3)
    np.testing.assert_allclose(many[1], both.residuals(np.array([2.0])))
    np.testing.assert_allclose(many[1, : data.n], problem.residuals(np.array([2.0])))
    assert both.chi2(np.array([2.0])) == pytest.approx((many[1] ** 2).sum())


def test_what_cannot_be_joined_is_refused():
    data = trials(2.0)
    empty = Downwash(z_hat=np.zeros(0), ratio=np.zeros(0), u_own=np.zeros(0), u_control=0.0)
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


def test_asking_for_it_without_grids_is_refused():
    with pytest.raises(ManifestError, match=r"fit.ground.downwash = true, but no velocity grids"):
        manifests.parse(tomllib_of(HEAD + "[fit.ground]\ndownwash = true\n"))


def tomllib_of(text: str):
    import tomllib

    return tomllib.loads(text)


def test_the_stage_takes_only_cuts_that_stand_for_the_disk(wakes, tmp_path: Path):
    raw = small_run.write(tmp_path / "raw")
    text = (wakes.job.root / "campaign.toml").read_text()
    path = raw / "campaign.toml"
    path.write_text(
        path.read_text() + "\n[fit.ground]\ndownwash = true\n\n" + text[text.index("[piv]") :]
    )
    (raw / "piv").symlink_to(wakes.job.root / "piv")
    campaign = manifests.load(raw)
    table = wakes.job.read(DOWNWASH)
    used, left_out, measured = joint.select(table, campaign, "ground")
    assert used == ("ground-4",)
    reasons = {entry.case: entry.reason for entry in left_out}
    assert (reasons["ground-3.4"], reasons["ground-1.8"], reasons["tilt+1.5"]) == (
        "deflection zone",
        "meets boundary",
        "tilted",
    )
    assert measured.ratio[0] == pytest.approx(
        1 - table["reduction"][(table["case"] == "ground-4") & (table["rotor"] == "all")][0]
    )
    # the rest of the stage, on the trials of a small campaign
    made = dataclasses.replace(
        wakes.job, root=raw, campaign=campaign, processed=tmp_path / "processed"
    )
    from nearlift.stages import ingest

    made = dataclasses.replace(made, inputs=dict.fromkeys(ingest.inputs(raw, campaign), "0" * 64))
    ingest.run(made)
    made.write(DOWNWASH, table)
    outcome = joint.run(made)
    assert outcome.notes == ()
    found = made.read_json(JOINT)["boundaries"]["ground"]
    assert found["model"] == "sanchez_cuevas"
    assert found["n_downwash"] == 1
    assert found["parameters"]["K_b"]["u"] <= found["lift_alone"]["K_b"]["u"]


def test_it_belongs_to_a_run_only_where_it_is_asked_for(wakes):
    assert not graph.stage("joint").configured(wakes.job)
    assert graph.stage("flow").configured(wakes.job)
    with pytest.raises(ManifestError, match="say downwash = true under"):
        joint.run(wakes.job)
    assert flow.DOWNWASH.file == "downwash.parquet"
