"""What an answer looks like in a notebook: a table of intervals, and under it a small figure. HTML
as text, nothing loaded.
"""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING

from nearlift.nomenclature import letter
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.rounding import plain, plus_minus

if TYPE_CHECKING:
    from nearlift.study.answers import Answered, Diagnosis, Drawing, Finished, Fit, Reduction

#: Trials listed by name; more are counted.
LISTED = 5


def reduction(answer: Reduction) -> str:
    """Cells of each boundary: how many, from how near to how far, and the largest change
    of lift.
    """
    rows = []
    for boundary, cells in answer.cells.groupby("boundary", sort=False):
        change, u, z_hat = (cells[name].to_numpy() for name in ("delta_L", "u_delta_L", "z_hat"))
        top = abs(change).argmax()
        largest = f"{plus_minus(100 * change[top], 100 * u[top])} % at {plain(z_hat[top], 3)}"
        ends = f"{plain(z_hat.min(), 3)} to {plain(z_hat.max(), 3)}"
        rows.append((str(boundary), str(cells["n_trials"].sum()), str(len(cells)), ends, largest))
    return _whole(answer, ("boundary", "trials", "cells", "z/r", "largest ΔL"), rows)


def fit(answer: Fit) -> str:
    """Coefficients to be quoted, with uncertainty and 90 % interval."""
    rows = []
    for boundary, result in answer.quoted.items():
        base = answer[boundary].base
        for name, c in result.coefficients.items():
            rows.append(
                (
                    boundary,
                    base.title,
                    letter(name),
                    c.estimate,
                    c.interval,
                    c.holds,
                    plain(base.chi2 / base.dof, 3),
                )
            )
    return _whole(
        answer, ("boundary", "base model", "", "value (k = 1)", "90 % interval", "", "χ²/dof"), rows
    )


def diagnosis(answer: Diagnosis) -> str:
    """Verdicts, named effects with rivals, coefficients to be quoted, error on what was
    held out.
    """
    rows = []
    for at in answer:
        others = (
            {e.name: at.stand_ins(e) for e in at.effects}
            if isinstance(at, BoundaryDiagnosis)
            else {}
        )
        named = "; ".join(
            name + (f" (or {', '.join(names)})" if names else "") for name, names in others.items()
        )
        error = (
            f"{plain(100 * at.held_out_before, 2)} → {plain(100 * at.held_out_after, 2)} (floor"
            f" {plain(100 * at.noise_floor, 2)})"
        )
        verdict = f"{at.verdict}; {at.sensitivity}" if at.sensitivity else at.verdict
        if at.reason:
            verdict = f"not diagnosed: {at.reason}"
        for name, c in answer.quoted[at.boundary].coefficients.items():
            rows.append(
                (
                    at.boundary,
                    verdict,
                    named or "none",
                    letter(name),
                    c.estimate,
                    c.interval,
                    c.holds,
                    "" if at.reason else error,
                )
            )
    return _whole(
        answer,
        (
            "boundary",
            "verdict",
            "effects",
            "",
            "value (k = 1)",
            "90 % interval",
            "",
            "held-out error, % of lift",
        ),
        rows,
    )


def finished(answer: Finished) -> str:
    """Where the report is, and what ran."""
    where = answer.report.resolve()
    ran = ", ".join(answer.ran) or "nothing: all was up to date"
    return (
        f'<p>Report: <a href="{escape(where.as_uri())}">{escape(str(where))}</a>. Ran:'
        f" {escape(ran)}.</p>" + _words(answer)
    )


def drawing(figure: Drawing) -> str:
    """The picture with its caption; who cannot see it hears `alt`."""
    data = base64.b64encode(figure.png).decode()
    picture = (
        f'<img src="data:image/png;base64,{data}" alt="{escape(figure.alt)}"'
        ' style="max-width:44em;width:100%;background:white">'
    )
    return (
        '<figure style="margin:0.5em'
        f' 0">{picture}<figcaption>{escape(figure.caption)}</figcaption></figure>'
    )


def _whole(answer: Answered, head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    cells = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows
    )
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    table = (
        f"<table><caption>{escape(answer.campaign)}</caption>"
        f"<thead><tr>{names}</tr></thead><tbody>{cells}</tbody></table>"
    )
    return table + _words(answer) + (drawing(answer.drawing) if answer.drawing is not None else "")


def _words(answer: Answered) -> str:
    """Rejected trials and notes."""
    lines = [f"{trial}: {reason}" for trial, reason in answer.rejected[:LISTED]]
    if len(answer.rejected) > LISTED:
        lines.append(f"and {len(answer.rejected) - LISTED} more trials rejected")
    lines += answer.notes
    if not lines:
        return ""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<details><summary>{len(lines)} remarks</summary><ul>{items}</ul></details>"
