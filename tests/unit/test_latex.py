"""What a paper takes into its LaTeX compiles: by a TeX where there is one, and by a reading as strict as its own for
what tables and paragraphs are made of.
"""

from __future__ import annotations

import dataclasses
import math
import re
import shutil
import subprocess

import pytest
from matplotlib.mathtext import MathTextParser

from nearlift.nomenclature import latex as symbol
from nearlift.report import tables
from nearlift.report.documents import methods
from nearlift.stages.fit import RESULTS
from nearlift.stages.gathering import gather

WRITTEN = {
    **{
        name: lambda evidence, make=make: tables.latex(make(evidence), "about")
        for name, make in tables.TABLES.items()
    },
    "methods": methods.tex,
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


@pytest.fixture(scope="module")
def evidence(small_job):
    return gather(small_job)


def written(name, evidence):
    text = WRITTEN[name](evidence)
    return text.decode() if isinstance(text, bytes) else text


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
    for name in ("coefficients", "budget", "methods"):
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
