"""The stage `joint`: whom it belongs to, and which cuts it takes."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path

import pytest
from tests.unit import small_run

from nearlift.errors import ManifestError
from nearlift.manifest import campaign as manifests
from nearlift.products import DOWNWASH, JOINT
from nearlift.run import graph
from nearlift.stages import flow, ingest, joint

from .conftest import HEAD


def test_asking_for_it_without_grids_is_refused():
    with pytest.raises(ManifestError, match=r"fit.ground.downwash = true, but no velocity grids"):
        manifests.parse(tomllib.loads(HEAD + "[fit.ground]\ndownwash = true\n"))


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
    measured = joint.select(table, campaign, "ground")
    assert measured.used == ("ground-4",)
    reasons = {entry.case: entry.reason for entry in measured.left_out}
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
