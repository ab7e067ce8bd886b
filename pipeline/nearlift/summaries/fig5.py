"""Figure 5: the wake over a tilted ground: airspeed, streamlines, vortex cores, the stagnation
zone.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from nearlift.manifest.piv import PivCase
from nearlift.products import FLOW, FLOW_TOPOLOGY
from nearlift.rounding import fixed, plain
from nearlift.summaries.evidence import Columns, Evidence, stack
from nearlift.summaries.fig4 import LEVEL
from nearlift.summaries.flow_panels import field_rows, manifest, origin, rows, title


def cases(evidence: Evidence) -> list[PivCase]:
    """Tilted ground cases from the most positive to the most negative tilt."""
    found = [c for c in manifest(evidence).case if c.boundary == "ground" and abs(c.tilt) >= LEVEL]
    return sorted(found, key=lambda c: -c.tilt)


def summarise(evidence: Evidence) -> Columns:
    """Rows as in Figure 3's upper panels; `vortex` rows carry the sign of rotation in `flag`. Empty
    without tilted cases.
    """
    found = cases(evidence)
    if not found:
        return {}
    r = evidence.campaign.vehicle.rotor_radius
    parts = []
    for case in found:
        parts.append(field_rows(evidence, case, title(case, tilted=True)))
        cores = evidence.document(FLOW)["cases"][case.name]["vortices"]
        if cores:
            parts.append(
                rows(
                    case.name,
                    "vortex",
                    "",
                    x_hat=np.array([v["x_m"] for v in cores]) / r,
                    y_hat=np.array([v["y_m"] for v in cores]) / r,
                    flag=np.sign([v["circulation_m2_s"] for v in cores]),
                )
            )
    return stack(parts)


def number(evidence: Evidence, case: str, quantity: str) -> dict[str, Any]:
    """One row of flow_topology.parquet."""
    table = evidence.table(FLOW_TOPOLOGY)
    (i,) = np.flatnonzero((table["case"] == case) & (table["quantity"] == quantity))
    return {k: v[i] for k, v in table.items()}


def caption(evidence: Evidence, table: Columns) -> str:
    """What the reader must know, numbers included."""
    areas = [
        f"{fixed(number(evidence, c.name, 'stagnation_area_hat2')['value'], 2)}"
        for c in cases(evidence)
    ]
    tilts = [f"{math.degrees(c.tilt):+.1f}°".replace("-", "−") for c in cases(evidence)]
    return (
        "Time-averaged airspeed and streamlines over a tilted ground (θ > 0 where the ground falls"
        " away to the right). Circles: standing vortices (cores of Γ₂ > 2/π in which Γ₁ exceeds"
        " 0.5), filled where they turn counter-clockwise. Outline: the stagnation zone, air slower"
        " than 0.3 of the control's downwash that rests on the ground beneath the rotors; its area"
        f" for {', '.join(tilts)} is {', '.join(areas)} r². {origin(evidence)}"
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = []
    for case in cases(evidence):
        ccw, cw = (
            plain(number(evidence, case.name, f"vortices_{s}")["value"]) for s in ("ccw", "cw")
        )
        angle = f"{math.degrees(case.tilt):+.1f}".replace("-", "−")
        parts.append(f"{angle} degrees: {ccw} counter-clockwise and {cw} clockwise vortices")
    return f"{len(parts)} panels of airspeed with streamlines. {'; '.join(parts)}."
