"""Crash rate over two dimensionless groups: the size of the gains and the noise over weight."""

from __future__ import annotations

from nearlift.products import CRASH_MAP, SAFETY
from nearlift.summaries.evidence import Columns, Evidence


def summarise(evidence: Evidence) -> Columns:
    """The map as it stands in its product."""
    table = evidence.table(CRASH_MAP)
    return {name: table[name] for name in ("boundary", "model", "target_z_hat", "beta", "noise", "flights", "rate", "lo90", "hi90")}


def caption(evidence: Evidence, table: Columns) -> str:
    """What is drawn, and at which other groups."""
    parts = ["Crash rate of the fitted model over two groups of Eq. 6; α and γ change in proportion to β, so that the loop keeps its shape."]
    for side, own in evidence.document(SAFETY)["fitted"].items():
        mine = table["boundary"] == side
        if mine.any():
            g = own["groups"]
            parts.append(
                f"{side.capitalize()}: set-point ẑ = {table['target_z_hat'][mine][0]:g}, {table['flights'][mine][0]} flights a cell; flown elsewhere "
                f"(circle): α = {abs(g['alpha']):.3g}, β = {abs(g['beta']):.3g}, γ = {abs(g['gamma']):.2g}, δ = {g['delta']:.3g} (over hover far "
                f"away), σ/mg = {g['noise']:.3g}, gusts held {g['hold']:.3g} √(r/g)."
            )
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    ends = f"from {100 * table['rate'].min():.0f} to {100 * table['rate'].max():.0f} %" if len(table["rate"]) else "nothing"
    return f"Maps of crash rate over gain and noise: {ends}; more noise and weaker gains crash more."
