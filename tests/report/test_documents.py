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

#: What the sentence of each verdict has, and no other's.
SAID = {
    "adequate": "fits; no residual structure detected",
    "effect": "alone does not fit. Supply sag explains the residuals (probability ",
    "unexplained": "does not fit: residuals vary with",
    "not_diagnosed": "Not diagnosed: ",
}


@pytest.fixture(scope="module", params=verdicts.MADE)
def evidence(request, make_job):
    made = gather(make_job(("ground",), diagnosed=True, **verdicts.MADE[request.param]))
    assert made.quoted("ground").verdict == request.param
    return made


@pytest.fixture
def quoted(evidence):
    return evidence.quoted("ground")


@pytest.fixture
def K_b(quoted):
    return quoted.coefficients["K_b"]


def flat(text):
    return " ".join(text.split())


def diagnosed(evidence, **changes):
    """The evidence with changed findings at the ground."""
    content = evidence.document(DIAGNOSIS)
    block = {**content["boundaries"]["ground"], **changes}
    documents = {DIAGNOSIS.file: {**content, "boundaries": {"ground": block}}}
    return dataclasses.replace(evidence, documents={**evidence.documents, **documents})


def test_the_verdict_is_said_without_identifiers(evidence, quoted):
    brief = words.Brief(evidence, "ground")
    assert [v for v, said in SAID.items() if said in brief.verdict] == [quoted.verdict]
    assert brief.verdict.endswith(".")
    assert "sanchez_cuevas" not in brief.verdict
    if quoted.verdict == "adequate":
        # repeated searches that found nothing agree with nothing
        folds = evidence.diagnosed("ground").error.chosen_in_folds
        same = f"the same answer in {folds.count('adequate')} of {len(folds)} folds"
        assert folds.count("adequate") > 0
        assert any(same in text for text in brief.findings)


def test_the_corner_plot_shows_the_quoted_coefficients(evidence, quoted, K_b):
    drawn = corner.draws(evidence, "ground")
    if quoted.verdict == "effect":
        assert set(drawn) == {"K_b"}
        assert abs(drawn["K_b"].mean() - K_b.value) < K_b.u


def test_the_screen_is_one_and_has_the_numbers_of_the_products(evidence, quoted, K_b):
    whole = summary.summary(evidence).decode()
    lines, text = whole.splitlines(), flat(whole)
    assert max(map(len, lines)) <= summary.WIDTH
    assert len(lines) <= 22
    assert not re.search("|".join(e.name for e in catalogue.effects() if "_" in e.name), whole)
    assert coefficient_text(K_b, "K_b").replace("±", "+/-") in text
    error = quoted.error
    assert (" Error: " in text) == (error is not None)
    if error is not None:
        assert f"Error: {100 * error.before:.2f} % of lift" in text
        after = f"{100 * error.after:.2f} % with the effect"
        assert (after in text) == (quoted.verdict == "effect")
    for source, u in sources.leads(K_b):
        [line] = [b for b in K_b.budget if b.source == source]
        assert u == line.u_without < 0.95 * K_b.u
    for one in (K_b.influence.trial, K_b.influence.visit):
        assert one is None or re.search(rf"(trial|visit) {one.id} \((K_b )?[+−]", text)


def test_a_source_that_is_all_there_is_is_no_lead(K_b):
    sole = dataclasses.replace(K_b.budget[0], u=K_b.u, u_without=0.0, dof=50.0)
    half = dataclasses.replace(sole, u_without=K_b.u / 2)
    for line, leads in ((sole, []), (half, [(sole.source, K_b.u / 2)])):
        assert sources.leads(dataclasses.replace(K_b, budget=(line,))) == leads


def test_no_coefficient_k_is_confused_with_the_coverage_factor():
    assert coverage("K_b") == "k = 1"
    assert "k" not in coverage("k").split()


def test_what_could_distinguish_rivals_is_what_to_measure_next(evidence, quoted):
    asked = [{"separates": ["a", "b"], "measure": "height_scale against tilt at 3 distances"}]
    [brief] = words.briefs(diagnosed(evidence, next_experiment=asked))
    said, _, logged = brief.next.partition(". ")
    if quoted.verdict == "not_diagnosed":
        assert "height scale" not in brief.next
    else:
        assert said.removesuffix(".") == "Height scale against tilt at 3 distances"
        assert logged.startswith("Log ") == (quoted.verdict == "unexplained")


@pytest.mark.parametrize("declared", [False, True])
def test_what_could_move_the_number_unseen_is_looked_for_first(
    evidence, quoted, K_b, declared, monkeypatch
):
    if quoted.verdict != "adequate":
        return
    if declared:
        monkeypatch.setattr(words, "undeclared", lambda *_: [])
    # no single trial is more serious
    sure = dataclasses.replace(quoted, rests_on=None)
    monkeypatch.setattr(type(evidence), "quoted", lambda *_: sure)

    def after(effect: str) -> str:
        bias = {"absorbed_by": "K_b", "share_visible": 0.1, "bias_at_detection_limit": 1e3}
        unit = {"u": K_b.u, "hidden": True}
        [brief] = words.briefs(diagnosed(evidence, silent=[{"effect": effect, **bias, **unit}]))
        assert brief.doubts[0].startswith("Not in the interval: undetected ")
        assert " could shift K_b by up to " in brief.doubts[0]
        return brief.next

    said = "To detect room recirculation: longer pauses, an open door, or one long run. "
    assert after("room_recirculation").startswith(said)
    # what would show it was logged
    assert "o detect" not in after("supply_sag")


def test_probabilities_have_their_prior_odds_where_there_are_any(evidence, quoted):
    silent, detected, nameless = np.exp(
        [weigh.LOG_SILENT_ODDS, weigh.LOG_DETECTED_ODDS, weigh.LOG_NAMELESS_ODDS]
    )
    assert f"{nameless:.2g} for structure without a known cause." in phrases.PRIOR_ODDS
    assert f"No effect has {silent:.2g}, or {detected:.2g} once" in phrases.PRIOR_ODDS
    known = quoted.verdict != "not_diagnosed"
    assert (phrases.PRIOR_ODDS in flat(methods.markdown(evidence).decode())) == known


def test_the_methods_are_made_from_the_products(evidence, quoted, K_b):
    """One number or name of each paragraph, as its product has it."""
    text = methods.markdown(evidence).decode()
    trials = evidence.table(TRIALS)
    fits = evidence.document(FIT)["boundaries"]["ground"]
    z, block = trials["z_hat"], evidence.document(DIAGNOSIS)["boundaries"]["ground"]
    verdict = {
        "adequate": "Near the ground, no residual structure was detected (probability ",
        "effect": "Near the ground, the residuals are explained by supply sag [@supply_sag] (prob",
        "unexplained": "Near the ground, no candidate effect explains the residual structure (prob",
        "not_diagnosed": f"Residuals near the ground were not diagnosed: {quoted.reason}.",
    }
    for part in (
        f"Near the ground, {len(z)} trials in {len(set(trials['visit']))} visits at",
        f"visits at {len(set(z))} distances",
        f"Of {len(z)} trials, 1 was left out: the load cell was at the end of its range (1).",
        f"Sanchez-Cuevas [@sanchezcuevas2017], with {len(fits) - 1} rivals",
        f"to {fits['sanchez_cuevas']['n_trials']} trials.",
        "stated uncertainties: distance datum (shared by boundary).",
        f"Near the ground, $K_b$ = {coefficient_text(K_b)}.",
        titled(K_b.holds),
        f"nearlift {__version__}",
        evidence.versions["numpy"],
        verdict[quoted.verdict],
    ):
        assert part in text
    if quoted.verdict != "not_diagnosed":
        assert f"{100 * block['error']['noise_floor']:.2f} %." in text


def test_every_cite_is_in_the_bibliography_and_nothing_else(evidence):
    groups = methods.CITED.findall(methods.markdown(evidence).decode())
    cited = {key for group in groups for key in group.split("; @")}
    bib = methods.references(evidence).decode()
    assert cited == set(re.findall(r"^@\w+\{(\w+),$", bib, re.M))
    assert {"sanchezcuevas2017", "gum2008", "numpy"} <= cited
    assert bib.count("{") == bib.count("}")
    # a source outside the library is cited itself
    sag, gain = (methods._declared(catalogue.effect(e)) for e in ("supply_sag", "session_gain"))
    assert "author = {{nearlift" not in sag
    assert "title = {{Bitcraze, PWM" in sag
    assert "author = {{nearlift" in gain


def test_names_from_files_do_nothing_in_markdown(evidence):
    vehicle = evidence.campaign.vehicle.model_copy(update={"name": r"$x$ \input{y} [@z] `a`"})
    campaign = evidence.campaign.model_copy(update={"vehicle": vehicle})
    text = methods.markdown(dataclasses.replace(evidence, campaign=campaign)).decode()
    for hostile in ("x input{y} @z a", "[@z]", r"\input"):
        assert hostile not in text
