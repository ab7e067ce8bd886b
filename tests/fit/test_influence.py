"""Trials and visits that move the headline by more than its uncertainty are named, with what it is
without them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.unit.simulated import campaign

from nearlift import catalogue
from nearlift.fit import influence, least_squares
from nearlift.likelihood.budget import Component

MODEL = catalogue.model("sanchez_cuevas")
PARTS = (
    Component(name="datum", on="height", standard=1e-4, distribution="normal", scope="boundary"),
)
DATA = campaign(3, visits=4)
#: What lies far away decides L_inf, and through it K_b.
FAR, NEXT = np.flatnonzero(DATA.z_hat == DATA.z_hat.max())[[0, 5]]


def changed(factor, trials):
    return replace(
        DATA, lift_N=np.where(np.isin(np.arange(DATA.n), trials), factor * DATA.lift_N, DATA.lift_N)
    )


@pytest.fixture(scope="module")
def clean():
    return least_squares.fit(MODEL, DATA, PARTS)


def test_an_ordinary_campaign_names_nobody_and_costs_no_fit(clean, monkeypatch):
    monkeypatch.setattr(influence, "fit", None)
    found = influence.search(clean, PARTS)
    assert found.suspects == ()
    assert found.why_not == ""


def test_an_outlier_is_named_with_the_value_that_it_spoilt(clean):
    spoilt = least_squares.fit(MODEL, changed(10.0, [FAR]), PARTS)
    found = influence.search(spoilt, PARTS, {str(DATA.trial[FAR])})
    (suspect,) = found.suspects
    own = clean.estimates["K_b"]
    assert (suspect.kind, suspect.id, suspect.outlying) == ("trial", DATA.trial[FAR], True)
    assert suspect.without.value == pytest.approx(own.value, abs=0.5 * own.u)
    assert suspect.without.u == pytest.approx(own.u, rel=0.2)
    assert suspect.shift == pytest.approx(suspect.without.value - spoilt.theta[0])
    assert found.without_all is None


def test_an_outlier_near_the_pole_is_named_and_the_fit_stands():
    """Taken for scatter of heights, it would put stops where the model has no value."""
    stations = np.array([20.0, 24, 30, 40, 55, 80, 130, 300]) / 23
    data = campaign(3, stations=stations, visits=5, relative=0.005, height=3e-5)
    near = np.flatnonzero(data.z_hat == stations[1])[2]
    spoilt = least_squares.fit(
        MODEL,
        replace(data, lift_N=np.where(np.arange(data.n) == near, 3.0, 1.0) * data.lift_N),
        PARTS,
    )
    (suspect,) = influence.search(spoilt, PARTS, {str(data.trial[near])}).suspects
    # pulled in where noise is estimated, it does not make stops scatter
    assert spoilt.noise.height_m < 3e-4
    assert suspect.id == data.trial[near]
    assert suspect.without.value == pytest.approx(2.0, abs=3 * suspect.without.u)
    assert abs(spoilt.estimates["K_b"].value - suspect.without.value) > 3 * suspect.without.u


def test_a_trial_that_moves_the_headline_is_named_though_no_screen_marked_it():
    spoilt = least_squares.fit(MODEL, changed(1.1, [FAR]), PARTS)
    (suspect,) = influence.search(spoilt, PARTS).suspects
    assert (suspect.id, suspect.outlying) == (DATA.trial[FAR], False)


def test_two_that_hide_each_other_are_both_named():
    """Each spoils the scatter that the other is judged by."""
    spoilt = least_squares.fit(MODEL, changed(1.2, [FAR, NEXT]), PARTS)
    found = influence.search(spoilt, PARTS)
    assert {s.id for s in found.suspects} == {DATA.trial[FAR], DATA.trial[NEXT]}
    assert found.without_all.value == pytest.approx(2.0, abs=0.1)


def test_a_pair_of_which_neither_moves_the_headline_alone_is_named_once_they_stand_far_off(clean):
    """Two far trials 6 % too high; in a campaign without a glitch the same two are named
    by nobody.
    """
    ids = {str(t) for t in DATA.trial[[FAR, NEXT]]}
    fitted = least_squares.fit(MODEL, changed(1.06, [FAR, NEXT]), PARTS)
    named = {s.id for s in influence.search(fitted, PARTS, odd=ids).suspects}
    assert named == ids
    assert influence.search(clean, PARTS, odd=ids).suspects == ()


def test_a_visit_that_moves_the_headline_is_named_with_its_trials():
    stop = DATA.visit[FAR]
    members = np.flatnonzero(DATA.visit == stop)
    spoilt = least_squares.fit(MODEL, changed(1.04, members), PARTS)
    visits = [s for s in influence.search(spoilt, PARTS).suspects if s.kind == "visit"]
    assert [s.id for s in visits] == [str(stop)]
    assert visits[0].trials == tuple(DATA.trial[members])


def test_exact_numbers_and_a_model_without_coefficients_are_not_screened():
    exact = campaign(3, visits=4, relative=0.0, force=0.0, height=0.0)
    exact = replace(exact, u_lift_N=np.zeros(exact.n))
    assert "repeat exactly" in influence.search(least_squares.fit(MODEL, exact), ()).why_not
    fixed = least_squares.fit(catalogue.model("cheeseman_bennett_fixed"), DATA)
    assert influence.search(fixed, ()).why_not.endswith("has no free coefficient")
