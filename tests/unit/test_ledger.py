"""quality.json: every trial accounted for, and what the exclusions are worth."""

from __future__ import annotations

import re

import pytest

from nearlift.products import FIT, QUALITY, RESULTS, TRIALS
from nearlift.report.page.render import page
from nearlift.run import store
from nearlift.stages import ledger, report


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
    outcome = ledger.run(job)
    return job, outcome, store.read_json(job.processed / QUALITY.file)


def test_every_trial_stands_in_it_and_the_counts_add_up(made):
    job, outcome, content = made
    table = job.read(TRIALS)
    assert outcome.rejected == ()
    assert content["schema"] == "nearlift.quality/1"
    assert [t["trial"] for t in content["trials"]] == table["trial"].tolist()
    assert content["counts"] == {
        "scheduled": 112,
        "recorded": 112,
        "accepted": 109,
        "remarked": 1,
        "fitted": 108,
    }
    assert content["codes"]["SATURATED"]["trials"] == 2
    assert content["samples"]["averaged"] == int(table["n"].sum())


def test_a_trial_says_why_it_is_where_it_is(made):
    entries = {t["trial"]: t for t in made[2]["trials"]}
    assert (entries["t0000"]["accepted"], entries["t0000"]["figures"]) == (
        True,
        ["fig2", "residuals"],
    )
    assert (entries["t0003"]["accepted"], entries["t0003"]["figures"]) == (False, [])
    assert entries["t0003"]["why"].startswith("SATURATED (")
    assert (
        entries["t0005"]["accepted"],
        entries["t0005"]["fitted"],
        entries["t0005"]["figures"],
    ) == (True, False, ["fig2"])
    assert entries["t0005"]["why"].startswith("z_hat = 0.1 is outside")
    assert entries["t0004"]["lift_N"] is None


def test_what_an_exclusion_is_worth_is_a_fit_with_it_put_back(made, make_job):
    job, _, content = made
    back = content["put_back"]["ground"]
    kept = store.read_json(job.processed / FIT.file)["boundaries"]["ground"]["sanchez_cuevas"]
    assert back["parameter"] == "K_b"
    assert back["accepted"]["value"] == pytest.approx(kept["parameters"]["K_b"]["value"], rel=1e-6)
    assert back["excluded"] == 3
    assert back["cannot_be_put_back"] == {"t0004": "it has no mean lift"}
    assert {k: v["trials"] for k, v in back["codes"].items()} == {"SATURATED": 2, "STUCK": 1}
    assert back["trials"]["t0006"]["value"] == pytest.approx(back["codes"]["STUCK"]["value"])
    assert back["all"]["value"] == pytest.approx(back["codes"]["SATURATED"]["value"])
    for entry in (back["all"], *back["trials"].values()):
        assert entry["change"] == pytest.approx(entry["value"] - back["accepted"]["value"])
        assert abs(entry["change_in_u"]) > 0
    assert abs(back["trials"]["t0006"]["change"]) > abs(back["trials"]["t0003"]["change"]), (
        "half too much lift pulls more than a tenth"
    )


def test_a_trial_below_the_model_cannot_be_put_back(make_job):
    def spoil(table):
        table["z_hat"][3] = 0.1
        table["quality"][3] = "DRIFT"
        table["quality"][11] = ""

    job = make_job(boundaries=("ground",), repeats=4, edit=spoil)
    ledger.run(job)
    back = store.read_json(job.processed / QUALITY.file)["put_back"]["ground"]
    assert back["cannot_be_put_back"] == {"t0003": "the model has no value at z_hat = 0.1"}
    assert back["all"] is None


def test_the_page_shows_it_and_escapes_what_it_shows(make_job):
    def spoil(table):
        table["trial"][3] = "<script>alert(1)</script>"
        table["source"] = table["trial"].copy()
        table["samples"] = table["n"] + 100
        table["completeness"] = table["trial"].copy()
        table["completeness"][:] = "complete"

    job = make_job(boundaries=("ground",), repeats=4, edit=spoil, simulated=True)
    ledger.run(job)
    text = page(report.gather(job), []).decode()
    assert "From raw byte to figure" in text
    # a page without charts has their empty list and its own script
    assert text.count("<script") == 2
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in text
    assert "put back one at a time" in text


def test_a_trial_that_stands_out_stays_in_and_is_named_with_what_it_is_worth(make_job):
    """t0050 lifts half too much, and nobody has marked it: fit.json, ledger and page name it, with
    the coefficient without it.
    """

    def spoil(table):
        table["lift_N"][50] *= 1.5

    job = make_job(boundaries=("ground",), repeats=4, edit=spoil, simulated=True)
    ledger.run(job)
    fitted = store.read_json(job.processed / FIT.file)
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
        store.read_json(job.processed / RESULTS.file)["boundaries"]["ground"]["coefficients"][
            "K_b"
        ]["influence"]["trial"]["id"]
        == "t0050"
    )
    quality = store.read_json(job.processed / QUALITY.file)
    assert next(t for t in quality["trials"] if t["trial"] == "t0050")["fitted"]
    (left_out,) = quality["put_back"]["ground"]["left_out"]
    assert left_out["value"] == suspect["without"]["value"]
    assert left_out["change_in_u"] == pytest.approx(suspect["shift"] / parameter["u"])
    text = page(report.gather(job), []).decode()
    told = "t0050 stands beyond what noise allows: without it the base fit’s K_b is "
    assert told in re.sub(r"<i>(\w)</i><sub>(\w)</sub>", r"\1_\2", text)
    assert "t0050 left out" in text
