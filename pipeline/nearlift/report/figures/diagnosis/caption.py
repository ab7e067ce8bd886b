"""Caption and alternative text of the loop's figure, from the table that is drawn."""

from __future__ import annotations

import numpy as np

from nearlift.report.evidence import Columns, Evidence, distinct
from nearlift.results.diagnosis import FORM_SD, RIVAL_MAX_2LNB
from nearlift.rounding import plain

MEANINGS = {
    "adequate": "nothing beyond the noise, so nothing is added",
    "unexplained": (
        "structure that no candidate may take the credit for; the curve follows it and names"
        " nothing"
    ),
}


def caption(evidence: Evidence, table: Columns) -> str:
    """What each panel shows; letters as in the picture."""
    after = (table["when"] == "after").any()
    second = any(
        len(set(table["covariate"][(table["panel"] == b) & (table["kind"] == "reach")].tolist()))
        > 1
        for b in set(table["panel"].tolist())
    )
    also = ", and against that of the other effect" if second else ""
    parts = [
        (
            f"Relative residuals ({_letters(table, 'residual')}) against the covariate of the"
            f" largest test{also}."
        )
    ]
    parts.append(
        f"Dots: trials{_beyond(table)}; symbols: means with their standard error; shade: ±"
        " the noise floor."
    )
    if after:
        parts.append(
            "After: the effect added in its declared form, from which the true one may depart by"
            f" {100 * FORM_SD:.0f} %."
        )
    if ((table["part"] == "residual") & (table["kind"] == "session")).any():
        parts.append("Dashed uprights: a new session.")
    if (table["part"] == "candidate").any():
        reference = "best accepted" if after else "best"
        parts.append(
            f"Candidates ({_letters(table, 'candidate')}): twice the log of the Bayes factor B of"
            f" the {reference} one over each; hollow: rejected; shade: within {RIVAL_MAX_2LNB:g},"
            " where this design cannot tell them apart."
        )
    if (table["part"] == "error").any():
        parts.append(
            f"Held-out error ({_letters(table, 'error')}): {evidence.left_out} left out of"
            " the search, 90 %; dashed: noise floor."
        )
    if (table["part"] == "coefficient").any():
        parts.append(
            f"Coefficients ({_letters(table, 'coefficient')}): bold, as quoted, 90 %; numbered, on"
            " a condition (arrows and figures where it leaves the axis)."
        )
    for boundary in distinct(table["panel"]):
        parts.append(_boundary(table, boundary))
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """The picture's numbers for those who do not see it."""
    parts = []
    for boundary in distinct(table["panel"]):
        mine = table["panel"] == boundary
        means = mine & (table["kind"] == "bin")
        line = _boundary(table, boundary)
        for when in distinct(table["when"][means]):
            strays = np.abs(table["value"][means & (table["when"] == when)])
            name = str(table["covariate"][means][0]).replace("_", " ")
            line += (
                f" Bin means {when} stray up to {plain(float(strays.max()), 2)} % from zero against"
                f" {name}."
                if len(strays)
                else ""
            )
        for i in np.flatnonzero(
            mine & (table["part"] == "coefficient") & (table["kind"] != "reference")
        ).tolist():
            row = {k: v[i] for k, v in table.items()}
            condition = f", if {row['note']}" if row["note"] else ""
            line += (
                f" {row['label']}{condition}: {plain(row['value'], 3)}, 90 %"
                f" {plain(row['lo90'], 3)} to {plain(row['hi90'], 3)}."
            )
        parts.append(line)
    return " ".join(parts)


def _boundary(table: Columns, boundary: str) -> str:
    mine = table["panel"] == boundary
    verdict = mine & (table["part"] == "verdict")
    kind, label = str(table["kind"][verdict][0]), str(table["label"][verdict][0])
    text = f"{boundary.capitalize()}: {MEANINGS.get(kind, label)}"
    rmse = mine & (table["kind"] == "rmse")
    if rmse.any():
        values = [f"{plain(float(v), 3)} %" for v in table["value"][rmse]]
        floor = plain(
            float(
                table["value"][mine & (table["kind"] == "floor") & (table["part"] == "error")][0]
            ),
            3,
        )
        text += f"; held-out error {' to '.join(values)}, noise floor {floor} %"
    conditions = table["note"][mine & (table["part"] == "coefficient") & (table["kind"] == "doubt")]
    listed = "; ".join(f"({i}) {c}" for i, c in enumerate(dict.fromkeys(conditions.tolist()), 1))
    return text + (f"; if {listed}" if listed else "") + "."


def _letters(table: Columns, part: str) -> str:
    """Letters of the panels of a part: ``a, b, f``, neighbours of three and more as ``a–d``."""
    letters: list[str] = distinct(table["letter"][table["part"] == part])
    runs: list[list[str]] = []
    for letter in letters:
        if runs and ord(letter) == ord(runs[-1][-1]) + 1:
            runs[-1].append(letter)
        else:
            runs.append([letter])
    return ", ".join(f"{r[0]}–{r[-1]}" if len(r) > 2 else ", ".join(r) for r in runs)


def _beyond(table: Columns) -> str:
    count = int(np.count_nonzero(table["kind"] == "beyond"))
    return f", of which {count} beyond the axis are ticks at its edge" if count else ""
