"""Coefficients, budget and comparison as LaTeX tables (booktabs, siunitx) and as CSV."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.nomenclature import VERDICTS, mathematics
from nearlift.report.chapters.uncertainty import LEAST
from nearlift.report.evidence import Columns, Evidence, stack
from nearlift.report.figures.budget import fall
from nearlift.report.number import FEW
from nearlift.report.sources import badly_known
from nearlift.results.fit import ModelScore
from nearlift.results.quotation import BudgetLine, CoefficientResult
from nearlift.rounding import decimals, like, siunitx
from nearlift.stages.fit import FIT, RESULTS

SPECIAL = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{c: "\\" + c for c in "&%$#_{}"},
}
COEFFICIENT = (
    "value",
    "u",
    "dof",
    "lo68",
    "hi68",
    "lo90",
    "hi90",
    "lo95",
    "hi95",
    "at_bound",
    "holds",
)
BUDGET = (
    *("source", "type", "distribution", "scope", "u_input", "unit"),
    *("sensitivity", "u", "u_without", "dof"),
)
SCORES = (
    *("visits", "skipped", "elpd", "d_elpd", "u_d_elpd"),
    *("held_out_rmse", "d_held_out_rmse", "u_d_held_out_rmse", "aic", "bic", "r2"),
)
#: Fields of the results that the tables call otherwise: every RMSE here is of visits left out.
FIELDS = {
    "type": "kind",
    "held_out_rmse": "rmse",
    "d_held_out_rmse": "d_rmse",
    "u_d_held_out_rmse": "u_d_rmse",
}
UNITS = {"1": "", "m": r"\metre", "N": r"\newton"}


def coefficients(evidence: Evidence) -> Columns:
    """Every coefficient to be quoted, a row each; `base_model` with `effects` is what it belongs
    to.
    """
    names = ("boundary", "base_model", "verdict", "effects", "parameter", "unit", *COEFFICIENT)
    rows = []
    for boundary in evidence.boundaries:
        quoted = evidence.quoted(boundary)
        for name, c in quoted.coefficients.items():
            rows.append(
                {
                    "boundary": boundary,
                    "base_model": quoted.base_model,
                    "verdict": quoted.verdict,
                    "effects": " + ".join(quoted.effects),
                    "parameter": name,
                    "unit": c.unit,
                    **{field: getattr(c, field) for field in COEFFICIENT},
                }
            )
    return stack(rows, names)


def coefficients_table(evidence: Evidence) -> str:
    r"""LaTeX table of them; needs ``\usepackage{booktabs,siunitx}``."""
    lines = []
    for boundary in evidence.boundaries:
        quoted = evidence.quoted(boundary)
        title = escape(
            " with ".join(
                [catalogue.model(quoted.base_model).title, *(titled(e) for e in quoted.effects)]
            )
        )
        rows = [
            rf"{_equal(mathematics(n))} \num{{{_value(c)}}}$ & {_interval(c)}"
            for n, c in quoted.coefficients.items()
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


def budget(evidence: Evidence) -> Columns:
    """Every source of error of every coefficient that is quoted, a row each; the combined
    uncertainty is a row named so.
    """
    rows: list[dict[str, object]] = []
    for boundary in evidence.boundaries:
        quoted = evidence.quoted(boundary)
        for name, c in quoted.coefficients.items():
            shared = {"boundary": boundary, "model": quoted.base_model, "coefficient": name}
            rows += [{**shared, **_fields(line, BUDGET)} for line in c.budget]
            combined = {"source": "combined", "u": c.u, "u_without": 0.0, "dof": c.dof}
            rows.append({**shared, **combined})
    return stack(rows, ("boundary", "model", "coefficient", *BUDGET))


def comparison(evidence: Evidence) -> Columns:
    """Every model's scores, a row each; `held_out_rmse` in log lift, of visits predicted from all
    others.
    """
    fits = evidence.fits
    rows: list[dict[str, object]] = []
    for boundary, compared in fits.comparison.items():
        for model, scores in compared.models.items():
            fit = fits.boundaries[boundary][model]
            rows.append(
                {
                    "boundary": boundary,
                    "model": model,
                    "base": model == compared.reference,
                    "free": len(fit.parameters),
                    **_fields(scores, SCORES),
                    "log_evidence": fit.log_evidence_value,
                }
            )
    return stack(rows)


def _fields(line: BudgetLine | ModelScore, columns: Sequence[str]) -> dict[str, object]:
    return {name: getattr(line, FIELDS.get(name, name)) for name in columns}


def budget_table(evidence: Evidence) -> str:
    r"""The budgets of the coefficients that are quoted; needs ``\usepackage{booktabs,siunitx}``."""
    lines: list[str] = []
    marked = False
    for boundary in evidence.boundaries:
        for name, coefficient in evidence.quoted(boundary).coefficients.items():
            lines += [r"\addlinespace"] if lines else []
            label = f"{mathematics(name)}, {boundary}"
            few = badly_known(coefficient)
            marked = marked or bool(few)
            for line in sorted(coefficient.budget, key=lambda one: one.u_without):
                if fall(line, coefficient.u) < LEAST and line.kind == "A":
                    # tables/budget.csv has it
                    continue
                lines.append(
                    f"{label} & {escape(titled(line.source))}"
                    f"{FOOTMARK if line.source in few else ''} &"
                    f" {line.kind} & "
                    f"{escape(line.distribution)} & {escape(line.scope)} & {_input(line)} & "
                    rf"{_num(line.u)} & {_num(line.u_without)} & {_dof(line.dof)} \\"
                )
                label = ""
            lines.append(
                rf"{label} & combined ($k = 1$) & & & & & & {_num(coefficient.u)} & &"
                rf" {_dof(coefficient.dof)} \\"
            )
    table = tabular(
        evidence,
        f"uncertainty budget of each coefficient that is quoted, from {RESULTS.file}",
        r"Coefficient & Source & Type & Distribution & Shared by & {Standard uncertainty} &"
        r" {Sensitivity} & {$u$} & {$u$ without} & {$\nu$} \\",
        "lllllrrrrr",
        lines,
    )
    return table + (f"{FOOTNOTE}\n" if marked else "")


FOOTMARK = r"$^{*}$"
FOOTNOTE = (
    rf"\par\smallskip{{\footnotesize {FOOTMARK}\,Fewer than two degrees of freedom: repeats tell"
    r" nothing of this size, "
    "which is what they cannot exclude and no finding.}"
)


def _input(line: BudgetLine) -> str:
    """Standard uncertainty of the input, and the sensitivity to it; two cells."""
    if line.u_input is None or line.sensitivity is None:
        return "& "
    unit = UNITS[line.unit]
    if not unit:
        return rf"\num{{{line.u_input:.3g}}} & \num{{{line.sensitivity:.3g}}}"
    return rf"\qty{{{line.u_input:.3g}}}{{{unit}}} & \qty{{{line.sensitivity:.3g}}}{{\per{unit}}}"


def _num(value: float) -> str:
    return rf"\num{{{value:.2g}}}" if math.isfinite(value) else r"$\infty$"


def _dof(dof: float | None) -> str:
    """Degrees of freedom as text mode has them: one decimal below ten."""
    return (
        rf"\num{{{dof:.{0 if dof >= FEW else 1}f}}}"
        if dof is not None and math.isfinite(dof)
        else r"$\infty$"
    )


def comparison_table(evidence: Evidence) -> str:
    r"""The models of each boundary by held-out score; needs ``\usepackage{booktabs,siunitx}``."""
    lines: list[str] = []
    for i, boundary in enumerate(evidence.boundaries):
        compared = evidence.fits.comparison.get(boundary)
        if not compared:
            continue
        lines += [r"\addlinespace"] if i else []
        models, base = compared.models, compared.reference
        fits = evidence.fits.boundaries[boundary]
        for name in sorted(models, key=lambda n: -np.nan_to_num(models[n].d_elpd)):
            one = models[name]
            title = escape(fits[name].title) + (" (base)" if name == base else "")
            score = (
                r"\num{0}"
                if name == base
                else rf"\num{{{_number(one.d_elpd)} +- {_number(one.u_d_elpd)}}}"
            )
            whole = one.visits == models[base].visits
            excess = [
                rf"\num{{{x - reference:.1f}}}" if whole else "--"
                for x, reference in ((one.aic, models[base].aic), (one.bic, models[base].bic))
            ]
            over = fits[name].log_evidence_value - fits[base].log_evidence_value
            weight = rf"\num{{{over:.1f}}}" if math.isfinite(over) else "--"
            r2 = rf"\num{{{one.r2:.4f}}}" if math.isfinite(one.r2) else "--"
            rest = " & ".join([*excess, weight, r2])
            lines.append(
                rf"{boundary} & {title} & {len(fits[name].parameters)} & {score} &"
                rf" \num{{{100 * one.rmse:.3f}}} & {rest} \\"
            )
    return tabular(
        evidence,
        "models compared; scores are log predictive densities of visits left out, less the base"
        f" model's; from {FIT.file}",
        r"Boundary & Model & {Free} & {$\Delta$ score} & {Held-out RMSE (\%)} & {$\Delta$AIC} &"
        r" {$\Delta$BIC} & {$\Delta \ln Z$} & {$R^2$} \\",
        "llrrrrrrr",
        lines,
    )


def _number(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else "0"


def _equal(name: str) -> str:
    """A name with its sign, within one formula where the name is one."""
    return f"{name[:-1]} =" if name.endswith("$") else f"{name} $="


def _value(c: CoefficientResult) -> str:
    """Value with its uncertainty, where ± describes the interval."""
    return siunitx(c.value, c.u) if c.even else like(c.value, c.u).replace("−", "-")


def _interval(c: CoefficientResult) -> str:
    if not (math.isfinite(c.u) and c.u > 0):
        return "--"
    places = max(decimals(c.u), 0)
    return rf"\numrange{{{c.lo90:.{places}f}}}{{{c.hi90:.{places}f}}}" + (
        " (at bound)" if c.at_bound else ""
    )


def tabular(evidence: Evidence, what: str, header: str, columns: str, lines: Sequence[str]) -> str:
    """Lines of a LaTeX table within its rules, beneath a comment that says what it holds."""
    return "\n".join(
        [
            f"% {' '.join(evidence.campaign.name.split())}: {what}",
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


def escape(text: str) -> str:
    """Text with nothing in it that LaTeX would act upon."""
    return "".join(SPECIAL.get(c, c) for c in text if c.isprintable())
