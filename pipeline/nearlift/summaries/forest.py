"""A coefficient over many campaigns, as the forest plot draws it: one row a campaign, then the
population and the next campaign.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nearlift.rounding import letter, like
from nearlift.summaries.evidence import Columns

#: A 90 % interval of a normal is so many standard deviations wide.
WIDTH_90 = 3.289707253902945
TEXT = ("panel", "coefficient", "unit", "kind", "label", "vehicle", "verdict")
REAL = ("value", "lo90", "hi90")


def summarise(content: Mapping[str, Any]) -> Columns:
    """Rows of comparison.json: `kind` is campaign, population or next."""
    rows: list[dict[str, Any]] = []
    for group in content["groups"]:
        unit = group["campaigns"][0]["quoted"]["unit"]
        shared = {"panel": group["boundary"], "coefficient": group["coefficient"], "unit": unit}
        for own in group["campaigns"]:
            rows.append(
                {
                    **shared,
                    "kind": "campaign",
                    "label": own["campaign"],
                    "vehicle": own["vehicle"],
                    "verdict": own["verdict"],
                }
                | _interval(own["quoted"])
            )
        together = group.get("population")
        if together:
            rows.append(
                {**shared, "kind": "population", "label": "population mean"}
                | _interval(together["mean"])
            )
            rows.append(
                {**shared, "kind": "next", "label": "next campaign"} | _interval(together["next"])
            )
    text = {name: np.array([row.get(name, "") for row in rows], dtype=object) for name in TEXT}
    return text | {
        name: np.array([row.get(name, np.nan) for row in rows], dtype=float) for name in REAL
    }


def _interval(estimate: Mapping[str, Any]) -> dict[str, float]:
    return {name: estimate[name] for name in ("value", "lo90", "hi90")}


def select(table: Columns, boundary: str, coefficient: str) -> Columns:
    """The rows of one panel."""
    own = (table["panel"] == boundary) & (table["coefficient"] == coefficient)
    return {name: values[own] for name, values in table.items()}


def interval(rows: Columns, i: int) -> str:
    """``2.00 (1.84 to 2.16)``: value and 90 % interval of one row."""
    value, low, high = (float(rows[end][i]) for end in ("value", "lo90", "hi90"))
    u = (high - low) / WIDTH_90
    return f"{like(value, u)} ({like(low, u)} to {like(high, u)})"


def caption(table: Columns) -> str:
    """What is drawn, with counts."""
    campaigns = table["kind"] == "campaign"
    n = len(set(table["label"][campaigns].tolist()))
    parts = [f"Headline coefficients of {n} campaign{'s' if n != 1 else ''}, with 90 % intervals."]
    if (table["verdict"][campaigns] == "unexplained").any():
        parts.append("Open symbols: structure that no named effect explains.")
    if (table["kind"] == "population").any():
        parts.append(
            "Diamond and band: the population's mean; dashed: what a further campaign would find."
        )
    return " ".join(parts)


def alt(table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = []
    for boundary, coefficient in dict.fromkeys(
        zip(table["panel"].tolist(), table["coefficient"].tolist(), strict=True)
    ):
        rows = select(table, boundary, coefficient)
        told = "; ".join(f"{name} {interval(rows, i)}" for i, name in enumerate(rows["label"]))
        parts.append(f"{boundary.capitalize()}, {letter(coefficient)}: {told}.")
    return " ".join(parts)
