"""The page of several campaigns: one coefficient beside another, in one file that fetches
nothing.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from nearlift.nomenclature import VERDICTS, letter
from nearlift.report.evidence import Columns, distinct, where
from nearlift.report.figures import forest
from nearlift.report.page.render import Picture, rendered

TITLE = "Campaigns compared"


def page(table: Columns, reports: Collection[str] = (), remarks: Collection[str] = ()) -> bytes:
    """index.html of a comparison.

    Parameters
    ----------
    table : Columns
        Of `figures.forest`.
    reports : collection of str
        Campaigns whose own report stands beside this one, to be linked.
    remarks : collection of str
        What to hold against the groups.
    """
    drawn = forest.chart(table)
    picture = Picture(
        name="forest", title=TITLE, caption=forest.caption(table), alt=forest.alt(table)
    )
    return rendered(
        "comparison.html.j2",
        [drawn],
        title=TITLE,
        chapter={"charts": (drawn,), "pictures": [picture], "tabled": (drawn,)},
        groups=_groups(table, reports),
        remarks=list(remarks),
    )


def _groups(table: Columns, reports: Collection[str]) -> list[dict[str, Any]]:
    groups = []
    for boundary, coefficient in distinct(table["panel"], table["coefficient"]):
        rows = where(table, panel=boundary, coefficient=coefficient)
        lines = [
            {
                "label": str(rows["label"][i]),
                "linked": rows["kind"][i] == "campaign" and rows["label"][i] in reports,
                "vehicle": str(rows["vehicle"][i]),
                "value": forest.interval(rows, i),
                "verdict": VERDICTS[rows["verdict"][i]] if rows["kind"][i] == "campaign" else "",
            }
            for i in range(len(rows["value"]))
        ]
        groups.append({"title": f"{boundary.capitalize()}: {letter(coefficient)}", "lines": lines})
    return groups
