"""The demo: products as the contract has them, and the answer that was put into its records."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from nearlift.run import tables
from nearlift.stages.ingest import TRIALS
from nearlift.stages.reduce import LIFT, LIFT_COVARIANCE


@pytest.fixture(scope="module")
def processed(demo):
    return demo / "processed" / "demo"


def test_trials_and_cells_have_the_columns_of_the_contract(processed):
    trials = tables.read_table(processed / "trials.parquet", TRIALS)
    record = {"lift_N", "u_lift_N", "n", "n_eff", "drift_N_s", "sd_N", "quality", "source_sha256"}
    assert {"trial", "boundary", "z_hat", "z_m", "throttle"} | record <= trials.keys()
    assert 0 < trials["throttle"].min() <= trials["throttle"].max() <= 1
    cells = tables.read_table(processed / "lift.parquet", LIFT)
    lift = {"lift_N", "u_lift_N", "n_trials", "delta_L", "u_delta_L"}
    assert {"boundary", "z_hat", "throttle"} | lift <= cells.keys()
    columns = tables.read_table(processed / "lift_covariance.parquet", LIFT_COVARIANCE)
    covariance = np.stack(list(columns.values()), axis=1)
    assert covariance == pytest.approx(covariance.T)
    assert np.sqrt(np.diag(covariance)) == pytest.approx(cells["u_delta_L"])
    for side in ("ground", "ceiling", "sidewall"):
        here = cells["boundary"] == side
        far = here & (cells["z_hat"] == cells["z_hat"][here].max())
        assert (cells["delta_L"][far] == 0).all()
        assert (cells["u_delta_L"][far] == 0).all()


def test_json_products_have_the_keys_of_the_contract(demo, processed):
    fits = json.loads((processed / "fit.json").read_text())["boundaries"]
    assert set(fits) == {"ground", "ceiling", "sidewall"}
    keys = {"parameters", "covariance", "chi2", "dof", "rmse", "r2", "aic", "bic"}
    ends = {"value", "lo90", "hi90"}
    for entry in (entry for models in fits.values() for entry in models.values()):
        assert keys | {"L_inf_N", "degeneracies"} <= entry.keys()
        assert all({"u"} | ends <= p.keys() for p in entry["parameters"].values())
        assert len(entry["L_inf_N"]) == 4
    assert all("r2_near" in entry for entry in fits["ground"].values())
    diagnosis = json.loads((processed / "diagnosis.json").read_text())
    assert diagnosis["schema"] == "nearlift.diagnosis/1"
    for block in diagnosis["boundaries"].values():
        assert bool(block["effects"]) == (block["verdict"] == "effect")
        assert block["error"]["noise_floor"] > 0
        for when in ("before", "after"):
            assert math.isfinite(block["error"][when]["held_out_rmse"])
            assert all(ends <= c.keys() for c in block["coefficients"][when].values())
    for name in ("index.html", "fig2.pdf", "fig2.png", "fig2.csv", "tables/coefficients.tex"):
        assert (demo / "reports" / "demo" / name).stat().st_size > 0


def test_the_demo_finds_what_is_in_it_and_says_that_it_is_simulated(demo, processed):
    """Supply sag at the ground, which its manifest does not mention; at the ceiling saturation, in
    a form that the library does not have; nothing at the sidewall.
    """
    blocks = json.loads((processed / "diagnosis.json").read_text())["boundaries"]
    named = {boundary: [e["name"] for e in block["effects"]] for boundary, block in blocks.items()}
    assert named == {"ground": ["supply_sag"], "ceiling": ["near_wall_saturation"], "sidewall": []}
    assert blocks["sidewall"]["verdict"] == "adequate"
    K_b = {when: blocks["ground"]["coefficients"][when]["K_b"] for when in ("before", "after")}
    assert K_b["after"]["lo90"] < 2.0 < K_b["after"]["hi90"]
    assert K_b["before"]["hi90"] < 1.0
    alpha = blocks["ceiling"]["coefficients"]["after"]["alpha"]
    assert alpha["lo90"] < 0.125 < alpha["hi90"]
    assert "simulated" in (demo / "reports/demo/index.html").read_text().lower()
