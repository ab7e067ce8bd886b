"""The report: self-contained, escaped, traceable to the last number, the same bytes each time."""

from __future__ import annotations

import base64
import csv
import dataclasses
import hashlib
import io
import json
import re

import numpy as np
import pytest

from nearlift.report.page.render import Picture, page, scripts
from nearlift.report.registry import CHAPTERS, FIGURES, Chapter
from nearlift.report.tables import escaped
from nearlift.stages import report
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import FIT, RESULTS
from nearlift.stages.gathering import gather
from nearlift.stages.reduce import LIFT

from . import quoted, small_run
from .elements import Elements, follow

HOSTILE = '<script>alert("x")</script>{{ 7*7 }}\' & \\input{x}'


#: Where a page looks for the products of the campaign that tests make.
PRODUCTS = "../../processed/small/"


@pytest.fixture(autouse=True)
def quick(plain_pictures):
    """Pictures are not drawn: figures have tests of their own."""


def digests(folder):
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file()
    }


@pytest.fixture(scope="module")
def made(make_job):
    job = make_job(simulated=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("nearlift.report.figures.files.render", small_run.undrawn)
        outcome = report.run(job)
    return job, outcome, (job.reports / "index.html").read_text(encoding="utf-8")


#: What a campaign of lift alone gives before it is diagnosed.
DRAWN = ("fig2", "budget", "profiles", "corner", "residuals")


def not_drawn(drawn):
    """What such a campaign asks for and does not get: flow, flights and detection are no part of
    it, so they are not missed.
    """
    asked_for = (spec.name for spec in FIGURES if spec.name in {*DRAWN, "diagnosis"})
    return tuple(
        f"{name} was not drawn: its products are missing or empty"
        for name in asked_for
        if name not in drawn
    )


def test_files_of_the_contract(made):
    job, outcome, _ = made
    names = set(digests(job.reports))
    tables = {
        f"tables/{n}.{k}" for n in ("coefficients", "budget", "comparison") for k in ("tex", "csv")
    }
    paper = {"methods.md", "methods.tex", "references.bib", "summary.txt"}
    assert names == {"index.html"} | paper | tables | {
        f"{n}.{k}" for n in DRAWN for k in ("pdf", "png", "csv")
    }
    assert outcome.notes == not_drawn(DRAWN)


@pytest.mark.nightly
def test_running_twice_gives_the_same_tables_and_words(made):
    """Figures are compared in test_figures: a layout's last digits may differ."""
    job, _, _ = made

    def content():
        files = [p for p in job.reports.rglob("*.*") if p.suffix not in (".pdf", ".png")]
        return {p: re.sub(rb"base64,[^\"]+", b"", p.read_bytes()) for p in files}

    before = content()
    assert len(before) > 15
    report.run(job)
    assert content() == before


def test_the_page_fetches_nothing(made):
    _, _, text = made
    # the library names addresses of its own, and the page's policy keeps it from any
    own = text.replace(scripts()[0], "")
    assert len(own) < len(text) - 800_000
    assert not re.findall(r"https?://(?!www\.w3\.org/)", own)
    assert not re.findall(r"@import|url\(|<script[^>]+src|<link[^>]+stylesheet", own)
    elements = Elements(text)
    assert len(elements.every("script")) == 3
    assert all(a["src"].startswith("data:image/png;base64,") for a in elements.every("img"))
    assert all(
        re.fullmatch(
            r"#[a-z0-9]+|(\.\./\.\./processed/small/)?[a-z0-9_/]+\.(pdf|png|csv|md|tex|bib|txt|json|parquet)",
            a["href"],
        )
        for a in elements.every("a")
    )
    assert "default-src 'none'" in text
    for script in scripts():
        assert base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() in text
    assert len(text.encode()) < 2_500_000


def test_links_lead_somewhere(made):
    job, _, text = made
    elements = Elements(text)
    ids = {a["id"] for _, a in elements.found if "id" in a}
    hrefs = {a["href"] for a in elements.every("a")}
    assert {h[1:] for h in hrefs if h.startswith("#")} <= ids
    for href in hrefs:
        # a job made for a test has its products elsewhere
        home = job.processed if href.startswith(PRODUCTS) else job.reports
        assert href.startswith("#") or (home / href.removeprefix(PRODUCTS)).is_file()
    assert {"summary.txt", "methods.md", f"{PRODUCTS}results.json"} <= hrefs


def test_pictures_are_described_with_numbers(made):
    _, _, text = made
    pictures = Elements(text).every("img")
    # of residuals there is the chart, which paper shows too
    assert len(pictures) == len(DRAWN) - 1
    assert all(len(a["alt"]) > 100 and re.search(r"\d", a["alt"]) for a in pictures)
    assert any("ground: " in a["alt"] for a in pictures)


def test_simulated_is_said(made):
    job, _, text = made
    assert "SIMULATED" in text
    evidence = gather(job)
    measured = evidence.campaign.model_copy(update={"simulated": False})
    assert b"SIMULATED" not in page(dataclasses.replace(evidence, campaign=measured), [], [])


def test_every_number_says_where_it_stands_and_it_stands_there(made):
    job, _, text = made
    documents = {product.file: job.read_json(product) for product in (FIT, RESULTS)}
    numbers = [
        (a, t) for a, t in Elements(text).numbers if a["data-source"].split("#")[0] in documents
    ]
    assert len(numbers) > 100
    plain = 0
    for attributes, shown in numbers:
        file, _, pointer = attributes["data-source"].partition("#")
        stored = follow(documents[file], pointer)
        how = attributes.get("data-how")
        if how is None:
            assert float(attributes["value"]) == stored
            digits = shown.replace("−", "-")
            assert float(digits) == pytest.approx(
                stored, rel=0.05, abs=10.0 ** -len(digits.partition(".")[2])
            )
            plain += 1
        elif not how.startswith(("over", "less")):
            assert float(attributes["value"]) == stored
    assert plain > 60


def test_verdict_comes_first_with_the_headline(made):
    job, _, text = made
    e = job.read_json(RESULTS)["boundaries"]["ground"]["coefficients"]["K_b"]
    assert text.index('id="verdict"') < text.index('id="fig2"')
    first = next(
        t
        for a, t in Elements(text).numbers
        if a["data-source"].endswith("#/boundaries/ground/coefficients/K_b/value")
    )
    assert float(first) == pytest.approx(e["value"], abs=0.01)
    assert "90 % interval" in text


def test_every_rejected_trial_is_listed_with_its_reason(made):
    _, _, text = made
    ledger = text.partition('<section id="quality"')[2].partition("</section>")[0]
    assert "t0003" in ledger
    assert "SATURATED (the load cell was at the end of its range)" in ledger
    assert "t0011" not in ledger  # only a remark; its point in Figure 2 has it


def test_a_model_that_repeats_reject_is_called_rejected(make_job):
    def bend(table):
        table["lift_N"] = table["lift_N"] * (1 + 0.02 * np.cos(3 * table["z_hat"]))

    job = make_job(boundaries=("ground",), edit=bend, fit={"ess": 400})
    report.run(job)
    text = (job.reports / "index.html").read_text()
    assert "rejected, as cell means deviate from the curve by more than scatter" in text
    assert 'class="card bad"' in text


def test_hostile_names_are_shown_and_do_nothing(make_job):
    def rename(table):
        table["trial"][3] = HOSTILE
        table["trial"][11] = "=cmd()"

    job = make_job(
        boundaries=("ground",),
        edit=rename,
        note=HOSTILE,
        vehicle={
            "name": HOSTILE,
            "rotors": 4,
            "rotor_radius": "23 mm",
            "rotor_spacing": "65 mm",
            "mass": "27 g",
        },
        uncertainty=[{"name": HOSTILE, "on": "gain", "value": "0.1 percent", "scope": "session"}],
    )
    report.run(job)
    text = (job.reports / "index.html").read_text()
    assert "<script>alert" not in text
    assert len(Elements(text).every("script")) == 3
    assert "&lt;script&gt;" in text
    assert "{{ 7*7 }}" in text
    assert b"\nground,z_hat,trial,'=cmd()," in (job.reports / "residuals.csv").read_bytes()


def test_coefficient_tables_are_what_is_quoted(made):
    job, _, _ = made
    e = job.read_json(RESULTS)["boundaries"]["ground"]["coefficients"]["K_b"]
    lines = list(
        csv.DictReader(io.StringIO((job.reports / "tables" / "coefficients.csv").read_text()))
    )
    row = next(r for r in lines if r["base_model"] == "sanchez_cuevas" and r["parameter"] == "K_b")
    assert all(
        float(row[k]) == pytest.approx(e[k], rel=1e-8)
        for k in ("value", "u", "dof", "lo68", "hi68", "lo90", "hi90", "lo95", "hi95")
    )
    assert (row["verdict"], row["holds"]) == ("not_diagnosed", e["holds"])
    tex = (job.reports / "tables" / "coefficients.tex").read_text()
    assert rf"$K_b$ & \num{{{e['value']:.2f}}} & \num{{" in tex
    assert tex.count(r"\begin") == tex.count(r"\end") == 1
    body = [line for line in tex.splitlines() if line.endswith(r"\\")]
    assert {line.count("&") - line.count(r"\&") for line in body} == {8}
    assert escaped(r"a_b & 50 % \x") == r"a\_b \& 50 \% \textbackslash{}x"


def test_no_time_of_day_on_the_page(made):
    _, _, text = made
    text = re.sub(r"<script>.*?</script>", "", text, flags=re.S)  # the library's own code
    assert not re.search(r"\b20\d\d-\d\d-\d\d|\b\d\d:\d\d:\d\d\b", text)


def test_provenance_lists_inputs_and_products(made):
    job, _, text = made
    for name, sha in job.inputs.items():
        assert name in text
        assert sha in text
    assert hashlib.sha256((job.processed / FIT.file).read_bytes()).hexdigest() in text
    assert "nearlift run small" in text


def test_a_figure_without_products_is_not_made_and_old_files_go(make_job):
    job = make_job(boundaries=("ground",))
    report.run(job)
    (job.processed / LIFT.file).unlink()
    outcome = report.run(job)
    assert not list(job.reports.glob("fig2.*"))
    assert (job.reports / "residuals.png").is_file()
    assert outcome.notes == not_drawn(DRAWN[1:])


def test_diagnosis_is_a_chapter_once_it_exists(make_job):
    job = make_job(boundaries=("ground",))
    content = quoted.diagnosis(quoted.DIAGNOSED["boundaries"])
    job.write_json(DIAGNOSIS, content)
    quoted.write(job, quoted.DIAGNOSED["boundaries"])
    report.run(job)
    text = (job.reports / "index.html").read_text()
    words = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", "", text))
    assert (
        "Sanchez-Cuevas alone does not fit. Supply sag explains the residuals."
        " This design cannot distinguish it from session gain. See it" in words
    )
    assert "Kb = 2.00 ± 0.12 (k = 1)" in words
    assert "90 % interval 1.80 to 2.20. Includes" in words
    told = re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", text))
    assert "every undetected effect at its plausible size K b = 2.0 1.5 to 2.5" in told
    assert "noise floor 0.41&nbsp;%" in words
    assert "< 10⁻¹²" in text or "&lt; 10⁻¹²" in text
    assert "Next: both directions, to distinguish height offset from near-wall saturation." in words
    for attributes, _ in Elements(text).numbers:
        file, _, pointer = attributes["data-source"].partition("#")
        if file == DIAGNOSIS.file:
            assert float(attributes["value"]) == follow(content, pointer)


def test_a_new_figure_needs_no_chapter(small_job):
    evidence = gather(small_job)
    extra = Picture(name="posterior", title="Posterior", caption="c", alt="a", png=b"x")
    text = page(evidence, [extra]).decode()
    assert "Further figures" in text
    assert 'href="posterior.pdf"' in text
    assert 'src="data:image/png;base64,eA=="' in text


def test_chapters_are_a_plain_tuple(small_job):
    assert isinstance(CHAPTERS, tuple)
    lone = Chapter(
        name="levels",
        title="Only this",
        facts=next(c.facts for c in CHAPTERS if c.name == "levels"),
        needs=(FIT,),
    )
    text = page(gather(small_job), [], [lone]).decode()
    assert "Only this" in text
    assert 'id="verdict"' not in text
    empty = dataclasses.replace(gather(small_job), documents={}, tables={})
    assert json.dumps([c.name for c in CHAPTERS if empty.has(*c.needs)]) == '["provenance"]'
