"""Whose error it is: the share of each source in the variance of each coefficient of the base models."""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.rounding import letter
from nearlift.summaries import superseded
from nearlift.summaries.evidence import Columns, Evidence

#: A source from repeats below this share of every coefficient is drawn with the others like it; what was declared is always drawn.
LEAST = 0.002
REST = "all other scatter"
NOTHING = 5e-4


def summarise(evidence: Evidence) -> Columns:
    """A row for each bar.

    Returns
    -------
    dict of arrays
        `panel` (boundary), `parameter`, `component`, `type` (A from repeats, B declared),
        `share_percent` of the variance, `u` that it adds to the coefficient. Every panel has every component, the largest on the whole first.
    """
    bars = [(b, name, entry["lines"]) for b in evidence.boundaries for name, entry in evidence.base(b)[1].get("budget", {}).items()]
    rows = _rows(bars) if bars else []
    kinds: tuple[tuple[str, type], ...] = (
        ("panel", object),
        ("parameter", object),
        ("component", object),
        ("type", object),
        ("share_percent", float),
        ("u", float),
    )
    return {name: np.array([row[i] for row in rows], dtype=kind) for i, (name, kind) in enumerate(kinds)}


def _rows(bars: list[tuple[Any, str, list[dict[str, Any]]]]) -> list[tuple[Any, ...]]:
    shares: dict[str, list[float]] = {}
    for _, _, lines in bars:
        for line in lines:
            shares.setdefault(line["component"], []).append(line["share"])
    shown = sorted((c for c in shares if max(shares[c]) >= LEAST or _type(bars, c) == "B"), key=lambda c: -sum(shares[c]))
    small = any(c not in shown and max(shares[c]) >= NOTHING for c in shares)
    rows: list[tuple[Any, ...]] = []
    for boundary, name, lines in bars:
        own = {line["component"]: line for line in lines}
        for component in shown:
            line = own.get(component, {"type": _type(bars, component), "share": 0.0, "u": 0.0})
            rows.append((boundary, name, component, line["type"], 100 * line["share"], line["u"]))
        if small:
            rest = [line for line in lines if line["component"] not in shown]
            u = float(np.sqrt(sum(line["u"] ** 2 for line in rest)))
            rows.append((boundary, name, REST, "A", 100 * sum(line["share"] for line in rest), u))
    return rows


def _type(bars: list[tuple[Any, str, list[dict[str, Any]]]], component: str) -> str:
    return next(str(line["type"]) for _, _, lines in bars for line in lines if line["component"] == component)


def caption(evidence: Evidence, table: Columns) -> str:
    """What is drawn, and the largest source of each coefficient."""
    words = []
    for panel, name in dict.fromkeys(zip(table["panel"], table["parameter"], strict=True)):
        mine = (table["panel"] == panel) & (table["parameter"] == name)
        top = np.flatnonzero(mine)[np.argmax(table["share_percent"][mine])]
        words.append(f"{letter(name)} ({panel}): {table['component'][top]}, {table['share_percent'][top]:.0f} %")
    return (
        "Share of each source of error in the variance of each coefficient of the base models; type A from repeats, type B declared in the "
        f"manifest, always shown. {superseded.warning(evidence)}The shares of a panel add to 100 %. Largest: {'; '.join(words)}. A source "
        "that an L_inf per throttle absorbs has no share."
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """The same for who cannot see it."""
    n = len(set(zip(table["panel"], table["parameter"], strict=True)))
    return f"Horizontal bars in {n} panel{'s' if n != 1 else ''}. " + caption(evidence, table).split("Largest: ")[1]
