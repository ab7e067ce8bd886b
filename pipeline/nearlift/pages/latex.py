"""Coefficients as a LaTeX table (booktabs, siunitx) and as CSV."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from nearlift.products import FIT
from nearlift.rounding import siunitx
from nearlift.summaries.evidence import Columns, Evidence

SYMBOLS = {"alpha": r"\alpha", "lambda_": r"\lambda", "inverse_K_b": "1/K_b"}
SPECIAL = {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", **{c: "\\" + c for c in "&%$#_{}"}}
FIELDS = (
    "boundary",
    "model",
    "base",
    "parameter",
    "unit",
    "value",
    "u",
    "lo90",
    "hi90",
    "at_bound",
    "chi2",
    "dof",
    "n_trials",
    "in_sample_rmse_percent",
    "aic",
    "bic",
)


def coefficients(evidence: Evidence) -> Columns:
    """Every fitted parameter of every model, a row each."""
    content = evidence.document(FIT)
    rows = []
    for boundary in evidence.boundaries:
        for model, fit in content["boundaries"][boundary].items():
            for name, e in fit["parameters"].items():
                estimate = (e["value"], e["u"], e["lo90"], e["hi90"])
                quality = (float(fit["chi2"]), int(fit["dof"]), int(fit["n_trials"]), 100 * float(fit["rmse"]), float(fit["aic"]), float(fit["bic"]))
                numbers = (math.nan if x is None else float(x) for x in estimate)
                rows.append((boundary, model, model == content["base"][boundary], name, e["unit"], *numbers, bool(e["at_bound"]), *quality))
    return {name: np.array([row[i] for row in rows], dtype=object) for i, name in enumerate(FIELDS)}


def table(evidence: Evidence) -> str:
    r"""The same as a LaTeX table; needs ``\usepackage{booktabs,siunitx}``."""
    content = evidence.document(FIT)
    lines = [
        f"% {comment(evidence.campaign.name)}: least-squares fits, from {FIT.file}; standard uncertainties in parentheses",
        r"% \usepackage{booktabs, siunitx}",
        r"\begin{tabular}{llllrr}",
        r"\toprule",
        r"Boundary & Model & Coefficient & 90\,\% interval & $\chi^2/\nu$ & {In-sample RMSE (\%)} \\",
        r"\midrule",
    ]
    for i, boundary in enumerate(evidence.boundaries):
        if i:
            lines.append(r"\addlinespace")
        fits = content["boundaries"][boundary]
        base = content["base"][boundary]
        for model in sorted(fits, key=lambda m: (m != base, fits[m]["aic"])):
            lines += _model(boundary, fits[model], model == base)
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", ""])


def _model(boundary: str, fit: dict[str, Any], base: bool) -> list[str]:
    title = escape(fit["title"]) + (" (base)" if base else "")
    reduced = fit["chi2"] / fit["dof"] if fit["dof"] else math.nan
    quality = rf"\num{{{reduced:.2f}}} & \num{{{100 * fit['rmse']:.2f}}} \\"
    rows = []
    for name, e in fit["parameters"].items():
        u = e["u"] if e["u"] is not None else math.nan
        rows.append(rf"${SYMBOLS.get(name, name)} = \num{{{siunitx(e['value'], u)}}}$ & {_interval(e, u)}")
    rows = rows or ["none & "]
    first = f"{boundary} & {title} & {rows[0]} & {quality}"
    return [first, *(rf" & & {row} & & \\" for row in rows[1:])]


def _interval(e: dict[str, Any], u: float) -> str:
    if not (math.isfinite(u) and u > 0):
        return "--"
    from nearlift.rounding import decimals

    places = max(decimals(u), 0)
    return rf"\numrange{{{e['lo90']:.{places}f}}}{{{e['hi90']:.{places}f}}}" + (" (at bound)" if e["at_bound"] else "")


def escape(text: str) -> str:
    """Text with nothing in it that LaTeX would act upon."""
    return "".join(SPECIAL.get(c, c) for c in text if c.isprintable())


def comment(text: str) -> str:
    """Text on one line, as a comment wants it."""
    return " ".join(text.split())
