"""What the verdict says against itself comes from the products, and is silent where they are."""

from __future__ import annotations

import copy
import dataclasses
import re

import numpy as np
import pytest

from nearlift.report import words
from nearlift.report.chapters import doubts, verdict
from nearlift.stages.gathering import gather
from nearlift.stages.ingest import TRIALS

from . import quoted
from .quoted import DIAGNOSED


@pytest.fixture(scope="module")
def evidence(small_job):
    return gather(small_job)


def said(evidence, change=None):
    content = copy.deepcopy(DIAGNOSED)
    if change is not None:
        change(content["boundaries"]["ground"])
    return words.doubts(quoted.known(evidence, content))


def test_rivals_unseen_effects_and_what_was_not_logged_are_held_against_the_headline(evidence):
    told = said(evidence)
    texts = [d.text for d in told if "ground" in d.boundaries]
    assert "This design cannot distinguish supply sag (K_b = 2) from session gain." in texts
    assert any(t == "Untestable with what was logged: air density." for t in texts)


def test_a_pair_of_effects_is_a_rival_like_others(evidence):
    def change(ground):
        ground["effects"][0]["rivals"] = ["session_gain", "tilt"]
        ground["explanations"] = [["supply_sag"], ["session_gain"], ["supply_sag", "tilt"]]

    text = (
        "This design cannot distinguish supply sag (K_b = 2) from session gain or supply sag with"
        " tilt."
    )
    assert text in [d.text for d in said(evidence, change)]


def test_other_answers_stand_with_what_it_takes_to_believe_them(evidence):
    known = quoted.known(evidence, DIAGNOSED)
    [card, *_] = verdict.facts(known)["cards"]
    told = {
        condition: re.sub("<[^>]+>", "", interval)
        for _, condition, _, interval in doubts.conditions(known, "ground")
    }
    assert told == {
        "supply_sag alone, exactly in its stated form": "1.90 to 2.10",
        "base model without any effect": "1.10 to 1.30",
        "every undetected effect at its plausible size": "1.5 to 2.5",
    }
    assert (card["headline"].value.text, card["headline"].u.text) == ("2.00", "0.12")


def test_structure_without_a_name_is_said(evidence):
    told = said(evidence, lambda f: f.update(verdict="unexplained", effects=[]))
    assert any(d.text.startswith("Residuals vary with supply voltage, unexplained") for d in told)


def test_structure_along_several_covariates_is_said_to_be(evidence):
    def phrase(*covariates):
        tests = [{"covariate": c, "p_value": 1e-9, "significant": True} for c in covariates]
        unnamed = {"verdict": "unexplained", "effects": [], "structure": tests}
        texts = [d.text for d in said(evidence, lambda f: f.update(unnamed))]
        (told,) = (t for t in texts if t.startswith("Residuals vary with"))
        return told.removeprefix("Residuals vary with ").partition(", unexplained")[0]

    assert phrase("supply") == "supply voltage"
    assert phrase("supply", "tilt") == "supply voltage and tilt"
    assert phrase("supply", "tilt", "session") == "supply voltage, tilt and others"


@pytest.mark.parametrize(("bias", "grave"), [(3.0, True), (0.5, False)])
def test_the_effect_that_hides_best_is_a_doubt_where_it_could_do_more_than_u(evidence, bias, grave):
    hidden = {"effect": "tilt", "absorbed_by": "K_b", "bias_at_detection_limit": bias, "u": 0.2}
    lesser = hidden | {"effect": "reynolds", "bias_at_detection_limit": 0.8 * bias}
    texts = [d.text for d in said(evidence, lambda f: f.update(silent=[lesser, hidden]))]
    told = [t for t in texts if "undetected tilt" in t]
    assert told == ["Not in the interval: undetected tilt could shift K_b by up to 0.6."] * grave


def test_a_campaign_that_grows_is_said(evidence):
    told = said(evidence, lambda f: f.update(look={"text": "a look at 240 of 480 trials"}))
    assert any(
        d.text == "The campaign is still growing: a look at 240 of 480 trials."
        and d.boundaries == ("ground",)
        for d in told
    )


def test_rejected_trials_are_counted_and_silent_where_there_are_none(evidence):
    trials = evidence.table(TRIALS)
    assert any(
        d.text.startswith(f"1 of {len(trials['trial'])} trials were left out")
        for d in words.doubts(evidence)
    )
    clean = {**trials, "quality": np.full(len(trials["trial"]), "", dtype=object)}
    assert not any(
        "rejected" in d.text
        for d in words.doubts(
            dataclasses.replace(evidence, tables={**evidence.tables, TRIALS.file: clean})
        )
    )


def test_a_manifest_without_shared_errors_is_a_doubt(evidence):
    bare = dataclasses.replace(
        evidence, campaign=evidence.campaign.model_copy(update={"uncertainty": ()})
    )
    assert any("states no uncertainty shared by trials" in d.text for d in words.doubts(bare))
    assert not any("states no uncertainty" in d.text for d in words.doubts(evidence))
