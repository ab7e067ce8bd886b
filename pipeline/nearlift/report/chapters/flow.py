"""Flow and lift: downwash measured, mean fields, and the wake over a tilted ground."""

from __future__ import annotations

import math

from markupsafe import Markup

from nearlift.campaign.piv import PivCase
from nearlift.flow.downwash import WARNINGS
from nearlift.report import blocks
from nearlift.report.evidence import Evidence
from nearlift.report.figures import fig5
from nearlift.report.figures.flow_panels import cut, manifest
from nearlift.rounding import fixed, like, plain
from nearlift.stages.flow import DOWNWASH, FLOW_TOPOLOGY

#: Rows of the table of topology: title and decimals by column of flow_topology.parquet.
TOPOLOGY = {
    "vortices_ccw": ("vortices, counter-clockwise", 0),
    "vortices_cw": ("vortices, clockwise", 0),
    "stagnation_area_hat2": ("stagnation zone, area / r²", 2),
    "stagnation_height_hat": ("stagnation zone, height / r", 2),
}


def facts(evidence: Evidence) -> Markup:
    """Downwash measured and implied near each boundary, every case, and the wake."""
    tilted = fig5.cases(evidence)
    wake = blocks.figure("fig5"), _topology(evidence, tilted)
    return blocks.join(
        blocks.figure("downwash"),
        blocks.figure("fig3"),
        blocks.fold("Every case", _cases(evidence), blocks.figure("fig4")),
        blocks.fold("The wake over a tilted ground", *wake) if tilted else "",
    )


def _cases(evidence: Evidence) -> Markup:
    """Table of all cases, and the meaning of their remarks."""
    piv = manifest(evidence)
    rows, warnings = [], set()
    for case in piv.case:
        row = cut(evidence, case.name)
        u, named = 100 * row["u_reduction"], row["warnings"].split()
        warnings |= {*named}
        ends = ("reduction", "reduction_lo90", "reduction_hi90")
        reduction = "{} ({} to {})".format(*(like(100 * row[key], u) for key in ends))
        if not math.isfinite(row["reduction"]):
            reduction = "–"
        speeds = [like(row[k], row["u_downwash_m_s"]) for k in ("downwash_m_s", "u_downwash_m_s")]
        height = row["clearance_hat"]
        rows.append(
            (
                case.name,
                "∞" if math.isinf(row["z_hat"]) else plain(row["z_hat"], 3),
                fixed(math.degrees(row["tilt_rad"]), 1),
                str(row["n_fields"]),
                " ± ".join(speeds) if math.isfinite(row["downwash_m_s"]) else "–",
                fixed(100 * row["covered"], 0),
                "–" if math.isinf(height) else plain(height, 3),
                "control" if case.name == piv.control else reduction,
                ", ".join(w.replace("_", " ") for w in named),
            )
        )
    heads = (
        *("case", "ẑ", "tilt, °", "fields", "downwash, m/s", "covered, %"),
        *("cut above boundary, r", "reduction, % (90 %)", "remark"),
    )
    caption = "Downwash through the cut beneath the rotors, and its reduction against the control"
    meanings = [f"{w.replace('_', ' ')}: {WARNINGS[w]}." for w in sorted(warnings)]
    return blocks.join(
        blocks.table(caption, heads, rows, source=DOWNWASH.file), blocks.items(meanings)
    )


def _topology(evidence: Evidence, cases: list[PivCase]) -> Markup:
    columns = [fig5.topology(evidence, c.name) for c in cases]
    rows: list[tuple[object, ...]] = [
        (title, *(fixed(float(column[name]), places) for column in columns))
        for name, (title, places) in TOPOLOGY.items()
    ]
    rows.append(("jets along the ground", *(column["jets"] or "–" for column in columns)))
    tilts = (f"{math.degrees(c.tilt):+.1f}°".replace("-", "−") for c in cases)
    source = FLOW_TOPOLOGY.file
    return blocks.table("The wake at each tilt", ("tilt", *tilts), rows, hidden=True, source=source)
