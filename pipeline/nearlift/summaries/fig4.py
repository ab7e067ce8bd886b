"""Figure 4: airspeed less the control's, near the ceiling and near the ground, as the boundary is
approached.
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.flow.contrast import difference
from nearlift.flow.field import Field
from nearlift.manifest.piv import PivCase
from nearlift.rounding import plain
from nearlift.summaries.evidence import Columns, Evidence, stack
from nearlift.summaries.flow_panels import field_rows, manifest, nodes, origin, title

LEVEL = 1e-3
ROWS = ("ceiling", "ground")


def cases(evidence: Evidence) -> list[PivCase]:
    """Untilted cases near a boundary, ceiling first, farthest first."""
    piv = manifest(evidence)
    found = [c for c in piv.case if c.boundary in ROWS and abs(c.tilt) < LEVEL]
    return sorted(found, key=lambda c: (ROWS.index(c.boundary), -(c.z_hat or 0.0)))


def as_field(table: Columns) -> Field:
    """The mean field of one case from its rows."""
    x, y = np.unique(table["x_m"]), np.unique(table["y_m"])
    shape = (len(y), len(x))
    return Field(
        x_m=x, y_m=y, vx_m_s=table["vx_m_s"].reshape(shape), vy_m_s=table["vy_m_s"].reshape(shape)
    )


def less_control(evidence: Evidence, name: str) -> FloatArray:
    """Airspeed less the control's at each node of a case; nan where either has no vector."""
    return difference(
        as_field(nodes(evidence, name)), as_field(nodes(evidence, manifest(evidence).control))
    ).ravel()


def summarise(evidence: Evidence) -> Columns:
    """Rows as in Figure 3's upper panels; `value_m_s` is airspeed less the control's. Empty where
    no case lies near a boundary.
    """
    found = cases(evidence)
    if not found:
        return {}
    return stack([field_rows(evidence, c, title(c), less_control(evidence, c.name)) for c in found])


def caption(evidence: Evidence, table: Columns) -> str:
    """What the reader must know."""
    return (
        "Time-averaged airspeed less that of the control (blue: slower, red: faster) with the"
        " streamlines of each case, as the ceiling (upper row) and the ground (lower row) come"
        " nearer; one colour scale for each row; grey: no vectors in the case or in the control."
        f" {origin(evidence)}"
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = []
    for case in cases(evidence):
        value = table["value_m_s"][(table["panel"] == case.name) & (table["kind"] == "node")]
        known = value[np.isfinite(value)]
        parts.append(
            f"{case.boundary} {plain(case.z_hat or 0.0, 3)}: {plain(float(known.min()), 2)} to"
            f" {plain(float(known.max()), 2)} m/s"
        )
    return (
        "Maps of airspeed less the control's. Range at each distance over rotor radius:"
        f" {'; '.join(parts)}."
    )
