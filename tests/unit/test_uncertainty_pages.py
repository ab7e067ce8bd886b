"""Budget bars, profile plots, tables and chapters, from a small campaign that was really fitted."""

from __future__ import annotations

import copy
import csv
import dataclasses
import io
import math
import re
import shutil
import subprocess

import numpy as np
import pytest

from nearlift.nomenclature import mathematics
from nearlift.report import tables
from nearlift.report.chapters import models, uncertainty
from nearlift.report.figures import budget, profiles
from nearlift.report.figures.files import render
from nearlift.report.figures.style import Style
from nearlift.report.number import Place
from nearlift.results.fit import CoefficientEstimate, Degeneracy, ModelScore
from nearlift.results.quotation import BudgetLine
from nearlift.stages.fit import FIT, PROFILES, RESULTS
from nearlift.stages.gathering import gather

from . import quoted


@pytest.fixture(scope="module")
def evidence(small_job):
    return gather(small_job)


def base(evidence, boundary):
    return evidence.base(boundary)[1]


def test_the_document_says_what_the_fit_knows(evidence):
    content = evidence.document(FIT)
    for boundary, fits in content["boundaries"].items():
        for c in evidence.quoted(boundary).coefficients.values():
            assert math.hypot(*(line.u for line in c.budget)) == pytest.approx(c.u, rel=1e-6)
            assert all(0 <= line.u_without <= c.u * (1 + 1e-9) for line in c.budget)
            assert all(
                abs(line.sensitivity) * line.u_input == pytest.approx(line.u, rel=1e-6)
                for line in c.budget
            )
        for entry in fits.values():
            assert "heights" not in entry
        own = content["comparison"][boundary]
        assert own["reference"] == content["base"][boundary]
        assert set(own["models"]) == set(fits)


def test_rivals_are_linearised_about_the_height_error_of_the_base(evidence):
    fits = evidence.document(FIT)["boundaries"]["ceiling"]
    found = base(evidence, "ceiling").height_error
    assert all(("height_error" in entry) == (found is not None) for entry in fits.values())


def test_profiles_are_stored(evidence):
    table = evidence.table(PROFILES)
    entry = base(evidence, "ground")
    mine = (
        (table["boundary"] == "ground")
        & (table["model"] == "sanchez_cuevas")
        & (table["parameter"] == "K_b")
    )
    x, rise = table["value"][mine], table["rise"][mine]
    assert (np.diff(x) > 0).all()
    assert rise.min() == 0
    assert np.interp(entry.profiles["K_b"].hi95, x, rise) == pytest.approx(3.9, abs=0.2)


def test_bars_are_what_knowing_a_source_would_save(evidence):
    rows = budget.table(evidence)
    for panel, name in set(zip(rows["panel"], rows["parameter"], strict=True)):
        mine = (rows["panel"] == panel) & (rows["parameter"] == name)
        whole = evidence.quoted(panel).coefficients[name].u
        np.testing.assert_allclose(
            rows["fall_percent"][mine], 100 * (1 - rows["u_without"][mine] / whole), atol=1e-9
        )
    text = budget.caption(evidence, rows)
    assert "K_b (ground): " in text
    render(budget.draw, rows, Style())
    assert tables.csv(rows).startswith(b"panel,parameter,component,type,fall_percent,u,u_without\n")


def test_of_repeats_only_what_matters_somewhere_is_drawn_and_what_was_declared_always(evidence):
    def line(name, fall, kind):
        return BudgetLine(source=name, kind=kind, u=1.0, u_without=2.0 * (1 - fall))

    own = dataclasses.replace(evidence.quoted("ground").coefficients["K_b"], u=2.0)
    lines = (line("large", 0.9, "A"), line("small", 0.0015, "A"), line("declared", 1e-9, "B"))
    ground = dataclasses.replace(own, budget=lines)
    ceiling = dataclasses.replace(own, budget=(line("large", 1.0, "A"),))
    bars = budget.bars([("ground", "K_b", ground), ("ceiling", "alpha", ceiling)])
    assert list(zip(bars["panel"], bars["component"], bars["type"], strict=True)) == [
        ("ground", "large", "A"),
        ("ground", "declared", "B"),
        ("ceiling", "large", "A"),
    ]
    assert bars["fall_percent"].tolist() == pytest.approx([90.0, 0.0, 100.0], abs=1e-6)


def test_profiles_are_drawn_with_their_intervals(evidence):
    rows = profiles.table(evidence)
    mine = (rows["parameter"] == "K_b") & (rows["kind"] == "90")
    own = base(evidence, "ground").profiles["K_b"]
    assert rows["x"][mine].tolist() == [own.lo90, own.hi90]
    assert rows["rise"][mine].tolist() == pytest.approx([2.74, 2.74], abs=0.1)
    text = profiles.caption(evidence, rows)
    assert re.search(r"[TU](he parabola suffices for|pper over lower half)", text)
    files = render(profiles.draw, rows, Style())
    assert set(files) == {"pdf", "png"}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("K_b", "$K_b$"),
        ("alpha", r"$\alpha$"),
        ("lambda_", r"$\lambda$"),
        ("n", "$n$"),
        ("inverse_K_b", "$1/K_b$"),
        ("slope", "slope"),
    ],
)
def test_coefficients_as_mathematics(name, text):
    assert mathematics(name) == text


def rows_of(table):
    return list(csv.DictReader(io.StringIO(tables.csv(table.frame).decode())))


def test_the_budget_as_csv_and_latex(evidence):
    rows = [
        r
        for r in rows_of(tables.budget(evidence))
        if (r["model"], r["coefficient"]) == ("sanchez_cuevas", "K_b")
    ]
    own = evidence.quoted("ground").coefficients["K_b"]
    assert [r["source"] for r in rows] == [*(line.source for line in own.budget), "combined"]
    assert sum(float(r["u"]) ** 2 for r in rows[:-1]) == pytest.approx(
        float(rows[-1]["u"]) ** 2, rel=1e-6
    )
    assert float(rows[-1]["u"]) == pytest.approx(own.u, rel=1e-8)
    text = tables.latex(tables.budget(evidence), "budget")
    assert text.count(r"\begin{tabular}") == text.count(r"\end{tabular}") == 1
    assert rf"combined &  &  &  &  &  & \num{{{own.u:.3g}}}" in text


def test_what_was_declared_keeps_its_line_however_small(evidence):
    """A declared component that does nothing is an answer too; and what half a degree of freedom
    says is called no finding.
    """
    content = copy.deepcopy(evidence.document(RESULTS))
    known = dataclasses.replace(evidence, documents={**evidence.documents, RESULTS.file: content})
    own = content["boundaries"]["ground"]["coefficients"]["K_b"]
    declared = next(line for line in own["budget"] if line["type"] == "B")
    declared |= {"u": 1e-6, "u_without": own["u"]}
    first = next(line for line in own["budget"] if line["type"] == "A")
    first |= {"dof": 0.5}
    whole = tables.budget(known)
    text = tables.latex(whole, "budget")
    row = next(line for line in text.splitlines() if declared["source"] in line)
    for part in (
        declared["distribution"],
        declared["scope"],
        rf"\num{{{own['u']:.2g}}}",
        r"$\infty$",
    ):
        assert part in row
    lines = whole.frame[(whole.frame["coefficient"] == "K_b") & whole.main]
    mine = lines[lines["source"] == declared["source"]].iloc[0]
    assert mine["u_without"].value == own["u"]
    (limits,) = re.findall(r"upper limits only: ([^<]*)\.", uncertainty.budget(known))[:1]
    assert first["source"] in limits
    assert declared["source"] in budget.table(known)["component"].tolist()


def test_the_comparison_as_csv_and_latex(evidence):
    rows = {
        r["model"]: r for r in rows_of(tables.comparison(evidence)) if r["boundary"] == "ground"
    }
    own = evidence.document(FIT)["comparison"]["ground"]["models"]
    assert (
        set(rows)
        == set(own)
        >= {
            "cheeseman_bennett_fixed",
            "cheeseman_bennett",
            "sanchez_cuevas_published",
            "sanchez_cuevas_as_printed",
            "exponential",
            "power_law",
        }
    )
    assert rows["sanchez_cuevas"]["base"] == "yes"
    assert rows["sanchez_cuevas_published"]["free"] == "0"
    assert float(rows["cheeseman_bennett"]["d_elpd"]) == pytest.approx(
        own["cheeseman_bennett"]["d_elpd"], rel=1e-8
    )
    text = tables.latex(tables.comparison(evidence), "models")
    assert r"Sanchez-Cuevas, K\_b = 2" in text


def test_evidence_is_shown_where_it_was_computed(evidence):
    known, _ = quoted.fitted(evidence, "ground")
    fits = known.document(FIT)["boundaries"]["ground"]
    fits["sanchez_cuevas"]["log_evidence"] = {"value": 10.0, "u": 0.1}
    fits["power_law"]["log_evidence"] = {"value": 7.5, "u": 0.1}
    del fits["exponential"]["log_evidence"]
    table = tables.comparison(known)
    ground = table.frame[table.frame["boundary"] == "ground"].set_index("model")
    assert ground.loc["power_law", "log_evidence"].text == "−2.5"
    assert ground.loc["exponential", "log_evidence"].text == "–"
    assert r"\num{-2.5}" in tables.latex(table, "models")
    assert next(r for r in rows_of(table) if r["model"] == "power_law")["log_evidence"] == "7.5"


def test_chapters_say_it_in_words(evidence):
    assert "proportional scatter" in uncertainty.budget(evidence)
    text = uncertainty.limits(evidence)
    assert text.startswith("<p>Ground: how to reduce the uncertainty of the base fit</p>")
    assert "would halve <i>u</i>" in text or "would halve u(" in text or " instead of " in text


def score(visits=50, **known):
    said_nothing = dict.fromkeys(("elpd", "rmse", "d_rmse", "u_d_rmse"), math.nan)
    return ModelScore(visits=visits, skipped=0, **said_nothing, **known)


MODELS = {
    "base": score(d_elpd=0.0, u_d_elpd=0.0, r2=0.98),
    "close": score(d_elpd=-1.0, u_d_elpd=0.2, r2=0.95),
    "wrong": score(d_elpd=-30.0, u_d_elpd=6.0, r2=0.97),
    "right": score(d_elpd=20.0, u_d_elpd=5.0, r2=0.96),
    "short": score(visits=40, d_elpd=-30.0, u_d_elpd=6.0, r2=0.5),
}


def words(*names):
    return uncertainty.verdicts(
        {n: MODELS[n] for n in names}, "base", {n: n.title() for n in names}
    )


def test_what_prediction_says_in_words():
    everything = words(*MODELS)
    assert everything == [
        (
            "Better than the base: Right (20.0, 95 %: 10.0 to 30.0). The 95 % interval of the score"
            " difference over visits excludes zero."
        ),
        "Prediction does not distinguish these from the base: Close (−1.0, 95 %: −1.4 to −0.6).",
        (
            "Worse: Wrong (−30.0, 95 %: −42.1 to −17.9). The 95 % interval of the score difference"
            " over visits excludes zero."
        ),
        (
            "R² cannot decide: it is above 0.9 for 4 of 5 models, Wrong among them (0.97), which"
            " prediction rejects."
        ),
    ]
    assert words("base", "wrong")[1] == "No other model predicts as well as the base."
    assert words("base", "close")[1].startswith(
        "R² distinguishes Close from the base although prediction does not"
    )
    assert words("base", "short") == []
    close = {
        n: dataclasses.replace(MODELS[n], aic=aic) for n, aic in (("base", 100.0), ("close", 146.0))
    }
    told = uncertainty.verdicts(close, "base", {n: n.title() for n in close})
    assert told[1].startswith("AIC disagrees: Close 46 behind the base.")
    close["close"] = dataclasses.replace(MODELS["close"], aic=108.0)
    assert not any(
        "AIC" in t for t in uncertainty.verdicts(close, "base", {n: n.title() for n in close})
    )


def test_the_budget_is_that_of_what_is_quoted(evidence):
    after = {"value": 2.5, "lo90": 2.4, "hi90": 2.6}
    named = {
        "verdict": "effect",
        "effects": [{"name": "supply_sag"}],
        "coefficients": {"after": {"K_b": after}},
    }
    known = quoted.known(evidence, {"boundaries": {"ground": named}})
    text = re.sub("<[^>]+>", "", uncertainty.budget(known))
    assert "Ground: Kb = 2.50 ± 0.06" in text
    row = models.comparison(known).partition("(base)")[2].partition("</tr>")[0]
    assert re.findall(r'<data value="2.5" data-source="([^#]*)', row) == [RESULTS.file]


def test_few_degrees_of_freedom_are_not_rounded_away(evidence):
    content = {"a": {"dof": 0.53}, "b": {"dof": 12.34}, "c": {"dof": None}}
    known = dataclasses.replace(evidence, documents={FIT.file: content})
    found = [Place(known, FIT).degrees(k, "dof") for k in "abc"]
    assert [n and n.text for n in found] == ["0.5", "12", None]


def test_degeneracies_of_a_group_are_one_sentence():
    parameters = {
        n: CoefficientEstimate(value=1.0, u=u, lo90=0.0, hi90=2.0, dof=math.inf)
        for n, u in (("a", 0.033), ("p", 0.19))
    }
    levels = [
        Degeneracy(pair=(n, f"L_inf at {t}%"), r=r, text="")
        for t in (25, 50, 92)
        for n, r in (("a", -0.984), ("p", 0.96))
    ]
    free = [
        Degeneracy(pair=(n, "height offset"), r=r, text="", u_if_free=u, known_to="43 mm")
        for n, r, u in (("a", 0.963, 0.12), ("p", 0.987, 1.1))
    ]
    own = Degeneracy(pair=("a", "p"), r=0.99, text="a and p are confounded: r = +0.990")
    blind = Degeneracy(
        pair=("a", "exponent n"),
        r=1.0,
        text="a and the exponent n are not distinguishable in these trials",
    )
    would = "would be confounded with an unknown height offset"
    assert models.grouped([own, *levels, *free, blind], parameters) == [
        own.text,
        "a (r = −0.984) and p (r = +0.960) are confounded with L_inf at 25%, 50%, 92% throttle",
        (
            f"a (r = +0.963, u from 0.033 to 0.12) and p (r = +0.987, u from 0.19 to 1.1) {would}"
            " (u = 43 mm)"
        ),
        blind.text,
    ]
    assert models.grouped([dataclasses.replace(free[0], text="alone")], parameters) == ["alone"]


@pytest.mark.skipif(not shutil.which("pdflatex"), reason="pdflatex is not installed")
def test_the_tables_compile(evidence, tmp_path):
    found = subprocess.run(
        ["kpsewhich", "siunitx.sty", "booktabs.sty"], capture_output=True, text=True, check=False
    )
    if len(found.stdout.split()) < 2:
        pytest.skip("pdflatex has no siunitx or no booktabs")
    parts = {name: tables.latex(make(evidence), name) for name, make in tables.TABLES.items()}
    for name, text in parts.items():
        (tmp_path / f"{name}.tex").write_text(text, encoding="utf-8")
    whole = "\n".join(rf"\input{{{name}}}\newpage" for name in parts)
    document = rf"\documentclass{{article}}\usepackage{{booktabs,siunitx}}\begin{{document}}{whole}\end{{document}}"
    (tmp_path / "all.tex").write_text(document, encoding="utf-8")
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "all.tex"]
    ran = subprocess.run(
        command,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=120,
    )
    assert ran.returncode == 0, ran.stdout[-2000:]
    assert "3 pages" in ran.stdout
