"""The methods paragraph: its numbers are the products', its cites are in the bibliography, and
LaTeX and Markdown say the same.
"""

from __future__ import annotations

import dataclasses
import re

import pytest

from nearlift.report.documents import methods
from nearlift.stages.fit import FIT
from nearlift.stages.gathering import gather

from . import quoted
from .quoted import DIAGNOSED


@pytest.fixture(scope="module")
def evidence(small_job):
    return gather(small_job)


def test_numbers_are_those_of_the_products(evidence):
    text = methods.markdown(evidence).decode()
    content = evidence.document(FIT)
    entry = content["boundaries"]["ground"]["sanchez_cuevas"]
    assert f"to {entry['n_trials']} trials" in text
    assert f"$K_b$ = {entry['parameters']['K_b']['value']:.2f}"[:-1] in text
    assert "Near the ground, 168 trials in 42 visits at 7 distances" in text
    assert "1 was left out: the load cell was at the end of its range (1)" in text
    assert "distance datum (shared by boundary)" in text
    assert "simulated, not measured" in text
    assert "Residuals" not in text  # the loop has not run


def test_every_part_of_the_scatter_and_every_judge_is_the_products(evidence):
    text = methods.markdown(evidence).decode()
    content = evidence.document(FIT)
    bases = [content["boundaries"][b][content["base"][b]] for b in evidence.boundaries]
    for boundary in evidence.boundaries:
        [headline, *_] = evidence.quoted(boundary).coefficients.values()
        repeats = [line for line in headline.budget if line.kind == "A"]
        assert max(repeats, key=lambda line: line.u).source in text
        assert all(line.source in text for line in repeats if line.u > 0.101 * headline.u)
    fits = [entry["posterior"] for entry in bases]
    assert ("ensemble sampling" in text) == any(p["sampler"] == "emcee" for p in fits)
    assert all(f" exact {c['by']}" in text for p in fits for c in p["checks"] if not c["unfit"])


def test_every_cite_is_in_the_bibliography_and_nothing_else(evidence):
    cited = {
        key
        for group in methods.CITED.findall(methods.markdown(evidence).decode())
        for key in group.split("; @")
    }
    tex = {
        key
        for group in re.findall(r"\\cite\{([^}]+)\}", methods.tex(evidence).decode())
        for key in group.split(",")
    }
    bib = methods.references(evidence).decode()
    assert cited == tex == set(re.findall(r"^@\w+\{(\w+),$", bib, re.M))
    assert {"sanchezcuevas2017", "hsiao2019", "gum2008", "numpy"} <= cited
    assert bib.count("{") == bib.count("}")


def test_the_loop_is_told_with_its_error_and_what_it_moved(evidence):
    diagnosed = quoted.known(evidence, DIAGNOSED)
    text = methods.markdown(diagnosed).decode()
    assert (
        "explained by supply sag [@supply_sag]. The design cannot distinguish this from session gain."
        in text
    )
    assert "Near the ground, $K_b$ = 2.00 ± 0.12 (90 %: 1.80 to 2.20). Includes" in text
    assert "1.22 % to 0.43 % of lift; noise floor 0.41 %" in text
    assert "@misc{supply_sag," in methods.references(diagnosed).decode()


def test_names_from_files_do_nothing_in_latex_or_markdown(evidence):
    vehicle = evidence.campaign.vehicle.model_copy(update={"name": r"$x$ \input{y} [@z] 50 % `a`"})
    hostile = dataclasses.replace(
        evidence, campaign=evidence.campaign.model_copy(update={"vehicle": vehicle})
    )
    assert r"\input" not in methods.tex(hostile).decode()
    assert r"50 \%" in methods.tex(hostile).decode()
    assert "[@z]" not in methods.markdown(hostile).decode()
    assert "input{y}" in methods.facts(hostile)
