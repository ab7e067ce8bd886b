"""Whatever prints a coefficient of a campaign prints the one that is quoted; another number stands
only behind its condition.
"""

from __future__ import annotations

import csv
import html
import io
import json
import re

import pytest
from tests.unit import small_run, verdicts

from nearlift import comparison
from nearlift.report.phrases import coefficient_text
from nearlift.results.quotation import Results
from nearlift.rounding import like, plus_minus
from nearlift.stages import export, report
from nearlift.stages.diagnose import findings
from nearlift.study import Diagnosis

#: A coefficient and a value: ``K_b = 2.0``, ``$K_b = \num{2.0(2)}$``, ``K_b (ground) = 2``.
SAID = re.compile(r"(?<![\w/])K_?b\$?\s*[=≈]\s*(?:\\num\{)?([−-]?\d+(?:\.\d+)?)")


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(name, marks=[pytest.mark.nightly] * (name in ("adequate", "unexplained")))
        for name in verdicts.MADE
    ],
)
def job(request, make_job):
    made = make_job(("ground",), diagnosed=True, **verdicts.MADE[request.param])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("nearlift.report.figures.files.render", small_run.undrawn)
        report.run(made)
    (made.root / "campaign.toml").write_text("")
    export.export(made, ("c", "document", "python"))
    return made


@pytest.fixture
def quoted(job):
    return job.load(Results).boundaries["ground"]


def visible(page: str) -> str:
    """Text of the page without its chart data, and without what is folded behind a condition or is
    another model's.
    """
    page = re.sub(r"<(script|style)\b.*?</\1>", " ", page, flags=re.S)
    page = re.sub(
        r"<details><summary>The base fit’s coefficient at each exponent.*?</details>"
        r"|<caption>What it would be, and if what.*?</table>",
        " ",
        page,
        flags=re.S,
    )
    page = re.sub(
        r"<tr>(?:(?!</tr>).)*</tr>", " ", page, flags=re.S
    )  # of the tables of models, only the base's row is marked
    page = re.sub(r'alt="([^"]*)"', r">\1<", page)
    return html.unescape(re.sub(r"<[^>]+>", "", page))


def test_the_page_says_one_number(job, quoted):
    c = quoted.coefficients["K_b"]
    text = visible((job.reports / "index.html").read_text())
    # conditions are said in captions as such
    said = SAID.findall(
        re.sub(r"\bif \(1\).*?\.(?=\s|$)|if [^.;]*: [−\d.]+, 90 %[^.]*\.\d*", " ", text)
    )
    assert len(said) >= 3
    # the literature's value, K_b = 2, is drawn and named too
    assert set(said) - {"2"} == {plus_minus(c.value, c.u).partition(" ")[0]}


def test_every_document_says_one_number(job, quoted):
    c = quoted.coefficients["K_b"]
    value, low, high = (like(x, c.u) for x in (c.value, c.lo90, c.hi90))
    (row,) = re.findall(
        r"& \$K_b\$ & (.*?) & [^&]*\\\\", (job.reports / "tables/coefficients.tex").read_text()
    )
    cells = [rf"\num{{{x}}}" for x in (value, low, high)]
    assert [cell for cell in row.split(" & ") if cell != row.split(" & ")[1]] == cells
    text = (job.reports / "methods.md").read_text()
    assert set(SAID.findall(text)) == {value}
    assert f"{low} to {high}" in text
    (row,) = csv.DictReader(io.StringIO((job.reports / "tables/coefficients.csv").read_text()))
    assert [float(row[k]) for k in ("value", "lo90", "hi90")] == pytest.approx(
        [c.value, c.lo90, c.hi90], rel=1e-8
    )


def test_exports_say_one_number(job, quoted):
    c = quoted.coefficients["K_b"]
    # where effects are identified, the likeliest explanation's value, not the mean over rivals
    accepted = findings(job.processed)["ground"].accepted if quoted.effects else None
    c = accepted.parameters["K_b"] if accepted else c
    told = f"K_b = {c.value:.6g} (90 %: {c.lo90:.6g} to {c.hi90:.6g})"
    folder = job.processed / "export"
    assert told in (folder / "lift_model.h").read_text()
    document = json.loads((folder / "lift_model.json").read_text())
    text = json.dumps(document)
    assert all(repr(x) in text for x in (c.value, c.lo90, c.hi90))


def test_a_comparison_and_a_notebook_say_one_number(job, quoted):
    c = quoted.coefficients["K_b"]
    (entry,) = comparison.entries(job.processed)
    assert repr(entry.quoted) == repr(c)  # by their text: NaN differs from itself
    none = {"trials": None, "residuals": None, "notes": ()}
    loop = Diagnosis(campaign="small", boundaries={}, quoted={"ground": quoted}, **none)
    assert coefficient_text(c, "K_b") in str(loop)
    assert len(re.findall(r"± ", str(loop))) == 1
