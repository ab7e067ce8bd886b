"""What an exported model says of itself, whatever the language."""

from __future__ import annotations

import ast
from collections.abc import Mapping
from dataclasses import dataclass

from nearlift.flight.export.table import Table


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A number and its 90 % interval."""

    value: float
    lo90: float
    hi90: float
    unit: str = "1"


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """One boundary's model.

    Attributes
    ----------
    boundary, model, title : str
    formula : str
        LaTeX of the base model.
    effects : tuple of str
        Effects that are in it.
    parameters : mapping of str to Interval
    known : mapping of str to float
        Geometry that the model needs.
    at : mapping of float to Interval
        L / L_inf with its interval at some heights.
    table : Table
    closed : ast.expr or None
        Expression in `z` with numbers put in; None where the model has no closed form.
    closed_error : float
        Its largest relative error against the model, in double precision.
    """

    boundary: str
    model: str
    title: str
    formula: str
    effects: tuple[str, ...]
    parameters: Mapping[str, Interval]
    known: Mapping[str, float]
    at: Mapping[float, Interval]
    table: Table
    closed: ast.expr | None
    closed_error: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Deck:
    """All boundaries of one campaign, and where they come from."""

    campaign: str
    nearlift: str
    digest: str
    date: str
    source: str
    radius_m: float
    held: str
    cards: tuple[Card, ...]

    def about(self) -> list[str]:
        """The comment at the head of a file, line by line."""
        lines = [
            (
                f"Lift near boundaries, campaign {self.campaign}: L / L_inf as a function of z_hat"
                f" = z / r, r = {1e3 * self.radius_m:g} mm,"
            ),
            (
                "z from the rotor plane to ground or ceiling, from the nearest blade tip to a"
                f" sidewall. Written by nearlift {self.nearlift}; do not edit."
            ),
            f"Data: SHA-256 of trials.parquet {self.digest}",
            (
                f"Date of the newest raw file: {self.date}. Held in each trial: {self.held}."
                f" Uncertainty from {self.source}."
            ),
            (
                "Outside its validity a ratio is that of the nearest end, and flagged: -1 nearer"
                " than measured (or not a number), +1 farther."
            ),
        ]
        for card in self.cards:
            effects = f" with {', '.join(card.effects)}" if card.effects else ""
            lines += [
                "",
                (
                    f"{card.boundary}: {card.title}{effects}; valid for {card.table.low:.6g} <="
                    f" z_hat <= {card.table.high:.6g}"
                ),
            ]
            lines += [
                f"  {name} = {p.value:.6g} {p.unit if p.unit != '1' else ''} (90 %: {p.lo90:.6g} to"
                f" {p.hi90:.6g})"
                for name, p in card.parameters.items()
            ]
            lines += [
                f"  at z_hat = {z:.4g}: {r.value:.5f} (90 %: {r.lo90:.5f} to {r.hi90:.5f})"
                for z, r in card.at.items()
            ]
            if card.closed is None:
                lines.append("  table only: this model has no closed form on record")
        return [
            " ".join(line.split()) if not line.startswith("  ") else "  " + " ".join(line.split())
            for line in lines
        ]
