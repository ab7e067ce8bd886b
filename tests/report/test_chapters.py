"""Chapters follow the products: every number is that of its place, and doubts say what is wrong."""

from __future__ import annotations

import copy
import dataclasses
import html
import re

import numpy as np
import pytest
from tests.unit import quoted, small_run
from tests.unit.elements import Elements, follow

from nearlift.report import words
from nearlift.report.chapters import models, numbers, verdict
from nearlift.report.number import Place
from nearlift.stages.fit import FIT, RESULTS
from nearlift.stages.ingest import TRIALS


def changed(evidence, change=None):
    """The small campaign, diagnosed, with changed findings."""
    content = copy.deepcopy(quoted.DIAGNOSED)
    if change is not None:
        change(content["boundaries"]["ground"])
    return quoted.known(evidence, content)


def text_of(page):
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", " ", page)))


def said(evidence, change=None, **more):
    """The words of the chapter on the diagnosis, with changed or more findings; every number is that
    of its place.
    """
    known = changed(evidence, change or (lambda ground: ground.update(more)))
    chapter = small_run.chapter(known, "diagnosis")
    chapter = chapter[chapter.index('<section id="diagnosis"') :].partition("</section>")[0]
    for attributes, _ in Elements(chapter).numbers:
        file, _, pointer = attributes["data-source"].partition("#")
        if not (attributes.get("data-how") or "").startswith("less"):
            assert float(attributes["value"]) == follow(known.documents[file], pointer)
    return text_of(chapter)


def test_an_effect_has_its_size_its_rivals_and_the_error(evidence):
    text = said(evidence)
    assert "Supply sag explains the residuals." in text
    assert "supply sag p = 2.10 1.90 to 2.30 session gain" in text
    assert "1.22 % of lift on visits left out of the fit, 0.43 % with the effect" in text
    assert "supply voltage < 10⁻¹² no tilt 0.03 no" in text
    assert "Untestable here (1) effect log next time air density temperature" in text


def test_the_unexplained_has_its_covariate_and_shares_but_no_effect(evidence):
    partial = [{"name": "gain_drift", "share": 0.31}]
    structure = [{"covariate": "start", "p_value": 3.7e-5, "significant": True}]
    carried = {**quoted.DIAGNOSED["boundaries"]["ground"]["coefficients"]}
    carried["carried"] = ["distance", "start"]
    found = {"verdict": "unexplained", "effects": [], "partial": partial, "structure": structure}
    text = said(evidence, coefficients=carried, **found)
    assert "time 3.7 × 10⁻⁵ yes" in text
    assert "Partial explanations (1) effect % of what exceeds the noise gain drift 31" in text
    assert "The intervals include an unexplained dependence on distance and time." in text
    assert "Identified effects" not in text


def test_a_look_before_the_end_and_drift_within_records_are_said(evidence):
    look = {"text": "a look at 240 of 480 trials; claims need p < 7e-05"}
    change = {"value": -0.012, "lo90": -0.014, "hi90": -0.01}
    heating = {"p_value": 2e-5, "significant": True, "candidates": ["motor_heating"]}
    text = said(evidence, look=look, within_trial={"change_over_record": change, **heating})
    assert "a look at 240 of 480 trials; claims need p < 7e-05." in text
    assert "lift changes by −1.20 % (90 %: −1.40 to −1.00), as by motor heating." in text
    assert "time within a record 2 × 10⁻⁵ yes" in text


def test_a_size_at_its_bound_is_marked(evidence):
    for value in (-0.1, -0.05):
        size = {"z_scale": {"value": value, "lo90": -0.15, "hi90": -0.05}}
        text = said(evidence, effects=[{"name": "height_scale", "rivals": [], "parameters": size}])
        assert ("at its bound" in text) == (value == -0.1)


def test_candidates_folds_and_proposals(evidence):
    tried = {"p_value": 1.0, "accepted": True, "left_in": None}
    sag = {**tried, "name": "supply_sag", "gain": 900.0, "log_evidence": -10.0}
    other = {"name": "warm_up", "gain": 300.0, "log_evidence": -35.0}
    rejected = {**tried, **other, "accepted": False, "left_in": "supply"}

    def change(found, needed=0):
        found["rounds"][0]["candidates"] = [sag, rejected]
        found["error"]["chosen_in_folds"] = ["supply_sag", "warm_up", "supply_sag"]
        [proposal] = found["next_experiment"]
        proposal.update(trials=160, expected_evidence=25.2, trials_to_separate=needed)

    text = said(evidence, change)
    assert "gave the same answer in 2 of 3 folds" in text
    assert "( 160 trials, expected 2 ln B = 25 )." in text
    assert "supply sag (accepted) 900.0 0 nothing warm-up 300.0 50 supply voltage" in text
    # where it would take too many trials, it is not proposed
    assert "expected 2 ln B = 25" not in said(evidence, lambda found: change(found, 50_000))
    [ground, *_] = words.briefs(changed(evidence, lambda found: change(found, 50_000)))
    assert ground.next
    assert "50000" not in ground.next


def test_the_number_of_each_assumption(evidence):
    known = changed(evidence)
    [card, *_] = verdict.facts(known)["cards"]
    rows = numbers.conditions(known, "ground")
    assert {row[1]: text_of(row[3]).strip() for row in rows} == {
        "supply_sag alone, exactly in its stated form": "1.90 to 2.10",
        "base model without any effect": "1.10 to 1.30",
        "every undetected effect at its plausible size": "1.5 to 2.5",
    }
    assert (card["coefficients"][0].value.text, card["coefficients"][0].u.text) == ("2.00", "0.12")


def test_the_budget_has_the_quoted_coefficients_and_models_those_of_their_fits(evidence):
    after = {"value": 2.5, "lo90": 2.4, "hi90": 2.6}
    named = {"effects": [{"name": "supply_sag"}], "coefficients": {"after": {"K_b": after}}}
    own = evidence.base("ground")[1].parameters["K_b"].value
    for said, value, file in (("effect", own, FIT.file), ("adequate", 2.5, RESULTS.file)):
        known = quoted.known(evidence, {"boundaries": {"ground": {**named, "verdict": said}}})
        assert "Ground: K b = 2.50 ± 0.06" in text_of(numbers.budget(known))
        cell = rf'<data value="{value:.6g}[^"]*" data-source="{file}#'
        assert re.search(cell, models.facts(known))


def test_what_would_halve_an_uncertainty_is_said_unless_it_is_out_of_reach(evidence):
    text = text_of(numbers.limits(evidence))
    assert "Ground: what would reduce the uncertainty of the base fit" in text
    assert " times the trials, in the same design, would halve u" in text
    other, fit = quoted.fitted(evidence, "ground")
    for halving in fit["would_halve"].values():
        halving["repeats"] |= {"times": 1e5, "text": "100000 times the trials"}
    assert "100000 times" not in text_of(numbers.limits(other))


def test_few_degrees_of_freedom_are_not_rounded_away(evidence):
    content = {"a": {"dof": 0.53}, "b": {"dof": 12.34}, "c": {"dof": None}}
    known = dataclasses.replace(evidence, documents={FIT.file: content})
    assert [Place(known, FIT).degrees(k, "dof").text for k in "abc"] == ["0.5", "12", "∞"]


# doubts


def doubts(evidence, change=None):
    return words.doubts(changed(evidence, change))


@pytest.mark.parametrize(
    ("explanations", "others"),
    [
        ([], "session gain or tilt"),
        (
            [["supply_sag"], ["session_gain"], ["supply_sag", "tilt"]],
            "session gain or supply sag with tilt",
        ),
    ],
)
def test_rivals_and_what_was_not_logged_are_held_against_the_headline(
    evidence, explanations, others
):
    def change(ground):
        ground["effects"][0]["rivals"] = ["session_gain", "tilt"]
        ground["explanations"] = explanations

    texts = [text for text, of in doubts(evidence, change).items() if "ground" in of]
    assert f"This design cannot distinguish supply sag (K_b = 2) from {others}." in texts
    assert "Untestable with what was logged: air density." in texts


@pytest.mark.parametrize(
    ("covariates", "phrase"),
    [
        (["supply"], "supply voltage"),
        (["supply", "tilt"], "supply voltage and tilt"),
        (["supply", "tilt", "session"], "supply voltage, tilt and others"),
    ],
)
def test_structure_without_a_name_is_said(evidence, covariates, phrase):
    tests = [{"covariate": c, "p_value": 1e-9, "significant": True} for c in covariates]
    unnamed = {"verdict": "unexplained", "effects": [], "structure": tests}
    texts = [*doubts(evidence, lambda f: f.update(unnamed))]
    assert any(t.startswith(f"Residuals vary with {phrase}, unexplained") for t in texts)


@pytest.mark.parametrize(("bias", "is_doubt"), [(3.0, True), (0.5, False)])
def test_a_hidden_effect_is_a_doubt_where_it_could_do_more_than_u(evidence, bias, is_doubt):
    hidden = {"effect": "tilt", "absorbed_by": "K_b", "bias_at_detection_limit": bias, "u": 0.2}
    lesser = hidden | {"effect": "reynolds", "bias_at_detection_limit": 0.8 * bias}
    texts = [*doubts(evidence, lambda f: f.update(silent=[lesser, hidden]))]
    found = [t for t in texts if "undetected tilt" in t]
    assert (
        found == ["Not in the interval: undetected tilt could shift K_b by up to 0.6."] * is_doubt
    )


def test_rejected_trials_and_a_manifest_without_shared_errors_are_doubts(evidence):
    trials = evidence.table(TRIALS)
    rejected = f"1 of {len(trials['trial'])} trials were left out"
    assert any(d.startswith(rejected) for d in words.doubts(evidence))
    clean = {**trials, "quality": np.full(len(trials["trial"]), "", dtype=object)}
    bare = dataclasses.replace(
        evidence,
        campaign=evidence.campaign.model_copy(update={"uncertainty": ()}),
        tables={**evidence.tables, TRIALS.file: clean},
    )
    assert any("states no uncertainty shared by trials" in d for d in words.doubts(bare))
    assert not any("left out" in d for d in words.doubts(bare))
