"""The figure of residuals, and the bins that it shares with the loop's."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest
from tests.unit import quoted

from nearlift.report.evidence import pick
from nearlift.report.figures import binning, residuals
from nearlift.stages.diagnose import DIAGNOSIS, LOOP_RESIDUALS
from nearlift.stages.fit import RESULTS


@pytest.mark.parametrize("boundary", ["ground", "ceiling", "sidewall"])
def test_residuals_are_those_of_the_fit(evidence, boundary):
    of = residuals.residuals(evidence, boundary)
    assert "base" not in of
    rmse = evidence.base(boundary)[1].rmse
    assert np.sqrt(np.mean(of.quoted**2)) == pytest.approx(rmse, rel=1e-6)
    assert 0.7 < np.mean((of.quoted / of.sigma) ** 2) < 1.3


def test_bins_hold_every_accepted_trial_once_and_their_means_are_right(evidence):
    table = residuals.table(evidence)
    mine = pick(table, panel="ground", covariate="run_order")
    trials, means = pick(mine, kind="trial"), pick(mine, kind="bin")
    assert means["n_trials"].sum() == len(trials)
    weighted = np.average(means["residual_percent"], weights=means["n_trials"])
    assert weighted == pytest.approx(trials["residual_percent"].mean(), abs=1e-12)
    assert set(trials["trial"]) <= set(evidence.observations["ground"].trial)
    assert "t0003" not in set(table["trial"])
    assert "1 rejected (not shown)" in residuals.caption(evidence, table)


def test_no_mean_lies_in_a_gap_of_its_covariate():
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.uniform(0, 1, 300), rng.uniform(9, 10, 300)])
    label = binning.bins(x)
    centres = np.bincount(label, x) / np.bincount(label)
    assert not np.any((centres > 1) & (centres < 9))
    assert set(label) == set(range(label.max() + 1))
    assert binning.bins(np.array([1.0, -1.0, 1.0])).tolist() == [1, 0, 1]


def test_bins_of_time_do_not_cross_sessions():
    session = np.repeat([0, 1, 2], [50, 30, 100])
    label = binning.time_bins(np.random.default_rng(0).standard_normal(180), session)
    assert all(len(set(session[label == k].tolist())) == 1 for k in set(label.tolist()))
    assert sorted(set(label.tolist())) == list(range(label.max() + 1))


def test_where_an_effect_is_quoted_the_base_fit_is_shown_too(evidence):
    data = evidence.observations["ground"]
    own = copy.deepcopy(evidence.document(RESULTS))
    own["boundaries"]["ground"]["effects"] = ["supply_sag"]
    wave = 0.02 * np.cos(np.arange(data.n))
    left = {"boundary": np.full(data.n, "ground", dtype=object), "trial": data.trial}
    found = quoted.diagnosis({"ground": {"verdict": "effect"}})
    made = dataclasses.replace(
        evidence,
        tables={**evidence.tables, LOOP_RESIDUALS.file: left | {"before": wave, "after": 0 * wave}},
        documents={**evidence.documents, RESULTS.file: own, DIAGNOSIS.file: found},
    )
    table = residuals.table(made)
    of = {k: pick(table, panel="ground", covariate="z_hat", kind=k) for k in ("bin", "base")}
    assert np.abs(of["bin"]["residual_percent"]).max() < 1e-12
    mean = np.average(of["base"]["residual_percent"], weights=of["base"]["n_trials"])
    assert mean == pytest.approx(100 * wave.mean())
    assert not (pick(table, panel="ceiling")["kind"] == "base").any()
    assert "Hollow squares" in residuals.caption(made, table)
