"""The report: self-contained, escaped, traceable to the last number, readable by everybody."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import itertools
import re
from importlib import resources

import numpy as np
import pytest
from tests.unit import quoted, small_run
from tests.unit.elements import Elements, follow

from nearlift.report import charts
from nearlift.report.page.render import page, scripts
from nearlift.report.registry import CHAPTERS, FIGURES, PARTS
from nearlift.stages import report
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import FIT, RESULTS
from nearlift.stages.gathering import gather
from nearlift.stages.reduce import LIFT

LOWERED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
HOSTILE = '<script>alert("x")</script>{{ 7*7 }}\' & \\input{x}'
#: Where a page looks for the products of the campaign that tests make.
PRODUCTS = "../../processed/small/"
#: What a campaign of lift alone gives before it is diagnosed.
DRAWN = ("fig2", "corner", "residuals")


@pytest.fixture(autouse=True)
def quick(plain_pictures):
    """Pictures are not drawn: figures have tests of their own."""


@pytest.fixture(scope="module")
def made(make_job):
    job = make_job(simulated=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("nearlift.report.figures.files.render", small_run.undrawn)
        outcome = report.run(job)
    return job, outcome, (job.reports / "index.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def job(made):
    return made[0]


@pytest.fixture(scope="module")
def text(made):
    return made[2]


@pytest.fixture(scope="module")
def elements(text):
    return Elements(text)


def reported(job):
    """The page of a job."""
    report.run(job)
    return (job.reports / "index.html").read_text()


def words_of(text):
    return re.sub(r"\s+", " ", re.sub(r"<[^>]+>", "", text))


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
    names = {str(p.relative_to(job.reports)) for p in job.reports.rglob("*") if p.is_file()}
    tables = {
        f"tables/{n}.{k}" for n in ("coefficients", "budget", "comparison") for k in ("tex", "csv")
    }
    paper = {"index.html", "methods.md", "references.bib", "summary.txt"}
    assert names == paper | tables | {f"{n}.{k}" for n in DRAWN for k in ("pdf", "png", "csv")}
    assert outcome.notes == not_drawn(DRAWN)


def test_a_figure_without_products_is_not_made_and_old_files_go(make_job):
    job = make_job(boundaries=("ground",))
    report.run(job)
    (job.processed / LIFT.file).unlink()
    outcome = report.run(job)
    assert not list(job.reports.glob("fig2.*"))
    assert (job.reports / "residuals.png").is_file()
    assert outcome.notes == not_drawn(DRAWN[1:])


def test_the_page_fetches_nothing_and_its_links_lead_somewhere(job, text, elements):
    # the library names addresses of its own, and the page's policy keeps it from any
    own = text.replace(scripts()[0], "")
    assert len(own) < len(text) - 800_000
    assert not re.findall(r"https?://(?!www\.w3\.org/)", own)
    assert not re.findall(r"@import|url\(|<script[^>]+src|<link[^>]+stylesheet", own)
    assert len(elements.every("script")) == 3
    assert all(a["src"].startswith("data:image/png;base64,") for a in elements.every("img"))
    assert "default-src 'none'" in text
    for script in scripts():
        assert base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() in text
    assert len(text.encode()) < 2_500_000
    ids = {a["id"] for _, a, _ in elements.found if "id" in a}
    hrefs = {a["href"] for a in elements.every("a")}
    files = {h for h in hrefs if not h.startswith("#")}
    assert {h[1:] for h in hrefs - files} <= ids
    for href in files:
        # a job made for a test has its products elsewhere
        home = job.processed if href.startswith(PRODUCTS) else job.reports
        assert (home / href.removeprefix(PRODUCTS)).is_file()
    assert {"summary.txt", "methods.md", f"{PRODUCTS}results.json"} <= files


def test_simulated_is_said(job, text):
    assert "SIMULATED" in text
    evidence = gather(job)
    measured = evidence.campaign.model_copy(update={"simulated": False})
    assert b"SIMULATED" not in page(dataclasses.replace(evidence, campaign=measured), [], [])


def test_every_number_is_that_of_its_place(job, elements):
    documents = {product.file: job.read_json(product) for product in (FIT, RESULTS)}
    plain = 0
    for attributes, shown in elements.numbers:
        file, _, pointer = attributes["data-source"].partition("#")
        how = attributes.get("data-how")
        if file not in documents or (how or "").startswith(("over", "less")):
            continue
        stored = follow(documents[file], pointer)
        assert float(attributes["value"]) == stored
        if how is None:
            digits = shown.replace("−", "-").replace(" × 10", "e").translate(LOWERED)
            last = 10.0 ** -len(digits.partition(".")[2])
            assert float(digits) == pytest.approx(stored, rel=0.05, abs=last)
            plain += 1
    assert plain > 60


def test_verdict_comes_first_with_the_headline_and_no_date_is_printed(job, text, elements):
    K_b = job.read_json(RESULTS)["boundaries"]["ground"]["coefficients"]["K_b"]
    script = re.compile(r"<script>.*?</script>", re.S)
    assert not re.search(r"\b20\d\d-\d\d-\d\d", script.sub("", text))
    assert text.index('id="verdict"') < text.index('id="fig2"')
    place = "#/boundaries/ground/coefficients/K_b/value"
    first = next(t for a, t in elements.numbers if a["data-source"].endswith(place))
    assert float(first) == pytest.approx(K_b["value"], abs=0.01)
    assert "90 % interval" in text


def test_every_rejected_trial_is_listed_with_its_reason(text):
    ledger = text.partition('<section id="quality"')[2].partition("</section>")[0]
    assert "t0003" in ledger
    assert "SATURATED (the load cell was at the end of its range)" in ledger
    assert "t0011" not in ledger  # only a remark; its point in Figure 2 has it


def test_a_model_that_repeats_reject_is_called_rejected(make_job):
    def bend(table):
        table["lift_N"] = table["lift_N"] * (1 + 0.02 * np.cos(3 * table["z_hat"]))

    text = reported(make_job(boundaries=("ground",), edit=bend, fit={"ess": 400}))
    assert "rejected, as cell means deviate from the curve by more than scatter" in text
    assert 'class="card bad"' in text


def test_hostile_names_are_shown_and_do_nothing(make_job):
    def rename(table):
        table["trial"][3] = HOSTILE
        table["trial"][11] = "=cmd()"

    vehicle = {"rotor_radius": "23 mm", "rotor_spacing": "65 mm", "mass": "27 g"}
    stated = {"name": HOSTILE, "on": "gain", "value": "0.1 percent", "scope": "session"}
    job = make_job(
        boundaries=("ground",),
        edit=rename,
        note=HOSTILE,
        vehicle={"name": HOSTILE, "rotors": 4, **vehicle},
        uncertainty=[stated],
    )
    text = reported(job)
    assert "<script>alert" not in text
    assert len(Elements(text).every("script")) == 3
    assert "&lt;script&gt;" in text
    assert "{{ 7*7 }}" in text
    assert b"\nground,z_hat,trial,'=cmd()," in (job.reports / "residuals.csv").read_bytes()


def test_provenance_lists_inputs_and_products(job, text):
    for name, sha in job.inputs.items():
        assert name in text
        assert sha in text
    assert hashlib.sha256((job.processed / FIT.file).read_bytes()).hexdigest() in text
    assert job.root.name != job.campaign.name, "a folder may have another name"
    assert f">nearlift run {job.root.name}<" in text


def test_diagnosis_is_a_chapter_once_it_exists(make_job):
    job = make_job(boundaries=("ground",))
    job.write(DIAGNOSIS, quoted.diagnosis(quoted.DIAGNOSED["boundaries"]))
    quoted.write(job, quoted.DIAGNOSED["boundaries"])
    words = words_of(reported(job))
    for text in (
        "Sanchez-Cuevas alone does not fit. Supply sag explains the residuals. This design",
        "cannot distinguish it from session gain. See it",
        "Kb = 2.00 ± 0.12 (k = 1)",
        "90 % interval 1.80 to 2.20. Includes",
        "every undetected effect at its plausible size",
        "noise floor 0.41 %",
        "Next: both directions, to distinguish height offset from near-wall saturation.",
    ):
        assert text in words


# ---- structure


def test_headings_skip_no_level_and_landmarks_are_there(elements):
    assert elements.open == []
    levels = [int(name[1]) for name, _, _ in elements.found if re.fullmatch("h[1-6]", name)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    for landmark in ("header", "nav", "main", "footer"):
        assert len(elements.every(landmark)) == 1
    ids = {a["id"] for _, a, _ in elements.found if "id" in a}
    assert all(a["aria-labelledby"] in ids for a in elements.every("section"))
    assert not {chapter.title for chapter in CHAPTERS} - {"Verdict"} & {*PARTS.values()}
    first = next(a for _, a, inside in elements.found if "body" in inside)
    assert first["class"] == "skip"
    assert first["href"][1:] in ids


def test_tables_have_captions_and_pictures_are_described_with_numbers(elements):
    tables = [inside for tag, _, inside in elements.found if tag == "table"]
    assert len(tables) == len(elements.every("caption")) > 8
    assert all(a.get("scope") in ("col", "row") for a in elements.every("th"))
    assert all("div" in inside for inside in tables)
    # on a phone each scrolls by keys
    wide = [a for a in elements.every("div") if a.get("class") == "wide"]
    assert len(wide) == len(tables)
    assert all(a["tabindex"] == "0" and a["aria-label"] for a in wide)
    alts = [a["alt"] for a in elements.every("img")]
    assert len(alts) == len(DRAWN)
    assert all(len(alt) > 100 and re.search(r"\d", alt) for alt in alts)


def luminance(colour):
    digits = colour[1:] if len(colour) == 7 else "".join(2 * c for c in colour[1:])
    parts = [int(digits[i : i + 2], 16) / 255 for i in (0, 2, 4)]
    linear = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return float(np.dot([0.2126, 0.7152, 0.0722], linear))


def test_contrast_is_that_of_wcag_aa():
    style = resources.files("nearlift.report.page").joinpath("templates", "page.css").read_text()
    light, dark = (
        dict(re.findall(r"--([a-z0-9]+): (#[0-9a-f]{3,6})", block))
        for block in re.findall(r":root \{(.*?)\}", style, re.S)[:2]
    )
    assert set(light) == set(dark)
    # of marks and lines three to one is asked
    pairs = [
        (name, ground, 4.5)
        for name in ("text", "soft", "link", "good", "fair", "bad")
        for ground in ("paper", "card")
    ]
    pairs += [(f"s{i}", "paper", 3.0) for i in range(charts.MOST_COLOURS)]
    for colours in (light, dark):
        for name, ground, least in pairs:
            low, high = sorted(luminance(colours[x]) for x in (name, ground))
            assert (high + 0.05) / (low + 0.05) >= least, (name, ground)


def test_the_library_is_what_the_pinned_package_bundles():
    bundler = pytest.importorskip("vl_convert", reason="vl-convert is not installed")
    vendored = resources.files("nearlift.report.page").joinpath("vendor", "vega.js")
    held = vendored.read_text(encoding="utf-8")
    assert bundler.javascript_bundle() == held
    assert not re.search(r"<!--|</?script", held)
