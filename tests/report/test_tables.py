"""Tables of a paper: each number is that of its product, and LaTeX and spreadsheets read them."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
import re

import numpy as np
import pandas as pd
import pytest
from tests.unit import quoted

from nearlift.nomenclature import latex as symbol
from nearlift.report import tables
from nearlift.stages.fit import FIT, RESULTS

#: Commands of booktabs, siunitx and LaTeX itself.
KNOWN = set(
    re.findall(
        r"\\[A-Za-z]+",
        r"\begin \end \toprule \midrule \bottomrule \num \chi \infty \nu \Delta \ln \hat \pm \alpha"
        r" \lambda \gamma \textbackslash \textasciitilde \textasciicircum",
    )
)
NUMBER = r"-?\d+(\.\d+)?(e-?\d+)?"


def written(name, evidence):
    """The table as LaTeX, which is refused where it would not compile: unknown commands, a brace
    left open, a row with more cells than columns, a number that siunitx does not know.
    """
    text = tables.latex(tables.TABLES[name](evidence), "about")
    body = re.sub(r"(?<!\\)%.*", "", text)
    assert not re.findall(r"[^\x00-\x7f\xa1-\xff]", body)
    assert set(re.findall(r"\\[A-Za-z]+", body)) <= KNOWN
    braces = re.findall(r"(?<!\\)[{}]", body)
    assert braces.count("{") == braces.count("}")
    assert all(re.fullmatch(NUMBER, n) for n in re.findall(r"\\num\{([^{}]*)\}", body))
    columns, rows = re.search(
        r"\\begin\{tabular\}\{(\w+)\}(.*)\\end\{tabular\}", body, re.S
    ).groups()
    for row in rows.split(r"\\")[:-1]:
        assert len(re.findall(r"(?<!\\)&", row)) == len(columns) - 1, row
    outside = re.sub(r"(?<!\\)\$[^$]*(?<!\\)\$|\\\S", "", body)
    assert not re.search(r"[_^#~$]", outside)
    return text


@pytest.mark.parametrize("name", tables.TABLES)
def test_latex_reads_them_also_without_an_end_of_an_uncertainty(name, evidence):
    text = written(name, evidence)
    if name != "comparison":
        for boundary in evidence.boundaries:
            assert all(f"${symbol(c)}" in text for c in evidence.quoted(boundary).coefficients)
    content = evidence.document(RESULTS)
    ground = content["boundaries"]["ground"]
    k_b = ground["coefficients"]["K_b"] | {"u": None, "dof": None}
    boundless = content | {
        "boundaries": content["boundaries"] | {"ground": ground | {"coefficients": {"K_b": k_b}}}
    }
    documents = {**evidence.documents, RESULTS.file: boundless}
    other = dataclasses.replace(evidence, documents=documents)
    assert math.isinf(other.quoted("ground").coefficients["K_b"].u)
    written(name, other)


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
    variance = sum(float(r["u"]) ** 2 for r in rows[:-1])
    assert variance == pytest.approx(float(rows[-1]["u"]) ** 2, rel=1e-6)
    assert float(rows[-1]["u"]) == pytest.approx(own.u, rel=1e-8)
    combined = rf"combined &  &  &  &  &  & \num{{{own.u:.3g}}}"
    assert combined in tables.latex(tables.budget(evidence), "budget")


def test_the_comparison_as_csv_and_latex(evidence):
    known, _ = quoted.fitted(evidence, "ground")
    fits = known.document(FIT)["boundaries"]["ground"]
    fits["sanchez_cuevas"]["log_evidence"] = {"value": 10.0, "u": 0.1}
    fits["power_law"]["log_evidence"] = {"value": 7.5, "u": 0.1}
    del fits["exponential"]["log_evidence"]
    table = tables.comparison(known)
    rows = {r["model"]: r for r in rows_of(table) if r["boundary"] == "ground"}
    own = known.document(FIT)["comparison"]["ground"]["models"]
    assert set(rows) == set(own) >= {"cheeseman_bennett", "sanchez_cuevas_published", "power_law"}
    assert rows["sanchez_cuevas"]["base"] == "yes"
    assert rows["sanchez_cuevas_published"]["free"] == "0"
    score = own["cheeseman_bennett"]["d_elpd"]
    assert float(rows["cheeseman_bennett"]["d_elpd"]) == pytest.approx(score, rel=1e-8)
    # evidence is shown where it was computed
    ground = table.frame[table.frame["boundary"] == "ground"].set_index("model")["log_evidence"]
    assert (ground["power_law"].text, ground["exponential"].text) == ("−2.5", "–")
    assert rows["power_law"]["log_evidence"] == "7.5"
    text = tables.latex(table, "models")
    assert r"\num{-2.5}" in text
    assert r"Sanchez-Cuevas, K\_b = 2" in text


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
