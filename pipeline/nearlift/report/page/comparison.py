"""The page of several campaigns: coefficient by coefficient, in one file that fetches
nothing.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import pandas as pd

from nearlift.nomenclature import VERDICTS, letter
from nearlift.report import charts
from nearlift.report.evidence import groups, pick, records
from nearlift.report.figures import forest
from nearlift.report.figures.spec import alternative
from nearlift.report.page.render import Picture, rendered

TITLE = "Campaigns compared"


@dataclass(frozen=True, slots=True, kw_only=True)
class ForestLine:
    """A line of a table: a campaign, the population's mean or the next campaign; `linked` where its
    own report is next to this one.
    """

    label: str
    linked: bool
    vehicle: str
    value: str
    verdict: str


def page(
    table: pd.DataFrame, reports: Collection[str] = (), remarks: Collection[str] = ()
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
    """
    drawn = charts.forest(table)
    alt = alternative(TITLE, table, "value", ("panel", "coefficient", "label"))
    picture = Picture(name="forest", title=TITLE, caption=forest.caption(table), alt=alt)
    return rendered(
        "comparison.html.j2",
        [drawn],
        title=TITLE,
        chapter={"charts": (drawn,), "pictures": [picture]},
        tables=_tables(table, reports),
        remarks=list(remarks),
    )


def _tables(table: pd.DataFrame, reports: Collection[str]) -> dict[str, list[ForestLine]]:
    """Lines by title: a table for each boundary and coefficient."""
    tables = {}
    for boundary, coefficient in groups(table, "panel", "coefficient"):
        rows = pick(table, panel=boundary, coefficient=coefficient)
        tables[f"{boundary.capitalize()}: {letter(coefficient)}"] = [
            ForestLine(
                label=row.label,
                linked=row.kind == "campaign" and row.label in reports,
                vehicle=row.vehicle,
                value=forest.interval(row.value, row.lo90, row.hi90),
                verdict=VERDICTS[row.verdict] if row.kind == "campaign" else "",
            )
            for row in records(rows)
        ]
    return tables
