"""What is said of a campaign in little room, for each verdict: summary.txt, methods."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from tests.unit import verdicts

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.loop import weigh
from nearlift.report import phrases, sources, words
from nearlift.report.documents import methods, summary
from nearlift.report.figures import corner
from nearlift.report.phrases import coefficient_text, coverage
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import FIT
from nearlift.stages.gathering import gather
from nearlift.stages.ingest import TRIALS
from nearlift.version import __version__


@pytest.fixture(scope="module", params=verdicts.MADE)
def evidence(request, make_job):
    made = make_job(("ground",), diagnosed=True, **verdicts.MADE[request.param])
    found = gather(made)
    assert found.quoted("ground").verdict == request.param
    return found


@pytest.fixture
def quoted(evidence):
    return evidence.quoted("ground")


#: What the sentence of each verdict has, and no other's.
SAID = {
    "adequate": "fits; no residual structure detected",
    "effect": "alone does not fit. Supply sag explains the residuals (probability ",
    "unexplained": "does not fit: residuals vary with",
    "not_diagnosed": "Not diagnosed: ",
}


def test_the_verdict_is_said_without_identifiers(evidence, quoted):
    text = words.Brief(evidence, "ground").verdict
    assert [v for v, said in SAID.items() if said in text] == [quoted.verdict]
    assert text.endswith(".")
    assert "sanchez_cuevas" not in text


def test_repeated_searches_that_found_nothing_agree_with_nothing(evidence, quoted):
    if quoted.verdict == "adequate":
        said = words.Brief(evidence, "ground").findings
        folds = evidence.diagnosed("ground").error.chosen_in_folds
        n = folds.count("adequate")
        assert n > 0
        assert any(f"the same answer in {n} of {len(folds)} folds" in text for text in said)


def test_the_corner_plot_shows_the_quoted_coefficients(evidence, quoted):
    c = quoted.coefficients["K_b"]
    drawn = corner.draws(evidence, "ground")
    if quoted.verdict == "effect":
        assert set(drawn) == {"K_b"}
        assert abs(drawn["K_b"].mean() - c.value) < c.u


def flat(text):
    return " ".join(text.split())


def test_the_screen_has_the_numbers_of_the_products(evidence, quoted):
    text = flat(summary.summary(evidence).decode())
    c = quoted.coefficients["K_b"]
    assert coefficient_text(c, "K_b").replace("±", "+/-") in text
    error = quoted.error
    assert (" Error: " in text) == (error is not None)
    if error is not None:
        assert f"Error: {100 * error.before:.2f} % of lift" in text
        assert (f"{100 * error.after:.2f} % with the effect" in text) == (
            quoted.verdict == "effect"
        )
    for source, u in sources.leads(c):
        [line] = [b for b in c.budget if b.source == source]
        assert u == line.u_without < 0.95 * c.u
    for one in (c.influence.trial, c.influence.visit):
        assert one is None or re.search(rf"(trial|visit) {one.id} \((K_b )?[+−]", text)


def test_a_source_that_is_all_there_is_is_no_lead(quoted):
    own = quoted.coefficients["K_b"]
    sole = dataclasses.replace(own.budget[0], u=own.u, u_without=0.0, dof=50.0)
    assert sources.leads(dataclasses.replace(own, budget=(sole,))) == []
    half = dataclasses.replace(sole, u_without=own.u / 2)
    assert sources.leads(dataclasses.replace(own, budget=(half,))) == [(sole.source, own.u / 2)]


def test_no_coefficient_k_is_confused_with_the_coverage_factor():
    assert coverage("K_b") == "k = 1"
    assert "k" not in coverage("k").split()


def test_the_screen_is_one(evidence):
    lines = summary.summary(evidence).decode().splitlines()
    assert max(map(len, lines)) <= summary.WIDTH
    assert len(lines) <= 22
    assert not re.search("|".join(e.name for e in catalogue.effects() if "_" in e.name), str(lines))


def test_what_could_part_rivals_is_what_to_measure_next(evidence, quoted):
    content = evidence.document(DIAGNOSIS)
    block = content["boundaries"]["ground"]
    asked = [{"separates": ["a", "b"], "measure": "height_scale against tilt at 3 distances"}]
    told = {**content, "boundaries": {"ground": {**block, "next_experiment": asked}}}
    other = dataclasses.replace(evidence, documents={**evidence.documents, DIAGNOSIS.file: told})
    if quoted.verdict == "not_diagnosed":
        assert "height scale" not in words.briefs(other)[0].next
    else:
        said, _, logged = words.briefs(other)[0].next.partition(". ")
        assert said.removesuffix(".") == "Height scale against tilt at 3 distances"
        assert logged.startswith("Log ") == (quoted.verdict == "unexplained")


@pytest.mark.parametrize("declared", [False, True])
def test_what_could_move_the_number_unseen_is_looked_for_first(
    evidence, quoted, declared, monkeypatch
):
    if quoted.verdict != "adequate":
        return
    if declared:
        monkeypatch.setattr(words, "undeclared", lambda *_: [])
    content = evidence.document(DIAGNOSIS)
    block = content["boundaries"]["ground"]
    silent = [
        {
            "effect": "room_recirculation",
            "absorbed_by": "K_b",
            "share_visible": 0.1,
            "bias_at_detection_limit": 1e3,
            "u": quoted.coefficients["K_b"].u,
            "hidden": True,
        }
    ]

    # no single trial is graver
    sure = dataclasses.replace(quoted, rests_on=None)
    monkeypatch.setattr(type(evidence), "quoted", lambda *_: sure)

    def after(effect: str) -> str:
        hidden = {**block, "silent": [{**silent[0], "effect": effect}]}
        told = {**content, "boundaries": {"ground": hidden}}
        documents = {**evidence.documents, DIAGNOSIS.file: told}
        [own] = words.briefs(dataclasses.replace(evidence, documents=documents))
        assert own.doubts[0].startswith("Not in the interval: undetected ")
        assert " could shift K_b by up to " in own.doubts[0]
        return own.next

    said = "To detect room recirculation: longer pauses, an open door, or one long run. "
    assert after("room_recirculation").startswith(said)
    # what would tell of it was logged
    assert "o detect" not in after("supply_sag")


def test_probabilities_have_their_prior_odds_where_there_are_any(evidence, quoted):
    silent, detected, nameless = np.exp(
        [weigh.LOG_SILENT_ODDS, weigh.LOG_DETECTED_ODDS, weigh.LOG_NAMELESS_ODDS]
    )
    assert f"{nameless:.2g} for structure without a known cause." in phrases.PRIOR_ODDS
    assert f"No effect has {silent:.2g}, or {detected:.2g} once" in phrases.PRIOR_ODDS
    diagnosed = quoted.verdict != "not_diagnosed"
    assert (phrases.PRIOR_ODDS in flat(methods.markdown(evidence).decode())) == diagnosed


def test_the_methods_are_made_from_the_products(evidence, quoted):
    """One number or name of each paragraph, as its product has it."""
    text = methods.markdown(evidence).decode()
    trials, fitted = evidence.table(TRIALS), evidence.document(FIT)
    entry = fitted["boundaries"]["ground"]["sanchez_cuevas"]
    z, block = trials["z_hat"], evidence.document(DIAGNOSIS)["boundaries"]["ground"]
    expected = [
        f"Near the ground, {len(z)} trials in {len(set(trials['visit']))} visits at",
        f"visits at {len(set(z))} distances",
        f"Of {len(z)} trials, 1 was left out: the load cell was at the end of its range (1).",
        f"Sanchez-Cuevas [@sanchezcuevas2017], with {len(fitted['boundaries']['ground']) - 1} rivals",
        f"to {entry['n_trials']} trials.",
        "stated uncertainties: distance datum (shared by boundary).",
        f"Near the ground, $K_b$ = {coefficient_text(quoted.coefficients['K_b'])}.",
        titled(quoted.coefficients["K_b"].holds),
        f"nearlift {__version__}",
        evidence.versions["numpy"],
    ]
    if quoted.verdict == "not_diagnosed":
        expected.append(f"Residuals near the ground were not diagnosed: {block['reason']}.")
    else:
        said = {
            "adequate": "no residual structure was detected (probability ",
            "effect": "the residuals are explained by supply sag [@supply_sag] (probability ",
            "unexplained": "no candidate effect explains the residual structure (probability ",
        }
        expected.append(f"Near the ground, {said[quoted.verdict]}")
        expected.append(f"{100 * block['error']['noise_floor']:.2f} %.")
    for part in expected:
        assert part in text


def test_every_cite_is_in_the_bibliography_and_nothing_else(evidence):
    cited = {
        key
        for group in methods.CITED.findall(methods.markdown(evidence).decode())
        for key in group.split("; @")
    }
    bib = methods.references(evidence).decode()
    assert cited == set(re.findall(r"^@\w+\{(\w+),$", bib, re.M))
    assert {"sanchezcuevas2017", "gum2008", "numpy"} <= cited
    assert bib.count("{") == bib.count("}")


def test_a_source_outside_the_library_is_cited_itself():
    assert "author = {{nearlift" not in methods._declared(catalogue.effect("supply_sag"))
    assert "title = {{Bitcraze, PWM" in methods._declared(catalogue.effect("supply_sag"))
    assert "author = {{nearlift" in methods._declared(catalogue.effect("session_gain"))


def test_names_from_files_do_nothing_in_markdown(evidence):
    vehicle = evidence.campaign.vehicle.model_copy(update={"name": r"$x$ \input{y} [@z] `a`"})
    campaign = evidence.campaign.model_copy(update={"vehicle": vehicle})
    hostile = dataclasses.replace(evidence, campaign=campaign)
    text = methods.markdown(hostile).decode()
    assert "x input{y} @z a" not in text
    assert "[@z]" not in text
    assert r"\input" not in text
