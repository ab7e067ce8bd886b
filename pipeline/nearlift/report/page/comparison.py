"""The page of several campaigns: coefficient by coefficient, in one file that fetches
nothing.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from nearlift.nomenclature import VERDICTS, letter
from nearlift.report import charts
from nearlift.report.evidence import Columns, distinct, where
from nearlift.report.figures import forest
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


def page(table: Columns, reports: Collection[str] = (), remarks: Collection[str] = ()) -> bytes:
    """index.html of a comparison.

    Parameters
    ----------
    table : Columns
        Of `figures.forest`.
    reports : collection of str
        Campaigns whose own report is next to this one, to be linked.
    remarks : collection of str
        What to hold against the groups.
    """
    drawn = charts.forest(table)
    picture = Picture(
        name="forest", title=TITLE, caption=forest.caption(table), alt=forest.alt(table)
    )
    return rendered(
        "comparison.html.j2",
        [drawn],
        title=TITLE,
        chapter={"charts": (drawn,), "pictures": [picture]},
        tables=_tables(table, reports),
        remarks=list(remarks),
    )


def _tables(table: Columns, reports: Collection[str]) -> dict[str, list[ForestLine]]:
    """Lines by title: a table for each boundary and coefficient."""
    tables = {}
    for boundary, coefficient in distinct(table["panel"], table["coefficient"]):
        rows = where(table, panel=boundary, coefficient=coefficient)
        tables[f"{boundary.capitalize()}: {letter(coefficient)}"] = [
            ForestLine(
                label=str(rows["label"][i]),
                linked=campaign and rows["label"][i] in reports,
                vehicle=str(rows["vehicle"][i]),
                value=forest.interval(rows, i),
                verdict=VERDICTS[rows["verdict"][i]] if campaign else "",
            )
            for i, campaign in enumerate((rows["kind"] == "campaign").tolist())
        ]
    return tables
