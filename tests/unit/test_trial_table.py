"""The report's trial table: every trial accounted for, and the influence of each exclusion."""

from __future__ import annotations

import math
import re

import pytest

from nearlift.report.page.render import page
from nearlift.run import tables
from nearlift.stages.fit import FIT, RESULTS
from nearlift.stages.gathering import gather
from nearlift.stages.ingest import TRIALS
from nearlift.stages.trial_table import trial_table


@pytest.fixture(scope="module")
def made(make_job):
    """t0003 saturated at a tenth too much, t0004 lost, t0005 below the model's range."""

    def spoil(table):
        table["lift_N"][3] *= 1.1
        table["quality"][4] = "MISSING"
        table["lift_N"][4] = float("nan")
        table["z_hat"][5] = 0.1
        table["lift_N"][6] *= 1.5
        table["quality"][6] = "SATURATED STUCK"

    job = make_job(boundaries=("ground",), repeats=4, edit=spoil, simulated=True)
    return job, trial_table(job)


def test_every_trial_stands_in_it_and_the_counts_add_up(made):
    job, table = made
    trials = job.read(TRIALS)
    assert [t.trial for t in table.trials] == trials["trial"].tolist()
    counts = table.counts
    assert (counts.scheduled, counts.recorded, counts.accepted) == (112, 112, 109)
    assert (counts.remarked, counts.fitted) == (1, 108)
    assert table.averaged == int(trials["n"].sum())


def test_a_trial_says_where_it_is_drawn(made):
    entries = {t.trial: t for t in made[1].trials}
    assert entries["t0000"].figures == ("fig2", "residuals")
    assert entries["t0003"].figures == ()
    assert entries["t0005"].figures == ("fig2",)
    assert math.isnan(entries["t0004"].lift_N)


def test_the_influence_of_an_exclusion_is_a_fit_with_it_put_back(made, make_job):
    job, table = made
    back = table.put_back["ground"]
    assert back.parameter == "K_b"
    assert back.excluded == 3
    assert back.cannot_be_put_back == {"t0004": "it has no mean lift"}
    assert {k: v.trials for k, v in back.codes.items()} == {"SATURATED": 2, "STUCK": 1}
    assert back.trials["t0006"].change == pytest.approx(back.codes["STUCK"].change)
    assert back.all.change == pytest.approx(back.codes["SATURATED"].change)
    kept = tables.read_json(job.processed / FIT.file)["boundaries"]["ground"]["sanchez_cuevas"]
    u = kept["parameters"]["K_b"]["u"]
    for refit in (back.all, *back.trials.values()):
        assert refit.change_in_u == pytest.approx(refit.change / u, rel=1e-6)
        assert abs(refit.change_in_u) > 0
    assert abs(back.trials["t0006"].change) > abs(back.trials["t0003"].change), (
        "half too much lift pulls more than a tenth"
    )


def test_a_trial_below_the_model_cannot_be_put_back(make_job):
    def spoil(table):
        table["z_hat"][3] = 0.1
        table["quality"][3] = "DRIFT"
        table["quality"][11] = ""

    back = trial_table(make_job(boundaries=("ground",), repeats=4, edit=spoil)).put_back["ground"]
    assert back.cannot_be_put_back == {"t0003": "the model has no value at z_hat = 0.1"}
    assert back.all is None


def test_the_page_shows_it_and_escapes_what_it_shows(make_job):
    def spoil(table):
        table["trial"][3] = "<script>alert(1)</script>"
        table["source"] = table["trial"].copy()
        table["samples"] = table["n"] + 100
        table["completeness"] = table["trial"].copy()
        table["completeness"][:] = "complete"

    job = make_job(boundaries=("ground",), repeats=4, edit=spoil, simulated=True)
    text = page(gather(job), []).decode()
    assert "Trial table and influence" in text
    # a page without charts has their empty list and its own script
    assert text.count("<script") == 2
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text
    assert "put back one at a time" in text


def test_a_trial_that_stands_out_stays_in_and_is_named_with_what_it_is_worth(make_job):
    """t0050 lifts half too much, and nobody has marked it: fit.json, table and page name it, with
    the coefficient without it.
    """

    def spoil(table):
        table["lift_N"][50] *= 1.5

    job = make_job(boundaries=("ground",), repeats=4, edit=spoil, simulated=True)
    fitted = tables.read_json(job.processed / FIT.file)
    entry, parameter = (
        fitted["influence"]["ground"],
        fitted["boundaries"]["ground"]["sanchez_cuevas"]["parameters"]["K_b"],
    )
    (suspect,) = entry["suspects"]
    assert (suspect["id"], suspect["outlying"]) == ("t0050", True)
    # the scatter pulls it in, the fit does not: what it moves is the value
    assert abs(suspect["shift"]) > 2 * suspect["without"]["u"]
    assert suspect["shift"] == pytest.approx(suspect["without"]["value"] - parameter["value"])
    assert (
        tables.read_json(job.processed / RESULTS.file)["boundaries"]["ground"]["coefficients"][
            "K_b"
        ]["influence"]["trial"]["id"]
        == "t0050"
    )
    table = trial_table(job)
    assert next(t for t in table.trials if t.trial == "t0050").figures == ("fig2", "residuals")
    assert table.put_back["ground"].left_out["t0050"].change == suspect["shift"]
    in_u = table.put_back["ground"].left_out["t0050"].change_in_u
    assert in_u == pytest.approx(suspect["shift"] / parameter["u"])
    text = page(gather(job), []).decode()
    told = "t0050 is an outlier: without it the base fit’s K_b is "
    assert told in re.sub(r"<i>(\w)</i><sub>(\w)</sub>", r"\1_\2", text)
    assert "t0050 left out" in text
