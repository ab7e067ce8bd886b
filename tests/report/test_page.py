"""The report: self-contained, escaped, traceable to the last number, the same bytes each time."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import itertools
import re
from html.parser import HTMLParser
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from tests.unit import quoted, small_run
from tests.unit.elements import Elements, follow

from nearlift.report import charts as interactive
from nearlift.report.page.render import page, scripts
from nearlift.report.registry import CHAPTERS, FIGURES, PARTS
from nearlift.run.workers import open_executor
from nearlift.stages import report
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import FIT, RESULTS
from nearlift.stages.gathering import gather
from nearlift.stages.reduce import LIFT

LOWERED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
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
DRAWN = ("fig2", "corner", "residuals")


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
    paper = {"methods.md", "references.bib", "summary.txt"}
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
    assert {"index.html", "summary.txt", "fig2.csv"} <= {path.name for path in before}
    report.run(job)
    assert content() == before


def test_another_process_draws_the_same(made, monkeypatch):
    monkeypatch.syspath_prepend(Path(__file__).parents[2])
    job, before = made[0], digests(made[0].reports)
    with open_executor("processes:1") as pool:
        pool.load(["nearlift.report.registry"])
        report.run(dataclasses.replace(job, executor=pool))
    assert digests(job.reports) == before


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
    assert len(pictures) == len(DRAWN)
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
            digits = shown.replace("−", "-").replace(" × 10", "e").translate(LOWERED)
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
    assert not re.search(
        r"\b20\d\d-\d\d-\d\d", re.sub(r"<script>.*?</script>", "", text, flags=re.S)
    )
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


def test_provenance_lists_inputs_and_products(made):
    job, _, text = made
    for name, sha in job.inputs.items():
        assert name in text
        assert sha in text
    assert hashlib.sha256((job.processed / FIT.file).read_bytes()).hexdigest() in text
    assert job.root.name != job.campaign.name, "a folder may have another name"
    assert f">nearlift run {job.root.name}<" in text


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
    job.write(DIAGNOSIS, content)
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
    assert "noise floor 0.41 %" in words
    assert "< 10⁻¹²" in text or "&lt; 10⁻¹²" in text
    assert "Next: both directions, to distinguish height offset from near-wall saturation." in words
    for attributes, _ in Elements(text).numbers:
        file, _, pointer = attributes["data-source"].partition("#")
        if file == DIAGNOSIS.file:
            assert float(attributes["value"]) == follow(content, pointer)


STYLE = (
    resources.files("nearlift.report.page")
    .joinpath("templates", "page.css")
    .read_text(encoding="utf-8")
)
VOID = {"meta", "link", "img", "br", "input", "path"}


class Outline(HTMLParser):
    """Elements in order, each with its ancestors' tags."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None], tuple[str, ...]]] = []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs), tuple(self.open)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def every(self, *tags):
        return [(attributes, inside) for name, attributes, inside in self.elements if name in tags]


@pytest.fixture(scope="module")
def outline(made):
    return Outline(made[2])


def test_every_element_is_closed_where_it_was_opened(outline):
    assert outline.open == []


def test_headings_skip_no_level_and_landmarks_are_there(outline):
    levels = [int(name[1]) for name, _, _ in outline.elements if re.fullmatch("h[1-6]", name)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    for landmark in ("header", "nav", "main", "footer"):
        assert len(outline.every(landmark)) == 1
    ids = {a["id"] for _, a, _ in outline.elements if "id" in a}
    assert all(a["aria-labelledby"] in ids for a, _ in outline.every("section"))
    titles = {chapter.title for chapter in CHAPTERS} - {"Verdict"}
    assert not titles & {*PARTS.values()}
    first = next(a for name, a, inside in outline.elements if "body" in inside)
    assert first["class"] == "skip"
    assert first["href"][1:] in ids


def test_tables_have_captions_and_heads_have_scopes(outline):
    tables, captions = outline.every("table"), outline.every("caption")
    assert len(tables) == len(captions) > 8
    assert all(a.get("scope") in ("col", "row") for a, _ in outline.every("th"))
    assert all("div" in inside for _, inside in tables)
    # on a phone each scrolls by keys
    wide = [a for a, _ in outline.every("div") if a.get("class") == "wide"]
    assert len(wide) == len(tables)
    assert all(a["tabindex"] == "0" and a["aria-label"] for a in wide)


def colours(block):
    return dict(re.findall(r"--([a-z0-9]+): (#[0-9a-f]{3,6})", block))


def luminance(colour):
    digits = colour[1:] if len(colour) == 7 else "".join(2 * c for c in colour[1:])
    parts = [int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(a, b):
    low, high = sorted((luminance(a), luminance(b)))
    return (high + 0.05) / (low + 0.05)


def schemes():
    light, dark = (colours(block) for block in re.findall(r":root \{(.*?)\}", STYLE, re.S)[:2])
    return {"light": light, "dark": dark}


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_contrast_is_that_of_wcag_aa(scheme):
    own = schemes()[scheme]
    for name in ("text", "soft", "link", "good", "fair", "bad"):
        for ground in ("paper", "card"):
            assert contrast(own[name], own[ground]) >= 4.5, (name, ground)
    # of marks and lines three to one is asked
    for name in ("s0", "s1", "s2", "s3", "s4", "s5"):
        assert contrast(own[name], own["paper"]) >= 3, name
    assert set(schemes()["light"]) == set(schemes()["dark"])
    assert all(f"--s{i}" in STYLE for i in range(interactive.MOST_COLOURS))


def test_the_library_is_what_the_pinned_package_bundles():
    bundler = pytest.importorskip("vl_convert", reason="vl-convert is not installed")
    held = (
        resources.files("nearlift.report.page")
        .joinpath("vendor", "vega.js")
        .read_text(encoding="utf-8")
    )
    assert bundler.javascript_bundle() == held
    assert "<!--" not in held
    assert "<script" not in held
    assert "</script" not in held
