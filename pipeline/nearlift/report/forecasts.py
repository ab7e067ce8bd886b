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
    EffectVerdict,
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
    return console("effect.txt.j2", e=explanation, declared=declared, here=_here, rivals=_rivals)


def _worst(at: BoundaryOutlook, coefficient: str) -> list[EffectOutlook]:
    """Effects that would be undetected, by the bias of a coefficient."""
    hidden = [r for r in at.effects if r.hidden]
    return sorted(hidden, key=lambda r: -abs(r.bias[coefficient].in_u))[:MOST_BIASES]


def _rivals(size: EffectSize) -> list[Confusion]:
    """Effects that a size is confused with."""
    every = size.confused_with
    return [c for c in every if c.rival_chance >= 0.05 or c.energy_absorbed >= 0.5][:MOST_RIVALS]


def _here(verdict: EffectVerdict | None) -> str:
    """Result of the loop on the effect in this campaign."""
    if verdict is None:
        return (
            "The loop has not run on this campaign (`nearlift diagnose CAMPAIGN`); the noise is"
            " that of its own trials."
        )
    if verdict.named:
        rivals = f"with the rivals {', '.join(verdict.rivals)}" if verdict.rivals else ""
        return f"The loop named it here, {rivals or 'without a rival'}."
    if verdict.rival_of:
        return f"The loop lists it here as a rival of {', '.join(verdict.rival_of)}."
    said, tried = "had no need of it here", verdict.tried
    if tried and not tried.accepted:
        left = f"leaves structure in {tried.left_in}" if tried.left_in else "earns too little"
        said = f"tried it here and did not accept it: it {left}"
    return f"The loop {said}. Verdict: {verdict.verdict}."
