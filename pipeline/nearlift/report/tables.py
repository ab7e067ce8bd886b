"""Tables of a report: one DataFrame each, from it HTML for the page, LaTeX with siunitx, and CSV.

A cell is a number of a product (`Number`), a plain value, or a name that the page and LaTeX spell
out. CSV has every column, at nine digits; page and LaTeX show those in `shown`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from nearlift import catalogue
from nearlift.catalogue import titled
from nearlift.declare import Boundary
from nearlift.nomenclature import VERDICTS, letter, mathematics
from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place, quotation
from nearlift.report.phrases import SCALES, is_even
from nearlift.results.quotation import BudgetLine
from nearlift.stages.fit import FIT, RESULTS

#: A text cell that begins with one of these is a formula to a spreadsheet.
FORMULA = ("=", "+", "-", "@", "\t", "\r")
#: A source from repeats that would lower the uncertainty by a smaller part is in the CSV only.
MIN_FALL = 0.0005
SPECIAL = (
    {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
    | {c: "\\" + c for c in "&%$#_{}"}
    | {"Δ": r"$\Delta$", "ν": r"$\nu$", "∞": r"$\infty$", "χ": r"$\chi$", "ẑ": r"$\hat z$"}
    | {"α": r"$\alpha$", "λ": r"$\lambda$", "−": "$-$", "–": "--", "±": r"$\pm$"}
)
DIGITS = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
#: Columns whose cells are symbols.
SYMBOLS = ("parameter", "coefficient")
EMPTY = Number(text="", value=math.nan, source="")


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table with its caption. `shown` has the heading of each column on page and paper, `main`
    the rows there; None for all.
    """

    caption: str
    frame: pd.DataFrame
    shown: Mapping[str, str]
    main: Any = None

    @property
    def printed(self) -> pd.DataFrame:
        """Rows and columns of page and paper."""
        rows = self.frame if self.main is None else self.frame[self.main]
        return rows[list(self.shown)].astype(object)


def csv(table: pd.DataFrame) -> bytes:
    """UTF-8 text with line feeds. Values without end are left empty, and no cell is a formula to a
    spreadsheet.
    """
    frame = table.copy()
    for name, column in table.items():
        if column.dtype.kind == "f":
            frame[name] = column.where(np.isfinite(column))
        elif isinstance(column.dtype, pd.StringDtype):
            # a figure's table has few texts, each many times
            frame[name] = column.map({text: _cell(text) for text in column.dropna().unique()})
        else:
            frame[name] = [_cell(value) for value in column]
    return frame.to_csv(index=False, lineterminator="\n", float_format="%.9g").encode()


def _cell(value: Any) -> str:
    value = value.value if isinstance(value, Number) else value
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float | np.floating):
        return f"{value:.9g}" if math.isfinite(value) else ""
    text = "" if value is None else str(value)
    return f"'{text}" if text.startswith(FORMULA) and not isinstance(value, int) else text


def html(table: Table, heading: Markup | str) -> Markup:
    """The table as the page has it, each number with its product and key."""
    cells = [
        [
            v if hasattr(v, "__html__") else _word(n, v)
            for n, v in zip(table.shown, row, strict=True)
        ]
        for row in table.printed.to_numpy()
    ]
    return blocks.table(heading, list(table.shown.values()), cells)


def latex(table: Table, about: str) -> str:
    r"""The table for a paper; needs ``\usepackage{booktabs, siunitx}``."""
    frame = table.printed
    style = frame.style.hide(axis="index")
    style = style.format({n: (lambda v, n=n: _in_latex(n, v)) for n in frame})  # type: ignore[misc]
    style.relabel_index([escaped(h) for h in table.shown.values()], axis="columns")
    rows = table.frame[list(table.shown)].to_numpy(dtype=object)
    kinds = [isinstance(v, Number | int | np.integer) for row in rows[:1] for v in row]
    text = style.to_latex(hrules=True, column_format="".join("lr"[k] for k in kinds) or None)
    return f"% {' '.join(about.split())}\n% \\usepackage{{booktabs, siunitx}}\n{text}"


def _in_latex(column: str, value: Any) -> str:
    if isinstance(value, Number):
        return DIGITS.sub(lambda m: rf"\num{{{m[0]}}}", escaped(value.text.replace("−", "-")))
    return mathematics(str(value)) if column in SYMBOLS else escaped(_word(column, value))


def _word(column: str, value: Any) -> str:
    """A cell that is no number, spelled out."""
    if column in SYMBOLS:
        return letter(str(value))
    if column in ("model", "base_model"):
        return catalogue.model(str(value)).title
    return VERDICTS[value] if column == "verdict" else titled(str(value))


def escaped(text: str) -> str:
    """Text with nothing in it that LaTeX would act upon."""
    return "".join(SPECIAL.get(c, c) for c in text if c.isprintable())


# the tables that are files too


def coefficients(evidence: Evidence) -> Table:
    """Every coefficient to quote; `base_model` with `effects` is the model that it belongs to."""
    rows = []
    for boundary in evidence.boundaries:
        quoted = evidence.quoted(boundary)
        for name, c in quoted.coefficients.items():
            place = quotation(evidence, boundary, name)
            known = {k: place.number(k, like_u=c.u) for k in ("value", "u", "lo90", "hi90")}
            if not is_even(c):
                known["u"] = replace(known["u"], text="")
            rows.append(
                {
                    "boundary": boundary,
                    "base_model": quoted.base_model,
                    "trials": evidence.base(boundary)[1].n_trials,
                    "verdict": quoted.verdict,
                    "effects": " + ".join(quoted.effects),
                    "parameter": name,
                    "unit": c.unit,
                    **{k: known.get(k, getattr(c, k)) for k in COEFFICIENT},
                }
            )
    return Table(
        caption=f"Coefficients to quote, from {RESULTS.file}; standard uncertainties (k = 1)",
        frame=pd.DataFrame(rows, columns=[*DESCRIBED, *COEFFICIENT]),
        shown={"boundary": "boundary", "base_model": "model", "effects": "with"}
        | {"parameter": "coefficient", "value": "value", "u": "u", "lo90": "90 % from"}
        | {"hi90": "to", "verdict": "verdict"},
    )


DESCRIBED = ("boundary", "base_model", "trials", "verdict", "effects", "parameter", "unit")
COEFFICIENT = (
    *("value", "u", "dof", "lo68", "hi68", "lo90", "hi90", "lo95", "hi95"),
    *("at_bound", "holds"),
)


def fall(line: BudgetLine, u: float) -> float:
    """Part of a coefficient's standard uncertainty `u` that goes if the source is known exactly."""
    return 1.0 - line.u_without / u if np.isfinite(u) else 0.0


def budget(evidence: Evidence) -> Table:
    """Every source of error of every coefficient to quote, the most important first; the combined
    uncertainty is a row named so.
    """
    rows: list[dict[str, object]] = []
    for boundary in evidence.boundaries:
        quoted = evidence.quoted(boundary)
        for name, c in quoted.coefficients.items():
            head = dict.fromkeys(BUDGET, "") | {"u_input": EMPTY, "sensitivity": EMPTY}
            head |= {"boundary": boundary, "model": quoted.base_model, "coefficient": name}
            place = quotation(evidence, boundary, name)
            for i, line in sorted(enumerate(c.budget), key=lambda pair: pair[1].u_without):
                main = line.kind != "A" or fall(line, c.u) >= MIN_FALL
                rows.append(head | _source(place.at("budget", i), line) | {"main": main})
            combined = {"source": "combined", "u": place.number("u", digits=3), "main": True}
            # known exactly, nothing is left
            nothing = {"u_without": replace(EMPTY, value=0.0, source=place.source("u"))}
            rows.append(head | combined | nothing | {"dof": place.degrees("dof")})
    frame = pd.DataFrame(rows, columns=[*BUDGET, "main"], dtype=object)
    return Table(
        caption=f"Uncertainty budget of each coefficient to quote, from {RESULTS.file}",
        frame=frame.drop(columns="main"),
        main=frame["main"].astype(bool),
        shown={n: n for n in ("coefficient", "source", "type", "distribution")}
        | {"scope": "shared by", "u_input": "standard uncertainty", "sensitivity": "sensitivity"}
        | {"u": "u", "u_without": "u without", "dof": "ν"},
    )


BUDGET = (
    *("boundary", "model", "coefficient", "source", "type", "distribution", "scope", "u_input"),
    *("unit", "sensitivity", "u", "u_without", "dof"),
)


def _source(place: Place, line: BudgetLine) -> dict[str, object]:
    row: dict[str, object] = {
        **{k: getattr(line, k) for k in ("source", "unit", "distribution", "scope")},
        "type": line.kind,
        **{k: place.number(k, digits=2) for k in ("u", "u_without")},
        "dof": place.degrees("dof"),
    }
    if line.u_input is not None and line.sensitivity is not None:
        scale, unit = SCALES[line.unit] if line.unit else (1.0, "")
        size = place.number("u_input", digits=3, scale=scale, how=f"in {unit}")
        slope = place.number("sensitivity", digits=3, scale=1 / scale, how=f"per {unit}")
        row["u_input"] = replace(size, text=f"{size.text} {unit}".strip())
        row["sensitivity"] = replace(slope, text=f"{slope.text} per {unit}")
    return row


def comparison(evidence: Evidence) -> Table:
    """Every model of each boundary, the best prediction first; `held_out_rmse` is in log lift, of
    visits predicted from all others.
    """
    rows = [
        _score(evidence, b, name)
        for b, compared in evidence.fits.comparison.items()
        for name in sorted(
            compared.models, key=lambda n: -np.nan_to_num(compared.models[n].d_elpd, nan=-1e9)
        )
    ]
    return Table(
        caption=f"Models compared by their prediction of visits left out, from {FIT.file}",
        frame=pd.DataFrame(rows),
        shown={"boundary": "boundary", "model": "model", "free": "free", "d_elpd": "Δ score"}
        | {"u_d_elpd": "its u", "held_out_rmse": "held-out RMSE (%)", "aic": "ΔAIC"}
        | {"bic": "ΔBIC", "log_evidence": "Δ ln Z", "r2": "R²"},
    )


def _score(evidence: Evidence, boundary: Boundary, name: str) -> dict[str, object]:
    compared, fits = evidence.fits.comparison[boundary], evidence.fits.boundaries[boundary]
    base, score = compared.models[compared.reference], compared.models[name]
    at = Place(evidence, FIT, ("comparison", boundary, "models", name))
    weighed = Place(evidence, FIT, ("boundaries", boundary, name, "log_evidence", "value"))
    estimates = [fits[n].log_evidence for n in (name, compared.reference)]
    ln_z = [z.value if z else math.nan for z in estimates]

    def less_base(number: Number, value: float, base: float) -> Number:
        difference = value - base
        text = f"{difference:.1f}".replace("-", "−") if math.isfinite(difference) else "–"
        return replace(number, text=text, how="less the base model's")

    # criteria of different trials are not comparable
    same = score.visits == base.visits
    return {
        "boundary": boundary,
        "model": name,
        "base": name == compared.reference,
        "free": len(fits[name].parameters),
        **{k: getattr(score, k) for k in ("visits", "skipped", "elpd")},
        **{k: at.number(k, places=1) for k in ("d_elpd", "u_d_elpd")},
        "held_out_rmse": at.percent("rmse", places=3),
        "d_held_out_rmse": score.d_rmse,
        "u_d_held_out_rmse": score.u_d_rmse,
        **{
            key: less_base(at.number(key), getattr(score, key) if same else math.nan, value)
            for key, value in (("aic", base.aic), ("bic", base.bic))
        },
        "r2": at.number("r2", places=4),
        "log_evidence": less_base(weighed.number(), *ln_z),
    }


TABLES: dict[str, Callable[[Evidence], Table]] = {
    "coefficients": coefficients,
    "budget": budget,
    "comparison": comparison,
}
