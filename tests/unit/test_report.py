"""The report: self-contained, escaped, traceable to the last number, the same bytes each time."""

from __future__ import annotations

import base64
import copy
import csv
import dataclasses
import hashlib
import html
import io
import json
import re
from html.parser import HTMLParser

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

from . import quoted

HOSTILE = '<script>alert("x")</script>{{ 7*7 }}\' & \\input{x}'


class Elements(HTMLParser):
    """Tags with their attributes, and all text."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.numbers: list[tuple[dict[str, str | None], str]] = []
        self.inside: dict[str, str | None] | None = None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))
        if tag == "data":
            self.inside = dict(attrs)

    def handle_endtag(self, tag):
        if tag == "data":
            self.inside = None

    def handle_data(self, data):
        if self.inside is not None:
            self.numbers.append((self.inside, data))

    def every(self, tag):
        return [attributes for name, attributes in self.found if name == tag]


#: Where a page looks for the products of the campaign that tests make.
PRODUCTS = "../../processed/small/"


@pytest.fixture(autouse=True)
def quick(request):
    """`made` is drawn, and drawn again by one test; the others read the page and not its
    pictures.
    """
    if request.function is not test_running_twice_gives_the_same_tables_and_words:
        request.getfixturevalue("plain_pictures")


def digests(folder):
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(folder.rglob("*"))
        if p.is_file()
    }


@pytest.fixture(scope="module")
def made(make_job):
    job = make_job(simulated=True)
    outcome = report.run(job)
    return job, outcome, (job.reports / "index.html").read_text(encoding="utf-8")


def follow(content, pointer):
    for key in pointer.split("/")[1:]:
        key = key.replace("~1", "/").replace("~0", "~")
        content = content[int(key)] if isinstance(content, list) else content[key]
    return content


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
            r"#[a-z0-9]+|(\.\./\.\./processed/small/)?[a-z0-9_/]+\.(pdf|png|csv|md|tex|bib|txt|json)",
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


def test_simulated_is_said(made, make_job):
    _, _, text = made
    assert "SIMULATED" in text
    job = make_job(boundaries=("ground",))
    report.run(job)
    assert "SIMULATED" not in (job.reports / "index.html").read_text()


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


DIAGNOSED = {
    "schema": "nearlift.diagnosis/1",
    "boundaries": {
        "ground": {
            "base_model": "sanchez_cuevas",
            "verdict": "effect",
            "effects": [
                {
                    "name": "supply_sag",
                    "rivals": ["session_gain"],
                    "parameters": {"p": {"value": 2.1, "lo90": 1.9, "hi90": 2.3}},
                }
            ],
            "structure": [
                {"covariate": "supply", "p_value": 1e-90},
                {"covariate": "tilt", "p_value": 0.03, "significant": False},
            ],
            "error": {
                "unit": "fraction of lift",
                "noise_floor": 0.0041,
                "before": {"held_out_rmse": 0.0122, "lo90": 0.0117, "hi90": 0.0128},
                "after": {"held_out_rmse": 0.0043, "lo90": 0.0041, "hi90": 0.0045},
            },
            "coefficients": {
                "before": {"K_b": {"value": 1.2, "lo90": 1.1, "hi90": 1.3}},
                "after": {
                    "K_b": {
                        "value": 2.0,
                        "lo90": 1.8,
                        "hi90": 2.2,
                        "conditional": [1.9, 2.1],
                        "constrained": [1.5, 2.5],
                    }
                },
            },
            "rounds": [
                {"candidates": [], "decision": "added supply_sag", "reason": "nothing is left"}
            ],
            "untestable": [{"effect": "air_density", "needs": ["temperature"]}],
            "silent": [
                {"effect": "height_scale", "absorbed_by": "alpha", "bias_at_detection_limit": 0.0}
            ],
            "next_experiment": [
                {
                    "separates": ["height_offset", "near_wall_saturation"],
                    "measure": "both directions",
                }
            ],
        }
    },
}


def test_diagnosis_is_a_chapter_once_it_exists(make_job):
    job = make_job(boundaries=("ground",))
    content = quoted.diagnosis(DIAGNOSED["boundaries"])
    job.write_json(DIAGNOSIS, content)
    quoted.write(job, DIAGNOSED["boundaries"])
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


def said(make_job, change=None):
    """The chapter's words and elements for changed findings; tables folded away are left out of the
    words.
    """
    content = copy.deepcopy(DIAGNOSED)
    if change is not None:
        change(content["boundaries"]["ground"])
    job = make_job(boundaries=("ground",))
    content = quoted.diagnosis(content["boundaries"])
    job.write_json(DIAGNOSIS, content)
    quoted.write(job, content["boundaries"])
    report.run(job)
    text = (job.reports / "index.html").read_text()
    chapter = text[text.index('<section id="diagnosis"') :].partition("</section>")[0]
    for attributes, _ in Elements(chapter).numbers:
        stored = follow(content, attributes["data-source"].partition("#")[2])
        if not (attributes.get("data-how") or "").startswith(("count", "less")):
            assert float(attributes["value"]) == stored
    unfolded = re.sub(r"<details>.*?</details>", "", chapter, flags=re.S)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]+>", "", unfolded))), chapter


def test_the_story_of_an_effect_in_words(make_job):
    words, chapter = said(make_job)
    assert "The residuals of the base model follow supply voltage (p < 10⁻¹²)." in words
    assert (
        "Supply sag; p = 2.10 (90 %: 1.90 to 2.30). This design cannot distinguish it from session"
        " gain" in words
    )
    assert (
        "the error falls from 1.22 % of lift (90 %: 1.17 to 1.28) to 0.43 % (0.41 to 0.45); noise"
        " floor 0.41 %. What remains is noise." in words
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
            "(1.15 to 1.26); noise floor 0.41 %. This change is not significant",
        ),
        ((0.0200, 0.0190, 0.0210), "The correction makes predictions worse"),
        ((0.0080, 0.0078, 0.0082), "It stays above the noise floor"),
    ],
)
def test_words_on_the_error_follow_the_numbers(make_job, after, words):
    def change(found):
        found["error"]["after"] = dict(zip(("held_out_rmse", "lo90", "hi90"), after, strict=True))

    assert words in said(make_job, change)[0]


def test_a_small_change_is_told_from_none_visit_by_visit(make_job):
    def change(found):
        found["error"]["after"] = {"held_out_rmse": 0.0120, "lo90": 0.0115, "hi90": 0.0126}
        found["error"]["change"] = {"value": -0.0164, "lo90": -0.021, "hi90": -0.012}

    words = said(make_job, change)[0]
    assert "falls from 1.22 % of lift" in words
    assert "Visit by visit, the change is \u22121.6 % (90 %: \u22122.1 to \u22121.2)." in words
    assert "change is not significant" not in words


def test_the_chance_of_the_largest_test_is_said(make_job):
    assert (
        "p = 0.43 for the largest of all tests"
        in said(make_job, lambda f: f.update(verdict="adequate", effects=[], p_value=0.43))[0]
    )
    assert (
        "p = 3 × 10⁻⁵ for the largest of all tests."
        in said(make_job, lambda f: f.update(p_value=3e-5))[0]
    )
    assert (
        "p < 10⁻¹² for the largest of all tests."
        in said(make_job, lambda f: f.update(p_value=1e-90))[0]
    )


def test_a_look_before_the_end_is_said(make_job):
    look = {
        "trials": 240,
        "scheduled": 480,
        "p_value_needed": 7e-5,
        "text": "a look at 240 of 480 trials; claims need p < 7e-05",
    }
    words = said(
        make_job, lambda f: f.update(verdict="adequate", effects=[], p_value=0.43, look=look)
    )[0]
    assert "A look at 240 of 480 trials; claims need p < 7e-05. p = 0.43 for" in words


def test_an_adequate_model_is_left_alone_in_words_too(make_job):
    words, _ = said(make_job, lambda f: f.update(verdict="adequate", effects=[], p_value=0.43))
    assert "No effect was added to the model." in words
    assert "follow " not in words
    assert "falls" not in words


def test_the_unexplained_names_covariate_and_shares_but_no_effect(make_job):
    def change(found):
        found.update(
            verdict="unexplained", effects=[], partial=[{"name": "gain_drift", "share": 0.31}]
        )
        found["structure"] = [{"covariate": "start", "p_value": 3.7e-5, "significant": True}]

    words, _ = said(make_job, change)
    assert "The residuals of the base model follow time (p = 3.7 × 10⁻⁵)" in words
    assert "Partial explanations: gain drift (31 % of what exceeds the noise)." in words
    assert "cannot distinguish it from" not in words
    assert "include an unexplained" not in words


def test_the_unexplained_says_along_what_it_is_carried(make_job):
    def change(found):
        found.update(verdict="unexplained", effects=[])
        found["coefficients"]["carried"] = ["distance", "start"]

    words, _ = said(make_job, change)
    assert "their intervals include an unexplained dependence on distance and time" in words


def test_drift_within_records_is_said_with_its_chance(make_job):
    own = {
        "change_over_record": {"value": -0.012, "lo90": -0.014, "hi90": -0.01},
        "p_value": 2e-5,
        "significant": True,
        "candidates": ["motor_heating"],
    }
    words, _ = said(make_job, lambda f: f.update(within_trial=own))
    assert (
        "Within a record, lift changes by −1.2 % (90 %: −1.4 to −1) significantly (p = 2"
        " × 10⁻⁵): motor heating." in words
    )
    calm = {**own, "significant": False, "candidates": []}
    assert ": not significant." in said(make_job, lambda f: f.update(within_trial=calm))[0]


def test_two_effects_that_are_likelier_but_not_plainly_are_told(make_job):
    def change(found):
        found["effects"][0]["rivals"] = ["session_gain", "tilt"]
        found["explanations"] = [["supply_sag"], ["session_gain"], ["supply_sag", "tilt"]]
        found["error"]["chosen_in_folds"] = ["supply_sag", "unexplained", "supply_sag"]

    words, _ = said(make_job, change)
    assert "This design cannot distinguish it from session gain. It is identified because" in words
    assert (
        "Two effects together are slightly likelier: supply sag + tilt. The coefficient’s interval"
        " covers them" in words
    )
    assert "in 2 of 3 folds. The error after is that of each fold's own choice." in words


def test_many_numbers_of_one_effect_are_told_by_their_range(make_job):
    gains = {
        f"gain[{i}]": {"value": 0.01 * (i - 2), "lo90": 0.01 * i - 0.03, "hi90": 0.01 * i - 0.01}
        for i in range(6)
    }

    def change(found):
        found["effects"] = [{"name": "session_gain", "rivals": [], "parameters": gains}]

    words, chapter = said(make_job, change)
    assert "Session gain; 6 values, from −0.020 to 0.030." in words
    assert "Session gain: all 6 numbers" in chapter


def test_a_size_at_its_bound_speaks_against_an_effect(make_job):
    def change(found):
        found["effects"] = [
            {
                "name": "height_scale",
                "rivals": [],
                "parameters": {"z_scale": {"value": -0.1, "lo90": -0.15, "hi90": -0.05}},
            }
        ]

    words, _ = said(make_job, change)
    assert "at its bound" in words
    assert "which makes it doubtful" in words

    def inside(found):
        change(found)
        found["effects"][0]["parameters"]["z_scale"]["value"] = -0.05

    assert "at its bound" not in said(make_job, inside)[0]


def test_candidates_folds_and_proposals_are_told(make_job):
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

    words, chapter = said(make_job, change)
    assert "Every other candidate leaves residual structure or explains too little." in words
    assert "gave the same answer in 2 of 3 folds" in words
    assert "(160 trials, expected 2 ln B = 25). Instead: more visits (3.1)." in words
    rows = Elements(chapter).numbers
    assert any(
        a["data-source"].endswith("/rounds/0/candidates/1/log_evidence") and t == "50"
        for a, t in rows
    )


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
