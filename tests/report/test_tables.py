"""What a paper takes into its LaTeX compiles: by a TeX where there is one, and by a reading as strict as its own for
what tables and paragraphs are made of.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import re
import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest
from matplotlib.mathtext import MathTextParser
from tests.unit import quoted

from nearlift.nomenclature import latex as symbol
from nearlift.report import tables
from nearlift.stages.fit import FIT, RESULTS

WRITTEN = {
    name: lambda evidence, make=make: tables.latex(make(evidence), "about")
    for name, make in tables.TABLES.items()
}
#: Of booktabs, siunitx and LaTeX itself; what else stands in a text came from a file.
KNOWN = set(
    re.findall(
        r"\\[A-Za-z]+",
        r"\begin \end \toprule \midrule \bottomrule \addlinespace \num \qty \numrange \per \metre \newton \par"
        r" \smallskip \footnotesize \cite \chi \infty \nu \Delta \ln \hat \pm \alpha \lambda \gamma \textbackslash"
        r" \textasciitilde \textasciicircum",
    )
)
NUMBER = r"-?\d+(\.\d+)?(\(\d+\))?(e-?\d+)?"
#: A document that has what the texts say they need.
DOCUMENT = r"""\documentclass{article}
\usepackage[utf8]{inputenc}
\usepackage{booktabs, siunitx}
\begin{document}
%s
\end{document}
"""


def written(name, evidence):
    return WRITTEN[name](evidence)


def read(text):
    """Refuse what LaTeX would: an unknown command, a brace or an environment left open, a row with more cells than
    columns, a number that siunitx does not know, mathematics that does not parse, a letter without a definition.
    """
    text = re.sub(r"(?<!\\)%.*", "", text)
    assert not re.findall(r"[^\x00-\x7f\xa1-\xff]", text)
    assert set(re.findall(r"\\[A-Za-z]+", text)) <= KNOWN
    depth = 0
    for one in re.findall(r"\\.|[{}]", text, re.S):
        depth += {"{": 1, "}": -1}.get(one, 0)
        assert depth >= 0
    assert depth == 0
    for number in re.findall(r"\\(?:num|qty)\{([^{}]*)\}", text):
        assert re.fullmatch(rf"{NUMBER}( \+- {NUMBER})?", number), number
    for ends in re.findall(r"\\numrange\{([^{}]*)\}\{([^{}]*)\}", text):
        assert all(re.fullmatch(NUMBER, end) for end in ends), ends
    for formula in re.findall(r"(?<!\\)\$([^$]*)(?<!\\)\$", text):
        inner = re.sub(r"\\num\{([^{}]*)\}", r"\1", formula)
        MathTextParser("path").parse(f"${inner}$")
    opened = []
    for kind, name in re.findall(r"\\(begin|end)\{(\w+)\}", text):
        assert kind == "begin" or opened.pop() == name
        opened += [name] * (kind == "begin")
    assert not opened
    for columns, body in re.findall(
        r"\\begin\{tabular\}\{(\w+)\}(.*?)\\end\{tabular\}", text, re.S
    ):
        for row in body.split(r"\\")[:-1]:
            assert len(re.findall(r"(?<!\\)&", row)) == len(columns) - 1, row
        assert not body.split(r"\\")[-1].replace(r"\bottomrule", "").strip()
    # outside of mathematics and cells these mean something else
    for apart in (
        r"\\begin\{tabular\}|\\end\{tabular\}",
        r"\\cite\{[^}]*\}",
        r"(?<!\\)\$[^$]*(?<!\\)\$",
        r"\\\S",
    ):
        text = re.sub(apart, "", text)
    assert not re.search(r"[_^#~]", text)


@pytest.mark.parametrize("name", WRITTEN)
def test_the_texts_are_read(name, evidence):
    read(written(name, evidence))


@pytest.mark.parametrize(
    "text",
    [
        r"\num{nan}",
        r"\begin{tabular}{ll}a & b & c \\ \end{tabular}",
        r"\begin{tabular}{ll}",
        r"{\par",
        r"\input{x}",
        r"$\alpha_{$",
        "supply_sag",
        "1 − 2",
    ],
)
def test_what_does_not_compile_is_refused(text):
    with pytest.raises((AssertionError, ValueError)):
        read(text)


def test_coefficients_are_set_as_the_nomenclature_has_them(evidence):
    for name in ("coefficients", "budget"):
        text = written(name, evidence)
        for boundary in evidence.boundaries:
            for c in evidence.quoted(boundary).coefficients:
                assert f"${symbol(c)}" in text


def test_an_uncertainty_without_end_compiles_too(evidence):
    content = evidence.document(RESULTS)
    boundless = {"u": None, "dof": None}
    ground = content["boundaries"]["ground"]
    k_b = ground["coefficients"]["K_b"] | boundless
    told = content | {
        "boundaries": content["boundaries"] | {"ground": ground | {"coefficients": {"K_b": k_b}}}
    }
    other = dataclasses.replace(evidence, documents={**evidence.documents, RESULTS.file: told})
    assert math.isinf(other.quoted("ground").coefficients["K_b"].u)
    for name in WRITTEN:
        read(written(name, other))


@pytest.mark.skipif(not shutil.which("pdflatex"), reason="no TeX here")
def test_a_tex_compiles_them(evidence, tmp_path):
    (tmp_path / "all.tex").write_text(
        DOCUMENT % "\n\n".join(written(name, evidence) for name in WRITTEN), encoding="utf-8"
    )
    done = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "all.tex"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:]


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


def test_no_cell_of_a_csv_is_a_formula():
    hostile = {
        "label": np.array(["=1+1", "+x", "-x", "@x", "fine", None], dtype=object),
        "x": np.array([-1.0, np.nan, np.inf, 0, 1, 1 / 3]),
        "known": [True, False, True, True, True, True],
    }
    assert tables.csv(pd.DataFrame(hostile)).decode().splitlines() == [
        "label,x,known",
        "'=1+1,-1,yes",
        "'+x,,no",
        "'-x,,yes",
        "'@x,0,yes",
        "fine,1,yes",
        ",0.333333333,yes",
    ]


def test_text_does_nothing_in_latex():
    assert tables.escaped(r"a_b & 50 % \x") == r"a\_b \& 50 \% \textbackslash{}x"
