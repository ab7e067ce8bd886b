"""Forecasts as text for the console: the outlook of a design, and the account of one effect."""

from __future__ import annotations

from nearlift import catalogue
from nearlift.report.documents.text import console
from nearlift.results.answers import (
    BoundaryOutlook,
    Confusion,
    DesignOutlook,
    EffectAccount,
    EffectSize,
)
from nearlift.results.outlook import EffectOutlook

#: Effects that a text lists at most: of a bias, and confused with another.
MOST_BIASES, MOST_RIVALS = 3, 8


def design(outlook: DesignOutlook) -> str:
    """The outlook in words."""
    return console("design.txt.j2", o=outlook, worst=_worst)


def effect(explanation: EffectAccount) -> str:
    """The explanation in words."""
    declared = catalogue.effect(explanation.effect)
    return console("effect.txt.j2", e=explanation, declared=declared, rivals=_rivals)


def _worst(at: BoundaryOutlook, coefficient: str) -> list[EffectOutlook]:
    """Effects that would be undetected, by the bias of a coefficient."""
    hidden = [r for r in at.effects if r.hidden]
    return sorted(hidden, key=lambda r: -abs(r.bias[coefficient].in_u))[:MOST_BIASES]


def _rivals(size: EffectSize) -> list[Confusion]:
    """Effects that a size is confused with."""
    every = size.confused_with
    return [c for c in every if c.rival_chance >= 0.05 or c.energy_absorbed >= 0.5][:MOST_RIVALS]
