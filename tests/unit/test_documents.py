"""What is said of a campaign in little room, for each verdict: summary.txt."""

from __future__ import annotations

import dataclasses
import re

import pytest

from nearlift import catalogue
from nearlift.products import DIAGNOSIS
from nearlift.report.documents import brief, summary
from nearlift.rounding import like, plus_minus
from nearlift.stages import diagnose, report

from . import verdicts


@pytest.fixture(scope="module", params=verdicts.MADE)
def evidence(request, make_job):
    made = make_job(("ground",), **verdicts.MADE[request.param])
    diagnose.run(made)
    found = report.gather(made)
    assert found.quoted("ground").verdict == request.param
    return found


@pytest.fixture
def quoted(evidence):
    return evidence.quoted("ground")


#: What the sentence of each verdict has, and no other's.
SAID = {
    "adequate": "describes the data: nothing is left beyond the noise",
    "effect": "is explained by supply voltage",
    "unexplained": "leaves structure along",
    "not_diagnosed": "Not diagnosed: ",
}


def test_the_verdict_is_one_sentence_without_identifiers(evidence, quoted):
    text = brief.verdict(evidence, "ground")
    assert [v for v, said in SAID.items() if said in text] == [quoted.verdict]
    assert text.endswith(".")
    assert "sanchez_cuevas" not in text


def flat(text):
    return " ".join(text.split())


def test_the_screen_has_the_numbers_of_the_products(evidence, quoted):
    text = flat(summary.summary(evidence).decode())
    c = quoted.coefficients["K_b"]
    assert f"K_b {plus_minus(c.value, c.u).replace('±', '+/-')} (" in text
    assert f"90 %: {like(c.lo90, c.u)} to {like(c.hi90, c.u)}" in text
    error = quoted.error
    assert (" error " in text) == (error is not None)
    if error is not None:
        assert f"error {100 * error.before:.2f} % of lift" in text
        assert (f"{100 * error.after:.2f} % with it" in text) == (quoted.verdict == "effect")
    for source, u in brief.leads(c):
        [line] = [b for b in c.budget if b.source == source]
        assert u == line.u_without < 0.95 * c.u
    for one in (c.influence.trial, c.influence.visit):
        assert one is None or f"{one.id} (" in text


def test_the_screen_is_one(evidence):
    lines = summary.summary(evidence).decode().splitlines()
    assert max(map(len, lines)) <= summary.WIDTH
    assert len(lines) <= 18
    assert not re.search("|".join(e.name for e in catalogue.effects() if "_" in e.name), str(lines))


def test_what_could_part_rivals_is_what_to_measure_next(evidence, quoted):
    content = evidence.document(DIAGNOSIS)
    block = content["boundaries"]["ground"]
    asked = [{"separates": ["a", "b"], "measure": "height_scale against tilt at 3 distances"}]
    told = {**content, "boundaries": {"ground": {**block, "next_experiment": asked}}}
    other = dataclasses.replace(evidence, documents={**evidence.documents, DIAGNOSIS.file: told})
    if quoted.verdict == "not_diagnosed":
        assert "height scale" not in brief.briefs(other)[0].next
    else:
        assert brief.briefs(other)[0].next == "height scale against tilt at 3 distances"


def test_titles_stand_within_a_sentence():
    assert brief.titled("reynolds, supply_sag and tilted") == (
        "Reynolds number, supply voltage and tilted"
    )
