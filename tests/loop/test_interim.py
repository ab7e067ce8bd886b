"""Looks at a campaign that grows: the boundary against printed tables, who is still to come, and
what is claimed when.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm
from tests.unit.simulated import GROUND, campaign, problem

from nearlift.loop import structure
from nearlift.loop.diagnose import diagnose
from nearlift.loop.interim import INTERIM_SHARE, InterimLook, nominal_level
from nearlift.loop.search_problem import Options
from nearlift.observed import interim_progress


# Jennison and Turnbull, Group Sequential Methods (2000), table 2.3: constants of O'Brien and
# Fleming's test, two-sided, 5 % in all
@pytest.mark.parametrize(("looks", "constant"), [(2, 1.977), (5, 2.040), (20, 2.126)])
def test_the_boundary_is_obrien_and_flemings(looks, constant):
    rng, paths = np.random.default_rng(looks), 40_000
    fractions = np.arange(1, looks + 1) / looks
    sums = np.cumsum(rng.standard_normal((paths, looks)) / np.sqrt(looks), axis=1)
    p = 2 * norm.sf(np.abs(sums) / np.sqrt(fractions))
    levels = [nominal_level(2 * norm.sf(constant), f) for f in fractions]
    claimed = np.mean(np.any(p < levels, axis=1))
    # binomial, 4 sd
    assert claimed == pytest.approx(0.05, abs=4 * np.sqrt(0.05 * 0.95 / paths))


def test_looking_costs_two_tenths_of_a_per_cent_at_most():
    """100 looks at noise, then the end at the full rate; by reflection the looks alone claim in at
    most twice their share.
    """
    rng, paths, looks, rate = np.random.default_rng(0), 20_000, 100, 0.05
    sums = np.cumsum(rng.standard_normal((paths, looks)) / np.sqrt(looks), axis=1)
    p = 2 * norm.sf(np.abs(sums) / np.sqrt(np.arange(1, looks + 1) / looks))
    levels = [InterimLook(trials=k, scheduled=looks).level(rate) for k in range(1, looks)]
    looked, last = np.any(p[:, :-1] < levels, axis=1), p[:, -1] < rate
    twice = 2 * INTERIM_SHARE * rate
    assert looked.mean() < twice + 4 * np.sqrt(twice / paths)
    assert np.mean(looked & ~last) < 0.002


def test_a_campaign_hardly_begun_claims_nothing_and_one_nearly_done_needs_the_looks_own_share():
    assert InterimLook(trials=1, scheduled=10_000).level(0.05) == 0.0
    nearly = InterimLook(trials=9_999, scheduled=10_000).level(0.05)
    assert nearly == pytest.approx(INTERIM_SHARE * 0.05, rel=1e-3)


#: Good, missing, pending, excluded without a record, bad.
QUALITY = {"g": "", "m": "MISSING", "p": "PENDING", "x": "MISSING EXCLUDED", "b": "SATURATED"}


@pytest.mark.parametrize(
    ("marks", "options", "expected"),
    [
        ("gggg", {}, None),
        ("gmbg", {}, None),  # lost on the way, not to come
        ("gmgmm", {}, (3, 5)),
        ("ggp", {}, (2, 3)),
        ("ggxx", {}, None),
        ("ggxm", {}, (3, 4)),
        ("gmgg", {"order": "unknown"}, (3, 4)),
        ("gg", {"planned": 6}, (2, 6)),  # the schedule grows with the records
        ("ggmm", {"planned": 2}, None),  # nothing more will come
        ("ggmm", {"planned": 3}, (2, 3)),
        ("ggmm", {"boundary": ["ground", "none", "ceiling", "ceiling"]}, None),
        ("ggmm", {"boundary": ["ground", "none", "ceiling", "none"]}, (2, 3)),
    ],
)
def test_who_is_still_to_come(marks, options, expected):
    given = {"order": "run", "planned": None, "boundary": ["ground"] * len(marks)} | options
    table = {
        "quality": np.array([QUALITY[mark] for mark in marks], dtype=object),
        "boundary": np.array(given["boundary"], dtype=object),
    }
    campaign = SimpleNamespace(
        trials=SimpleNamespace(order=given["order"]),
        diagnose=SimpleNamespace(planned_trials=given["planned"]),
    )
    look = interim_progress(table, campaign, "ground")
    assert (look and (look.trials, look.scheduled)) == expected


def test_far_out_the_tail_goes_on_as_that_of_the_smallest_of_many():
    """30 independent tests: P(the smallest p < x) = 1 - (1 - x)^30."""
    rng = np.random.default_rng(1)
    null = structure.Null(np.sort(np.log10(rng.uniform(size=(structure.DRAWS, 30)).min(axis=1))))
    for rate in (1e-3, 1e-6, 1e-12):
        exact = np.log10(-np.expm1(np.log1p(-rate) / 30))
        # Hill's estimator from so many draws, and the quantile where it begins
        draws = structure.TAIL * structure.DRAWS
        sd = np.hypot(np.log(structure.TAIL / rate), 1) / np.sqrt(draws) / np.log(10)
        assert null.threshold(rate) == pytest.approx(exact, abs=4 * sd)
        assert null.p_value(null.threshold(rate)) == pytest.approx(rate)
    assert null.threshold(0.05) == np.quantile(null.least, 0.05)
    assert 0 < null.p_value(-1e6) < null.p_value(-300.0)
    p = [null.p_value(x) for x in np.linspace(-8, 0, 400)]
    assert np.all(np.diff(p) >= -2 / structure.DRAWS)


@pytest.fixture(scope="module")
def sagging():
    data = campaign(3, visits=5, gain=lambda c: (c["supply_V"] / 3.8) ** 0.15)
    return data, problem(data).nothing_added[0]


def looked_at(data, scheduled):
    """The diagnosis of trials of which so many are scheduled."""
    look = InterimLook(trials=data.n, scheduled=scheduled) if scheduled > data.n else None
    return diagnose(data, GROUND, (), Options(), confirm=False, look=look)


def content_of(data, scheduled):
    return looked_at(data, scheduled).findings.content


def test_the_same_trials_claim_by_how_many_are_still_to_come(sagging):
    data, first = sagging
    level = InterimLook(trials=1, scheduled=2).level(0.05)
    assert first.p_value < level, "the effect is meant to be plain at half time"
    done, half = content_of(data, data.n), looked_at(data, 2 * data.n)
    assert (done["verdict"], "look" in done) == ("effect", False)
    content = half.findings.content
    assert (content["verdict"], half.quoted.verdict) == ("effect", "effect")
    assert content["effects"] == done["effects"]
    assert content["look"]["p_value_needed"] == level
    text = f"a look at {data.n} of {2 * data.n} trials; claims need p < 7e-05"
    assert content["look"]["text"].startswith(text)
    early = looked_at(data, 1000 * data.n)
    content = early.findings.content
    assert {content["verdict"], early.quoted.verdict} == {"adequate"}
    assert content["effects"] == []
    assert not any(line["significant"] for line in content["structure"])
    before = content["coefficients"]["before"]["K_b"]["value"]
    assert early.quoted.coefficients["K_b"].value == pytest.approx(before)


def test_few_visits_pay_too():
    stations = (1.14, 1.5, 2.2, 4.0, 9.0, 11.5)
    data = campaign(3, stations=stations, visits=2, gain=lambda c: c["supply_V"] / 3.8)
    done, early = (content_of(data, n)["verdict"] for n in (data.n, 1000 * data.n))
    assert done != "adequate" == early


def test_a_growing_null_claims_nothing():
    """All looks together may claim in 1 % of campaigns."""
    data = campaign(900, visits=5)
    parts = [data.take(np.arange(n)) for n in range(80, data.n, 40)]
    assert {content_of(part, data.n)["verdict"] for part in parts} == {"adequate"}


def test_heating_within_the_record_pays_too():
    data = campaign(1, visits=8)
    drift = np.random.default_rng(2).normal(1e-3, 2e-3, data.visit.max() + 1)[data.visit]
    data = replace(data, covariates={**data.covariates, "drift_hat": drift})
    done, early = (content_of(data, n)["within_trial"] for n in (data.n, 1000 * data.n))
    assert (done["significant"], early["significant"]) == (True, False)
    assert done["p_value"] == early["p_value"]
