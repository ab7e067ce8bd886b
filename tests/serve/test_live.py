"""Facts of the page of a campaign that is being recorded."""

from __future__ import annotations

import json
import os
import shutil

import pandas as pd
import pytest

from nearlift.rounding import plus_minus
from nearlift.serve import live
from nearlift.serve.pages import respond
from nearlift.serve.workspace import place


@pytest.fixture
def copy(workspace, tmp_path):
    for folder in ("processed", "reports"):
        shutil.copytree(workspace / folder / "small", tmp_path / folder / "small", symlinks=True)
    return tmp_path


def test_trials_are_those_that_have_landed_the_newest_first(workspace):
    found = live.facts(place(workspace, "small"))
    trials = pd.read_parquet(workspace / "processed/small/trials.parquet")
    landed = trials[trials["n"] > 0]
    assert (found["landed"], found["scheduled"]) == (84, 112)
    assert [t["trial"] for t in found["newest"]] == landed["trial"].tolist()[::-1][: live.NEWEST]
    last = landed.iloc[-1]
    assert found["newest"][0]["lift"] == plus_minus(1e3 * last.lift_N, 1e3 * last.u_lift_N)


def test_a_glitch_in_the_tare_is_listed_with_its_meaning(workspace):
    found = dict(live.facts(place(workspace, "small"))["remarks"])
    assert any("TARE: the force changes within the tare" in text for text in found.values())


def test_cards_quote_results_json_and_say_what_the_interim_analysis_needs(workspace):
    (card,) = live.verdicts(place(workspace, "small"))
    quoted = json.loads((workspace / "processed/small/results.json").read_text())["boundaries"]
    k = quoted["ground"]["coefficients"]["K_b"]
    assert card.coefficients[0].startswith(f"K_b = {plus_minus(k['value'], k['u'])} (90 %: ")
    assert card.tone == live.TONES[quoted["ground"]["verdict"]]
    assert any("of 112 trials; claims need p <" in note for note in card.notes)


def test_the_next_visits_are_those_of_the_last_round(workspace, copy):
    text = respond(workspace, "/campaign/small", {}).body.decode()
    latest = json.loads((workspace / "processed/small/watch.json").read_text())
    assert latest["good"] == 83
    assert latest["next"][0] in text
    # a later run without --watch knows of no next visits
    os.utime(copy / "processed/small/watch.json", ns=(0, 0))
    assert "Next visits" not in respond(copy, "/campaign/small", {}).body.decode()


def test_a_refusal_of_the_last_round_is_shown(copy):
    file = copy / "processed/small/watch.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | {"refused": "start has no unit"}))
    assert "start has no unit" in respond(copy, "/campaign/small", {}).body.decode()


def test_a_state_that_was_seen_is_not_sent_again(copy):
    seen = live.stamp(place(copy, "small"))
    assert f'data-stamp="{seen}"' in respond(copy, "/campaign/small", {}).body.decode()
    assert respond(copy, "/campaign/small", {"seen": seen}).status == 204
    (copy / "reports/small/fig2.png").write_bytes(b"another")
    assert respond(copy, "/campaign/small", {"seen": seen}).status == 200


def test_before_the_first_fit_nothing_is_claimed(copy):
    for folder, name in (("processed", "results.json"), ("reports", "fig2.png")):
        (copy / folder / "small" / name).unlink()
    found = live.facts(place(copy, "small"))
    assert (found["verdicts"], found["refusal"]) == ([], None)
    assert list(found["figures"]) == ["residuals"]
    assert "Not fitted yet" in respond(copy, "/campaign/small", {}).body.decode()
