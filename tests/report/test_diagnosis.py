"""The chapter on the diagnosis follows the findings, in words and numbers."""

from __future__ import annotations

import copy
import html
import re

import pytest
from tests.unit import quoted, small_run
from tests.unit.elements import Elements, follow

from nearlift.stages.gathering import gather


@pytest.fixture(scope="module")
def evidence(small_job):
    return gather(small_job)


def said(evidence, change=None):
    """The chapter's words and HTML for changed findings; folded tables are left out of the words.
    Every number is that of its place in the product.
    """
    content = copy.deepcopy(quoted.DIAGNOSED)
    if change is not None:
        change(content["boundaries"]["ground"])
    known = quoted.known(evidence, content)
    chapter = small_run.chapter(known, "diagnosis")
    chapter = chapter[chapter.index('<section id="diagnosis"') :].partition("</section>")[0]
    for attributes, _ in Elements(chapter).numbers:
        file, _, pointer = attributes["data-source"].partition("#")
        if not (attributes.get("data-how") or "").startswith(("count", "less")):
            assert float(attributes["value"]) == follow(known.documents[file], pointer)
    inner = chapter.partition("</summary>")[2]
    unfolded = re.sub(r"<details>.*?</details>", "", inner, flags=re.S)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", "", unfolded))), chapter


def test_the_story_of_an_effect_in_words(evidence):
    words, chapter = said(evidence)
    assert "The residuals of the base model follow supply voltage (p < 10⁻¹²)." in words
    assert (
        "Supply sag; p = 2.10 (90 %: 1.90 to 2.30). This design cannot distinguish it from session"
        " gain" in words
    )
    assert (
        "the error falls from 1.22 % (90 %: 1.17 to 1.28) of lift to 0.43 % (90 %: 0.41 to 0.45);"
        " noise floor 0.41 %. What remains is noise." in words
    )
    assert "1.20" not in words
    assert "Untestable here: air density. Log next time: temperature." in words
    assert "<summary>Effects that the coefficients can absorb (1)</summary>" in chapter
    assert "height scale" not in words.lower()


@pytest.mark.parametrize(
    ("after", "words"),
    [
        ((0.0043, 0.0041, 0.0045), "falls from 1.22 %"),
        (
            (0.0120, 0.0115, 0.0126),
            "1.15 to 1.26); noise floor 0.41 %. This change is not significant",
        ),
        ((0.0200, 0.0190, 0.0210), "The correction makes predictions worse"),
        ((0.0080, 0.0078, 0.0082), "It is above the noise floor"),
    ],
)
def test_words_on_the_error_follow_the_numbers(evidence, after, words):
    def change(found):
        found["error"]["after"] = dict(zip(("held_out_rmse", "lo90", "hi90"), after, strict=True))

    assert words in said(evidence, change)[0]


def test_a_small_change_is_told_from_none_visit_by_visit(evidence):
    def change(found):
        found["error"]["after"] = {"held_out_rmse": 0.0120, "lo90": 0.0115, "hi90": 0.0126}
        found["error"]["change"] = {"value": -0.0164, "lo90": -0.021, "hi90": -0.012}

    words = said(evidence, change)[0]
    assert "falls from 1.22 % (90 %: 1.17 to 1.28) of lift" in words
    assert "Visit by visit, the change is \u22121.6 % (90 %: \u22122.1 to \u22121.2)." in words
    assert "change is not significant" not in words


def test_the_chance_of_the_largest_test_is_said(evidence):
    assert (
        "p = 0.43 for the largest of all tests"
        in said(evidence, lambda f: f.update(verdict="adequate", effects=[], p_value=0.43))[0]
    )
    assert (
        "p = 3 × 10⁻⁵ for the largest of all tests."
        in said(evidence, lambda f: f.update(p_value=3e-5))[0]
    )
    assert (
        "p < 10⁻¹² for the largest of all tests."
        in said(evidence, lambda f: f.update(p_value=1e-90))[0]
    )


def test_a_look_before_the_end_is_said(evidence):
    look = {
        "trials": 240,
        "scheduled": 480,
        "p_value_needed": 7e-5,
        "text": "a look at 240 of 480 trials; claims need p < 7e-05",
    }
    words = said(
        evidence, lambda f: f.update(verdict="adequate", effects=[], p_value=0.43, look=look)
    )[0]
    assert "A look at 240 of 480 trials; claims need p < 7e-05. No effect was added" in words


def test_an_adequate_model_is_left_alone_in_words_too(evidence):
    words, _ = said(evidence, lambda f: f.update(verdict="adequate", effects=[], p_value=0.43))
    assert "No effect was added to the model." in words
    assert "follow " not in words
    assert "falls" not in words


def test_the_unexplained_names_covariate_and_shares_but_no_effect(evidence):
    def change(found):
        found.update(
            verdict="unexplained", effects=[], partial=[{"name": "gain_drift", "share": 0.31}]
        )
        found["structure"] = [{"covariate": "start", "p_value": 3.7e-5, "significant": True}]

    words, _ = said(evidence, change)
    assert "The residuals of the base model follow time (p = 3.7 × 10⁻⁵)" in words
    assert "Partial explanations: gain drift (31 % of what exceeds the noise)." in words
    assert "cannot distinguish it from" not in words
    assert "include an unexplained" not in words


def test_the_unexplained_says_along_what_it_is_carried(evidence):
    def change(found):
        found.update(verdict="unexplained", effects=[])
        found["coefficients"]["carried"] = ["distance", "start"]

    words, _ = said(evidence, change)
    assert "their intervals include an unexplained dependence on distance and time" in words


def test_drift_within_records_is_said_with_its_chance(evidence):
    own = {
        "change_over_record": {"value": -0.012, "lo90": -0.014, "hi90": -0.01},
        "p_value": 2e-5,
        "significant": True,
        "candidates": ["motor_heating"],
    }
    words, _ = said(evidence, lambda f: f.update(within_trial=own))
    assert (
        "Within a record, lift changes by −1.2 % (90 %: −1.4 to −1) significantly (p = 2"
        " × 10⁻⁵): motor heating." in words
    )
    calm = {**own, "significant": False, "candidates": []}
    assert ": not significant." in said(evidence, lambda f: f.update(within_trial=calm))[0]


def test_two_effects_that_are_likelier_but_not_plainly_are_told(evidence):
    def change(found):
        found["effects"][0]["rivals"] = ["session_gain", "tilt"]
        found["explanations"] = [["supply_sag"], ["session_gain"], ["supply_sag", "tilt"]]
        found["error"]["chosen_in_folds"] = ["supply_sag", "unexplained", "supply_sag"]

    words, _ = said(evidence, change)
    assert "This design cannot distinguish it from session gain or supply sag with tilt." in words
    assert "in 2 of 3 folds. The error after is that of each fold's own choice." in words


def test_many_numbers_of_one_effect_are_told_by_their_range(evidence):
    gains = {
        f"gain[{i}]": {"value": 0.01 * (i - 2), "lo90": 0.01 * i - 0.03, "hi90": 0.01 * i - 0.01}
        for i in range(6)
    }

    def change(found):
        found["effects"] = [{"name": "session_gain", "rivals": [], "parameters": gains}]

    words, chapter = said(evidence, change)
    assert "Session gain; 6 values, from −0.020 to 0.030." in words
    assert "Session gain: all 6 numbers" in chapter


def test_a_size_at_its_bound_speaks_against_an_effect(evidence):
    def change(found):
        found["effects"] = [
            {
                "name": "height_scale",
                "rivals": [],
                "parameters": {"z_scale": {"value": -0.1, "lo90": -0.15, "hi90": -0.05}},
            }
        ]

    words, _ = said(evidence, change)
    assert "at its bound" in words
    assert "which makes it doubtful" in words

    def inside(found):
        change(found)
        found["effects"][0]["parameters"]["z_scale"]["value"] = -0.05

    assert "at its bound" not in said(evidence, inside)[0]


def test_candidates_folds_and_proposals_are_told(evidence):
    def change(found):
        found["rounds"][0]["candidates"] = [
            {
                "name": "supply_sag",
                "gain": 900.0,
                "p_value": 1.0,
                "accepted": True,
                "log_evidence": -10.0,
                "left_in": None,
            },
            {
                "name": "warm_up",
                "gain": 300.0,
                "p_value": 0.001,
                "accepted": False,
                "log_evidence": -35.0,
                "left_in": "supply",
            },
        ]
        found["effects"][0]["rivals"] = []
        found["error"]["chosen_in_folds"] = ["supply_sag", "warm_up", "supply_sag"]
        found["next_experiment"][0].update(
            trials=160,
            expected_evidence=25.2,
            alternatives=[{"measure": "more visits", "expected_evidence": 3.1}],
        )

    words, chapter = said(evidence, change)
    assert "gave the same answer in 2 of 3 folds" in words
    assert "(160 trials, expected 2 ln B = 25). Instead: more visits (3.1)." in words
    rows = Elements(chapter).numbers
    assert any(
        a["data-source"].endswith("/rounds/0/candidates/1/log_evidence") and t == "50"
        for a, t in rows
    )
