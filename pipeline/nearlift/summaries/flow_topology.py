"""The wake's topology against tilt: vortices, stagnation zone, split angle, left and right, each
with its bootstrap interval.
"""

from __future__ import annotations

import numpy as np

from nearlift.products import FLOW_TOPOLOGY
from nearlift.summaries import fig5
from nearlift.summaries.evidence import Columns, Evidence, stack, text_column
from nearlift.summaries.flow_panels import origin

#: Panel, its axis label, and the quantities in it with what the legend calls them.
PANELS = (
    ("vortices", "vortices", (("vortices_ccw", "counter-clockwise"), ("vortices_cw", "clockwise"))),
    ("area", "stagnation area / $r^2$", (("stagnation_area_hat2", ""),)),
    ("height", "stagnation height / $r$", (("stagnation_height_hat", ""),)),
    ("split", "split angle (deg)", (("split_angle_deg", ""),)),
    ("asymmetry", "asymmetry", (("asymmetry", ""),)),
)


def summarise(evidence: Evidence) -> Columns:
    """A row for each number of each tilted case: `panel`, `axis`, `label`, `tilt_deg`, `value`,
    `lo90`, `hi90`.
    """
    names = [c.name for c in fig5.cases(evidence)]
    if not names:
        return {}
    table = evidence.table(FLOW_TOPOLOGY)
    parts = []
    for panel, axis, quantities in PANELS:
        for quantity, label in quantities:
            mine = np.isin(table["case"], names) & (table["quantity"] == quantity)
            mine &= np.isfinite(table["value"])
            order = np.argsort(table["tilt_rad"][mine])
            n = int(mine.sum())
            parts.append(
                {
                    "panel": text_column(panel, n),
                    "axis": text_column(axis, n),
                    "label": text_column(label, n),
                    "tilt_deg": np.degrees(table["tilt_rad"][mine][order]),
                    "value": table["value"][mine][order],
                    "lo90": table["lo90"][mine][order],
                    "hi90": table["hi90"][mine][order],
                }
            )
    return stack(parts)


def caption(evidence: Evidence, table: Columns) -> str:
    """What the reader must know."""
    return (
        "Topology of the wake against tilt of the ground. Bars: 90 % intervals over resampled sets"
        " of fields. Asymmetry: right-going less left-going momentum beneath the rotor plane over"
        f" their sum. {origin(evidence)}"
    )


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    parts = []
    for panel in dict.fromkeys(table["panel"].tolist()):
        values = table["value"][table["panel"] == panel]
        parts.append(f"{panel} from {values.min():.3g} to {values.max():.3g}".replace("-", "−"))
    return f"Numbers of the wake against tilt: {'; '.join(parts)}."
