"""Caption and alternative text of the loop's figure, from the table that is drawn."""

from __future__ import annotations

import numpy as np

from nearlift.report.evidence import Columns, Evidence, distinct, select, where
from nearlift.results.diagnosis import FORM_SD, RIVAL_MAX_2LNB
from nearlift.rounding import plain

MEANINGS = {
    "adequate": "no residual structure, so no effect is added",
    "unexplained": ("structure that no candidate explains; the curve only follows it"),
}


def caption(evidence: Evidence, table: Columns) -> str:
    """Caption of each panel; letters as in the picture."""
    after = "after" in table["when"]
    drawn = where(table, kind="reach")
    second = len(distinct(drawn["panel"], drawn["covariate"])) > len(distinct(drawn["panel"]))
    also = ", and of the other effect" if second else ""
    beyond = int(np.count_nonzero(table["kind"] == "beyond"))
    ticks = f", of which {beyond} beyond the axis are ticks at its edge" if beyond else ""
    residuals = (
        f"Relative residuals ({_letters(table, 'residual')}) against the covariate of the largest"
        f" test{also}. Dots: trials{ticks}. Symbols: means with their standard error. Shade: ±"
        " the noise floor."
    )
    parts = [residuals]
    if after:
        parts.append(
            f"After: the effect added in its stated form, uncertain by {100 * FORM_SD:.0f} %."
        )
    if "session" in table["kind"]:
        parts.append("Dashed vertical lines: a new session.")
    if "candidate" in table["part"]:
        reference = "best accepted" if after else "best"
        parts.append(
            f"Candidates ({_letters(table, 'candidate')}): 2 ln B of the {reference} over each."
            f" Hollow: rejected. Shade: within {RIVAL_MAX_2LNB:g}, not distinguishable."
        )
    if "error" in table["part"]:
        parts.append(
            f"Cross-validated error ({_letters(table, 'error')}), 90 %. Dashed: noise floor."
        )
    if "coefficient" in table["part"]:
        parts.append(
            f"Coefficients ({_letters(table, 'coefficient')}), 90 %: bold as quoted, numbered"
            " under another assumption."
        )
    return " ".join([*parts, *(_boundary(table, b) for b in distinct(table["panel"]))])


def alt(evidence: Evidence, table: Columns) -> str:
    """The picture's numbers for those who do not see it."""
    parts = []
    for boundary in distinct(table["panel"]):
        parts.append(_boundary(table, boundary))
        means = where(table, panel=boundary, kind="bin")
        for when in distinct(means["when"]):
            most = float(np.abs(where(means, when=when)["value"]).max())
            name = str(means["covariate"][0]).replace("_", " ")
            parts.append(f"Bin means {when} deviate by up to {plain(most, 2)} % against {name}.")
        listed = where(table, panel=boundary, part="coefficient")
        listed = select(listed, listed["kind"] != "reference")
        columns = (listed[name] for name in ("label", "note", "value", "lo90", "hi90"))
        for name, note, value, low, high in zip(*columns, strict=True):
            condition = f", {note}" if note else ""
            interval = f"{plain(value, 3)}, 90 % {plain(low, 3)} to {plain(high, 3)}"
            parts.append(f"{name}{condition}: {interval}.")
    return " ".join(parts)


def _boundary(table: Columns, boundary: str) -> str:
    mine = where(table, panel=boundary)
    verdict = where(mine, part="verdict")
    kind, label = str(verdict["kind"][0]), str(verdict["label"][0])
    text = f"{boundary.capitalize()}: {MEANINGS.get(kind, label)}"
    rmse = where(mine, kind="rmse")["value"].tolist()
    if rmse:
        values = " to ".join(f"{plain(v, 3)} %" for v in rmse)
        floor = float(where(mine, part="error", kind="floor")["value"][0])
        text += f"; cross-validated error {values}, noise floor {plain(floor, 3)} %"
    conditions = distinct(where(mine, kind="doubt")["note"])
    listed = "; ".join(f"({i}) {c}" for i, c in enumerate(conditions, 1))
    return text + "." + (f" Assumptions: {listed}." if listed else "")


def _letters(table: Columns, part: str) -> str:
    """Letters of the panels of a part: ``a, b, f``, neighbours of three and more as ``a–d``."""
    runs: list[list[str]] = []
    for letter in distinct(where(table, part=part)["letter"]):
        if runs and ord(letter) == ord(runs[-1][-1]) + 1:
            runs[-1].append(letter)
        else:
            runs.append([letter])
    return ", ".join(f"{r[0]}–{r[-1]}" if len(r) > 2 else ", ".join(r) for r in runs)
