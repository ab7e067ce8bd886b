"""Figure 3: mean airspeed and streamlines for the control, a ground and a ceiling; beneath, the
downwash along the cut.
"""

from __future__ import annotations

import numpy as np

from nearlift.manifest.piv import Piv, PivCase
from nearlift.rounding import fixed, plain
from nearlift.summaries.evidence import Columns, Evidence, stack
from nearlift.summaries.flow_panels import (
    cut,
    field_rows,
    manifest,
    origin,
    profile_rows,
    reduction_text,
    rows,
    title,
)

#: Distances of the paper's Figure 3, taken where the manifest names no cases.
PAPER_Z_HAT = {"ground": 3.4, "ceiling": 2.0}


def columns(piv: Piv) -> list[PivCase]:
    """The cases of the figure: the manifest's, else the control and the untilted cases nearest to
    the paper's distances.
    """
    if piv.figure3:
        return [piv.named(n) for n in piv.figure3]
    found = [piv.named(piv.control)]
    for boundary, wanted in PAPER_Z_HAT.items():
        near = [c for c in piv.case if c.boundary == boundary and c.z_hat is not None]
        if near:
            found.append(min(near, key=lambda c: (abs(c.tilt), abs((c.z_hat or 0.0) - wanted))))
    return found


def summarise(evidence: Evidence) -> Columns:
    """Rows by `kind`: node, rotor, boundary (upper panels); profile, control, span, cut (lower
    panels). Lengths over rotor radius.
    """
    piv = manifest(evidence)
    parts = []
    for case in columns(piv):
        row = cut(evidence, case.name)
        r = evidence.campaign.vehicle.rotor_radius
        parts.append(field_rows(evidence, case, title(case)))
        parts.append(profile_rows(evidence, case.name, case.name, "profile"))
        if case.name != piv.control:
            parts.append(profile_rows(evidence, piv.control, case.name, "control"))
        for centre in piv.of(case, "rotors"):
            ends = (np.array([-1.0, 1.0]) * row["half_span_m"] + centre) / r
            parts.append(
                rows(case.name, "span", "", x_hat=ends, y_hat=np.full(2, -row["below_m"] / r))
            )
    return stack(parts)


def caption(evidence: Evidence, table: Columns) -> str:
    """What the reader must know, numbers included."""
    piv = manifest(evidence)
    shown = [c for c in columns(piv) if c.name != piv.control]
    r = evidence.campaign.vehicle.rotor_radius
    first = cut(evidence, piv.control)
    cross = (
        f"Below: downwash along the dashed cut, {plain(first['below_m'] / r, 3)} rotor radii"
        " beneath the rotor plane, with its 90 % band; dotted: the control; shade: the span that"
        f" is averaged. Control: {fixed(first['downwash_m_s'], 2)} m/s."
    )
    first_words = (
        "Time-averaged airspeed (colour) and streamlines; thrust points up, also where the vehicle"
        " hung inverted; grey: no vectors."
    )
    parts = [first_words, origin(evidence), cross]
    parts += [
        f"{c.boundary.capitalize()} at ẑ = {plain(c.z_hat or 0.0, 3)}: reduced by"
        f" {reduction_text(cut(evidence, c.name))}."
        for c in shown
    ]
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """What the picture shows, for those who do not see it."""
    piv = manifest(evidence)
    named = [
        f"{c.name}, downwash {plain(float(cut(evidence, c.name)['downwash_m_s']), 3)} m/s"
        for c in columns(piv)
    ]
    return (
        f"{len(named)} panels of airspeed with streamlines, and beneath each the downwash along a"
        f" cut: {'; '.join(named)}."
    )
