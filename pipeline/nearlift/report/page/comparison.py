"""The page of several campaigns: coefficient by coefficient, in one file that fetches
nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping

import pandas as pd
from markupsafe import Markup

from nearlift.nomenclature import VERDICTS, letter
from nearlift.report import blocks, charts
from nearlift.report.evidence import groups, pick, records
from nearlift.report.figures import forest
from nearlift.report.figures.spec import alternative
from nearlift.report.page.render import Picture, rendered

TITLE = "Campaigns compared"


def page(
    table: pd.DataFrame,
    reports: Collection[str] = (),
    remarks: Collection[str] = (),
    claims: Mapping[tuple[str, str], str] | None = None,
) -> bytes:
    """index.html of a comparison.

    Parameters
    ----------
    table : DataFrame
        Of `figures.forest`.
    reports : collection of str
        Campaigns whose own report is next to this one, to be linked.
    remarks : collection of str
        What to hold against the groups.
    claims : mapping of (str, str) to str, optional
        Verdict with its explanation, by campaign and boundary.
    """
    drawn = charts.forest(table)
    alt = alternative(TITLE, table, "value", ("panel", "coefficient", "label"))
    picture = Picture(name="forest", title=TITLE, caption=forest.caption(table), alt=alt)
    return rendered(
        "comparison.html.j2",
        [drawn],
        title=TITLE,
        chapter={"charts": (drawn,), "pictures": [picture]},
        tables=_tables(table, reports, claims or {}),
        remarks=blocks.join(*(blocks.paragraph("{}.", remark) for remark in remarks)),
    )


def _tables(
    table: pd.DataFrame, reports: Collection[str], claims: Mapping[tuple[str, str], str]
) -> Markup:
    """A table for each boundary and coefficient."""
    parts = []
    for boundary, coefficient in groups(table, "panel", "coefficient"):
        lines = []
        for row in records(pick(table, panel=boundary, coefficient=coefficient)):
            campaign = row.kind == "campaign"
            link = Markup('<a href="../{}/index.html">{}</a>').format(row.label, row.label)
            claim = claims.get((row.label, boundary), VERDICTS[row.verdict]) if campaign else ""
            value = forest.interval(row.value, row.lo90, row.hi90)
            linked = campaign and row.label in reports
            lines.append((link if linked else row.label, row.vehicle, value, claim))
        title = f"{boundary.capitalize()}: {letter(coefficient)}"
        heads = ("campaign", "vehicle", "value (90 %)", "verdict")
        parts.append(blocks.table(title, heads, lines))
    return blocks.join(*parts)
