"""The page of several campaigns: coefficient by coefficient, in one file that fetches nothing."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

import pandas as pd
from markupsafe import Markup

from nearlift.nomenclature import VERDICTS, letter
from nearlift.report import blocks
from nearlift.report.evidence import groups, pick, records
from nearlift.report.figures import forest
from nearlift.report.figures.spec import alternative
from nearlift.report.page.render import Picture, placed, rendered

TITLE = "Campaigns compared"


def page(
    table: pd.DataFrame,
    png: bytes,
    reports: Collection[str] = (),
    remarks: Collection[str] = (),
    claims: Mapping[tuple[str, str], str] | None = None,
) -> bytes:
    """index.html of a comparison.

    Parameters
    ----------
    table, png : DataFrame, bytes
        Of `figures.forest`.
    reports : collection of str
        Campaigns whose own report is next to this one, to be linked.
    remarks : collection of str
        What to hold against the groups.
    claims : mapping of (str, str) to str, optional
        Verdict with its explanation, by campaign and boundary.
    """
    alt = alternative(TITLE, table, "value", ("panel", "coefficient", "label"))
    caption = forest.caption(table)
    picture = Picture(name="forest", title=TITLE, caption=caption, alt=alt, png=png)
    heads = ("campaign", "vehicle", "value (90 %)", "verdict")
    parts = [
        blocks.table(f"{b.capitalize()}: {letter(c)}", heads, rows)
        for b, c in groups(table, "panel", "coefficient")
        for rows in [_rows(pick(table, panel=b, coefficient=c), reports, claims or {})]
    ]
    parts += [blocks.paragraph("{}.", remark) for remark in remarks]
    facts = blocks.join(blocks.figure("forest"), *parts)
    content = placed(facts, {"forest": picture}, {})
    return rendered("comparison.html.j2", [], title=TITLE, facts=content)


def _rows(
    table: pd.DataFrame, reports: Collection[str], claims: Mapping[tuple[str, str], str]
) -> Iterator[tuple[object, ...]]:
    for row in records(table):
        campaign = row.kind == "campaign"
        link = Markup('<a href="../{}/index.html">{}</a>').format(row.label, row.label)
        claim = claims.get((row.label, row.panel), VERDICTS[row.verdict]) if campaign else ""
        value = forest.interval(row.value, row.lo90, row.hi90)
        linked = campaign and row.label in reports
        yield (link if linked else Markup.escape(row.label)), row.vehicle, value, claim
