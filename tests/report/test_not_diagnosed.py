"""A boundary without a diagnosis has the reason wherever a verdict would be printed."""

from __future__ import annotations

import copy
import dataclasses
import re
from pathlib import Path

import pytest
from tests.unit import small_run

import nearlift
from nearlift.report import words
from nearlift.report.chapters import diagnosis, verdict
from nearlift.stages import report
from nearlift.stages.diagnose import NOT_DIAGNOSED
from nearlift.stages.fit import FIT
from nearlift.stages.gathering import gather

TABLE = "of a published table 15 in all, with lift_sd for each"
REASON = f"24 usable trials are too few; at least 45 trials are needed, 21 more ({TABLE})"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("few")
    root = small_run.write_means(folder / "raw", rows=24, quick=True)
    answer = small_run.nearlift("run", root, "--out", folder)
    assert answer.exit_code == 0, answer.output
    assert f"ground: not diagnosed: {REASON}" in answer.output
    return folder


@pytest.fixture(scope="module")
def evidence(out: Path) -> report.Evidence:
    return gather(small_run.job(out / "raw", out))


def test_the_card_and_the_chapter_say_it(evidence: report.Evidence):
    [card] = verdict.facts(evidence)["cards"]
    what, wanted = REASON.split("; ")
    assert (card["brief"].verdict, card["brief"].next) == (
        f"Not diagnosed: {what}.",
        (
            f"For a diagnosis, {wanted}, in new visits, one at z_hat = 12 or more for lift in free"
            " air."
        ),
    )
    assert any(doubt.startswith("Not diagnosed") for doubt in words.doubts(evidence))
    assert "Ground: not diagnosed" in diagnosis.facts(evidence)


def test_what_moves_the_headline_stands_before_what_might(evidence: report.Evidence):
    u = evidence.quoted("ground").coefficients["K_b"].u
    suspects = [
        {"kind": "trial", "id": t, "trials": [t], "outlying": True, "shift": k * u, "text": t}
        for t, k in (("a little", 0.1), ("much", -3.0), ("most", 26.0))
    ]
    fits = copy.deepcopy(evidence.document(FIT))
    fits["influence"]["ground"]["suspects"] = [{**s, "without": None} for s in suspects]
    found = dataclasses.replace(evidence, documents={**evidence.documents, FIT.file: fits})
    told = [re.split("[.:]", text)[0] for text in words.Brief(found, "ground").reservations]
    assert told[0].startswith("The answer depends on visit 0 (")
    assert told[1:4] == ["Most", "Much", "Not diagnosed"]
    assert told.count("Most") == 1
    assert "a little" in told[4:]


def test_python_answers_with_the_reason_and_draws_nothing(out: Path):
    answer = nearlift.load(out / "raw", out).diagnose()
    assert answer.quoted["ground"].verdict == NOT_DIAGNOSED
    assert answer.quoted["ground"].reason == REASON
    assert REASON in str(answer)
