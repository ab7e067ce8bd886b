"""Trials whose order is not known."""

import dataclasses

import numpy as np
from tests.unit.simulated import campaign, findings, hsiao

from nearlift import catalogue
from nearlift.likelihood.covariates import derive
from nearlift.loop.diagnose import set_up
from nearlift.loop.families import families
from nearlift.loop.search_problem import Options


def test_where_the_order_is_unknown_nothing_varies_along_it():
    data = dataclasses.replace(campaign(3, visits=5), ordered=False)
    known = derive(data, np.ones(data.n)).covariates
    for name in (
        "run_order",
        "elapsed_hat",
        "previous_lift_N",
        "previous_throttle",
        "previous_z_hat",
        "order_in_visit",
    ):
        assert np.ptp(known[name]) == 0, name
    assert "start_s" not in known
    assert {f.covariate for f in families(derive(data, np.ones(data.n)))}.isdisjoint(
        {"start", "order_in_visit", "previous_throttle", "previous_distance"}
    )


def test_a_drift_is_seen_in_run_order_and_untestable_without_one():
    base = catalogue.model("sanchez_cuevas")
    data = campaign(5, visits=8)
    data = dataclasses.replace(data, lift_N=data.lift_N * (1 + 0.02 * np.linspace(-1, 1, data.n)))
    assert findings(data, base, confirm=False)["structure"][0]["covariate"] in (
        "start",
        "session",
    )
    bare = {k: v for k, v in data.covariates.items() if k == "approach"}
    found = findings(dataclasses.replace(data, ordered=False, covariates=bare), base, confirm=False)
    assert "start" not in {s["covariate"] for s in found["structure"]}
    assert {"gain_drift", "cell_creep", "warm_up"} <= {u["effect"] for u in found["untestable"]}


def test_at_a_single_throttle_what_l_inf_absorbs_is_no_family():
    """Its rounding errors would be: at one throttle the zero of the cell, in first order,
    is L_inf.
    """
    data = campaign(
        6,
        boundary="ceiling",
        ratio=hsiao,
        stations=(0.15, 0.2, 0.3, 0.5, 0.8, 1.5, 3.0, 10.0),
        visits=12,
    )
    one = data.take(data.throttle == 0.5)
    stage = set_up(one, catalogue.model("hsiao_chirarattananon"), (), Options())[0]
    assert "zero" not in {f.name for f in families(stage.data)}
    # a null of 96 trials: significant at 5 % once in twenty, at one in ten thousand never
    assert stage.nothing_added[0].p_value > 1e-3
