"""Figure of the report: its products, table, caption and drawing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from nearlift.campaign.manifest import Campaign
from nearlift.report.evidence import Columns, Evidence
from nearlift.report.figures.files import Draw
from nearlift.run.tables import Product


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureSpec:
    """One figure. It is made when every product in `needs` exists, and its summary has rows.

    Attributes
    ----------
    name, title : str
        File name without suffix; heading.
    needs : tuple of Product
    summarise : callable
        Evidence to the table of exactly what is drawn.
    draw : callable
        Table and style to a figure.
    caption, alt : callable
        Evidence and table to text, its numbers computed from them.
    asked : callable
        Whether a manifest's choices ask for it, beyond the stages that make its products; one that
        is not asked for is not missed.
    """

    name: str
    title: str
    needs: tuple[Product, ...]
    summarise: Callable[[Evidence], Columns]
    draw: Draw
    caption: Callable[[Evidence, Columns], str]
    alt: Callable[[Evidence, Columns], str]
    asked: Callable[[Campaign], bool] = lambda campaign: True

    def table(self, evidence: Evidence) -> Columns:
        """Table of what is drawn; empty where a product or every row is missing."""
        rows = self.summarise(evidence) if evidence.has(*self.needs) else {}
        return rows if any(len(column) for column in rows.values()) else {}

    def captioned(self, evidence: Evidence, table: Columns) -> str:
        """Caption, which says where records are simulated."""
        said = self.caption(evidence, table)
        simulated = evidence.campaign.simulated and "simulated" not in said.lower()
        return f"Simulated records, not measured. {said}" if simulated else said
