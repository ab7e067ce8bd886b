"""A coefficient over many campaigns, as the forest plot draws it: one row a campaign, then the population and the next campaign."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nearlift.summaries.evidence import Columns

TEXT = ("panel", "coefficient", "unit", "kind", "label", "vehicle", "verdict")
REAL = ("value", "lo90", "hi90", "before", "before_lo90", "before_hi90")


def summarise(content: Mapping[str, Any]) -> Columns:
    """Rows of comparison.json: `kind` is campaign, population or next; `before` is the fit without what the loop found."""
    rows: list[dict[str, Any]] = []
    for group in content["groups"]:
        unit = group["campaigns"][0]["after"]["unit"]
        shared = {"panel": group["boundary"], "coefficient": group["coefficient"], "unit": unit}
        for own in group["campaigns"]:
            rows.append(
                {**shared, "kind": "campaign", "label": own["campaign"], "vehicle": own["vehicle"], "verdict": own["verdict"]}
                | _interval(own["after"])
                | {f"before{name}": own["before"][key] for name, key in (("", "value"), ("_lo90", "lo90"), ("_hi90", "hi90"))}
            )
        together = group.get("population")
        if together:
            rows.append({**shared, "kind": "population", "label": "population mean"} | _interval(together["mean"]))
            rows.append({**shared, "kind": "next", "label": "next campaign"} | _interval(together["next"]))
    text = {name: np.array([row.get(name, "") for row in rows], dtype=object) for name in TEXT}
    return text | {name: np.array([row.get(name, np.nan) for row in rows], dtype=float) for name in REAL}


def _interval(estimate: Mapping[str, Any]) -> dict[str, float]:
    return {name: estimate[name] for name in ("value", "lo90", "hi90")}
