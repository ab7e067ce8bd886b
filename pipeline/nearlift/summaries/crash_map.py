"""Crash rate over pairs of dimensionless groups: gains, noise, the noise's memory, the rotors'
spacing.
"""

from __future__ import annotations

import numpy as np

from nearlift.flight.simulation.maps import PAIRS
from nearlift.products import CRASH_MAP, SAFETY
from nearlift.summaries.evidence import Columns, Evidence

SHOWN = (
    "boundary",
    "model",
    "map",
    "x_group",
    "y_group",
    "x",
    "y",
    "target_z_hat",
    "flights",
    "rate",
    "lo90",
    "hi90",
)


def summarise(evidence: Evidence) -> Columns:
    """The maps as they stand in their product, with the values flown elsewhere.

    Returns
    -------
    dict of arrays
        The product's columns, and `x_flown`, `y_flown`: the groups of the campaign's own flights; 0
        where they lie off the map's axis.
    """
    table, fitted = evidence.table(CRASH_MAP), evidence.document(SAFETY)["fitted"]
    shown: Columns = {name: table[name] for name in SHOWN}
    for axis in ("x", "y"):
        flown = np.zeros(len(table[axis]))
        for side, own in fitted.items():
            for group in set(table[f"{axis}_group"].tolist()):
                mine = (table["boundary"] == side) & (table[f"{axis}_group"] == group)
                value = own["spacing_hat"] if group == "spacing_hat" else own["groups"][group]
                flown[mine] = abs(value or 0.0)
        shown[f"{axis}_flown"] = flown
    return shown


def caption(evidence: Evidence, table: Columns) -> str:
    """What is drawn, and at which other groups."""
    parts = [
        (
            "Crash rate of the fitted model over pairs of groups of Eq. 6 and of those that it"
            " leaves out, all others as flown elsewhere (circle; an arrow where that is off the"
            " map: gusts without memory). White lines: 10 % (dotted), 50 % (solid) and 90 %"
            " (dashed), which so many flights resolve."
        ),
    ]
    along = [p for p in PAIRS if p.along]
    if along:
        parts.append(
            "Where noise stands against gain, α and γ change in proportion to β, so that the loop"
            " keeps its shape."
        )
    for side, own in evidence.document(SAFETY)["fitted"].items():
        mine = table["boundary"] == side
        if mine.any():
            g = own["groups"]
            parts.append(
                f"{side.capitalize()}: set-point ẑ = {table['target_z_hat'][mine][0]:g},"
                f" {table['flights'][mine][0]} flights a cell; α = {abs(g['alpha']):.3g}, β ="
                f" {abs(g['beta']):.3g}, γ = {abs(g['gamma']):.2g}, δ = {g['delta']:.3g} (over"
                f" hover far away), σ/mg = {g['noise']:.3g}, gusts held {g['hold']:.3g} √(r/g);"
                f" halving the step changes a rate by up to {own['maps']['worst']:.2g}"
                f" ({own['maps']['settings']} cells, corners and those between 10 and 90 %)."
            )
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = []
    for side in dict.fromkeys(table["boundary"].tolist()):
        for name in dict.fromkeys(table["map"][table["boundary"] == side].tolist()):
            rate = 100 * table["rate"][(table["boundary"] == side) & (table["map"] == name)]
            parts.append(f"{side}, {name}: from {rate.min():.0f} to {rate.max():.0f} %")
    return "Maps of crash rate. " + "; ".join(parts) + "."
