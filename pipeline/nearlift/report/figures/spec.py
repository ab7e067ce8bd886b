"""Figure of the report: its products, table, caption and drawing.

A figure is one file of this folder with three functions: `table`, `caption` and `draw`. The table
has exactly what is drawn (its CSV), and `draw` returns a matplotlib Figure.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pandas as pd

from nearlift.report.evidence import Evidence, groups, pick
from nearlift.report.figures.files import Draw
from nearlift.rounding import plain
from nearlift.run.tables import Product


@dataclass(frozen=True, slots=True)
class FigureSpec:
    """One figure. It is made when every product in `needs` exists, and its table has rows.

    Attributes
    ----------
    name, title : str
        File name without suffix; heading.
    needs : tuple of Product
    rows : callable
        Evidence to the table of exactly what is drawn.
    caption : callable
        Evidence and table to text, its numbers computed from them.
    draw : callable
        Table and style to a figure.
    shows : str
        Column of the values that are drawn, for the text alternative.
    within : tuple of str
        Columns that name a panel.
    """

    name: str
    title: str
    needs: tuple[Product, ...]
    rows: Callable[[Evidence], pd.DataFrame]
    caption: Callable[[Evidence, pd.DataFrame], str]
    draw: Draw
    shows: str
    within: tuple[str, ...] = ("panel",)

    def table(self, evidence: Evidence) -> pd.DataFrame:
        """Table of what is drawn; empty where a product or every row is missing."""
        return self.rows(evidence) if evidence.has(*self.needs) else pd.DataFrame()

    def captioned(self, evidence: Evidence, table: pd.DataFrame) -> str:
        """Caption, which says where records are simulated."""
        said = self.caption(evidence, table)
        simulated = evidence.campaign.simulated and "simulated" not in said.lower()
        return f"Simulated records, not measured. {said}" if simulated else said

    def alt(self, table: pd.DataFrame) -> str:
        """Text alternative: the range of the values in each panel."""
        return alternative(self.title, table, self.shows, self.within)


def alternative(title: str, table: pd.DataFrame, shows: str, within: tuple[str, ...]) -> str:
    """Title, and the range of a column in each panel of a table."""
    parts = []
    for key in groups(table, *within):
        values = pick(table, **dict(zip(within, key, strict=True)))[shows]
        values = values[np.isfinite(values)]
        if len(values):
            ends = {plain(float(end), 3): None for end in (values.min(), values.max())}
            parts.append(f"{', '.join(map(str, key))}: {' to '.join(ends)}.")
    return " ".join([f"{title}.", f"Range of {shows.replace('_', ' ')} in each panel.", *parts])
