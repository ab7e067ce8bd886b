"""The coefficients to quote, as a LaTeX table (booktabs, siunitx) and as CSV."""

from __future__ import annotations

import math
from collections.abc import Sequence

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.nomenclature import VERDICTS, mathematics
from nearlift.products import RESULTS
from nearlift.report.evidence import Columns, Evidence, stack
from nearlift.results.quotation import CoefficientResult
from nearlift.rounding import decimals, like, siunitx

SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{c: "\\" + c for c in "&%$#_{}"},
}
FIELDS = ("value", "u", "dof", "lo68", "hi68", "lo90", "hi90", "lo95", "hi95", "at_bound", "holds")


def coefficients(evidence: Evidence) -> Columns:
    """Every coefficient to be quoted, a row each; `base_model` with `effects` is what it belongs
    to.
    """
    names = ("boundary", "base_model", "verdict", "effects", "parameter", "unit", *FIELDS)
    rows = []
    for boundary in evidence.boundaries:
        quoted = evidence.quoted(boundary)
        for name, c in quoted.every.items():
            stated = FIELDS if c.refused is None else ("holds",)
            rows.append(
                {
                    "boundary": boundary,
                    "base_model": quoted.base_model,
                    "verdict": quoted.verdict,
                    "effects": " + ".join(quoted.effects),
                    "parameter": name,
                    "unit": c.unit,
                    **{field: getattr(c, field) for field in stated},
                }
            )
    return stack(rows, names)


def table(evidence: Evidence) -> str:
    r"""The same as a LaTeX table; needs ``\usepackage{booktabs,siunitx}``."""
    lines = []
    for boundary in evidence.boundaries:
        quoted = evidence.quoted(boundary)
        title = escape(
            " with ".join(
                [catalogue.model(quoted.base_model).title, *(titled(e) for e in quoted.effects)]
            )
        )
        rows = [
            rf"{mathematics(n)} refused & "
            if c.refused is not None
            else rf"{_equal(mathematics(n))} \num{{{_value(c)}}}$ & {_interval(c)}"
            for n, c in quoted.every.items()
        ] or ["none & "]
        lines.append(
            f"{boundary} & {title} & {rows[0]} & {escape(VERDICTS[quoted.verdict])} " + r"\\"
        )
        lines += [rf" & & {row} & \\" for row in rows[1:]]
    return tabular(
        evidence,
        f"coefficients to quote, from {RESULTS.file}; standard uncertainties (k = 1) in"
        " parentheses",
        r"Boundary & Model & Coefficient & 90\,\% interval & Verdict \\",
        "lllll",
        lines,
    )


def tabular(evidence: Evidence, what: str, header: str, columns: str, lines: Sequence[str]) -> str:
    """Lines of a LaTeX table within its rules, beneath a comment that says what it holds."""
    return "\n".join(
        [
            f"% {comment(evidence.campaign.name)}: {what}",
            r"% \usepackage{booktabs, siunitx}",
            rf"\begin{{tabular}}{{{columns}}}",
            r"\toprule",
            header,
            r"\midrule",
            *lines,
            r"\bottomrule",
            r"\end{tabular}",
            "",
        ]
    )


def _equal(name: str) -> str:
    """A name with its sign, within one formula where the name is one."""
    return f"{name[:-1]} =" if name.endswith("$") else f"{name} $="


def _value(c: CoefficientResult) -> str:
    """With its uncertainty, where that says the interval."""
    return siunitx(c.value, c.u) if c.even else like(c.value, c.u).replace("−", "-")


def _interval(c: CoefficientResult) -> str:
    if not (math.isfinite(c.u) and c.u > 0):
        return "--"
    places = max(decimals(c.u), 0)
    return rf"\numrange{{{c.lo90:.{places}f}}}{{{c.hi90:.{places}f}}}" + (
        " (at bound)" if c.at_bound else ""
    )


def escape(text: str) -> str:
    """Text with nothing in it that LaTeX would act upon."""
    return "".join(SPECIAL.get(c, c) for c in text if c.isprintable())


def comment(text: str) -> str:
    """Text on one line, as a comment wants it."""
    return " ".join(text.split())
