"""Mean fields as rows that a figure draws: nodes over rotor radius, rotors, boundary, vortices, the
cut.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from nearlift.declare import FloatArray
from nearlift.flow.downwash import NOT_AT_THE_DISK
from nearlift.flow.scene import Scene
from nearlift.manifest.piv import Piv, PivCase
from nearlift.products import DOWNWASH, DOWNWASH_PROFILE, FLOW, FLOW_FIELDS
from nearlift.rounding import fixed
from nearlift.summaries.evidence import Columns, Evidence, stack, text_column

#: Everything a node has; other rows leave most of it empty.
NUMBERS = ("x_hat", "y_hat", "vx_m_s", "vy_m_s", "value_m_s", "u_value_m_s", "flag")


def manifest(evidence: Evidence) -> Piv:
    """[piv]; the figures that ask for it are made only where its products exist."""
    assert evidence.campaign.piv is not None
    return evidence.campaign.piv


def scene(evidence: Evidence, case: PivCase) -> Scene:
    """Where rotors and boundary stand."""
    r = evidence.campaign.vehicle.rotor_radius
    return Scene(
        boundary=case.boundary,
        distance_m=math.inf if case.z_hat is None else case.z_hat * r,
        tilt_rad=case.tilt,
        rotors_m=tuple(manifest(evidence).of(case, "rotors")),
        radius_m=r,
    )


def title(case: PivCase, tilted: bool = False) -> str:
    """What stands above a panel."""
    if tilted:
        return f"$\\theta = {math.degrees(case.tilt):+.1f}^\\circ$"
    return "control" if case.z_hat is None else f"{case.boundary}, $\\hat{{z}} = {case.z_hat:g}$"


def rows(panel: str, kind: str, label: str, **columns: Any) -> Columns:
    """Rows of one kind in one panel."""
    n = max(len(np.atleast_1d(c)) for c in columns.values())
    empty = np.full(n, np.nan)
    numbers = {
        name: np.broadcast_to(np.asarray(columns.get(name, empty), dtype=float), (n,))
        for name in NUMBERS
    }
    return {
        "panel": text_column(panel, n),
        "kind": text_column(kind, n),
        "label": text_column(label, n),
        **numbers,
    }


def nodes(evidence: Evidence, name: str) -> Columns:
    """The rows of flow_fields.parquet of one case, with x and y over rotor radius and the speed."""
    table = evidence.table(FLOW_FIELDS)
    mine = table["case"] == name
    r = evidence.campaign.vehicle.rotor_radius
    found = {k: v[mine] for k, v in table.items()}
    return found | {
        "x_hat": found["x_m"] / r,
        "y_hat": found["y_m"] / r,
        "speed_m_s": np.hypot(found["vx_m_s"], found["vy_m_s"]),
    }


def field_rows(
    evidence: Evidence, case: PivCase, label: str, value: FloatArray | None = None
) -> Columns:
    """One panel: its nodes coloured by speed (or by `value`), its rotors and its boundary."""
    r = evidence.campaign.vehicle.rotor_radius
    found = nodes(evidence, case.name)
    place = scene(evidence, case)
    shown = found["speed_m_s"] if value is None else value
    parts = [
        rows(
            case.name,
            "node",
            label,
            x_hat=found["x_hat"],
            y_hat=found["y_hat"],
            vx_m_s=found["vx_m_s"],
            vy_m_s=found["vy_m_s"],
            value_m_s=shown,
            flag=found["stagnant"],
        )
    ]
    parts += [
        rows(case.name, "rotor", label, x_hat=[c / r - 1, c / r + 1], y_hat=[0.0, 0.0])
        for c in place.rotors_m
    ]
    if case.boundary != "none":
        ends = np.array([found["x_m"].min() - 2 * r, found["x_m"].max() + 2 * r])
        parts.append(
            rows(
                case.name,
                "boundary",
                label,
                x_hat=ends / r,
                y_hat=place.boundary_y_m(ends) / r,
                flag=1.0 if case.boundary == "ground" else -1.0,
            )
        )
    return stack(parts)


def profile_rows(evidence: Evidence, name: str, panel: str, kind: str) -> Columns:
    """The cut of one case; `flag` is 1 where it was mirrored."""
    table = evidence.table(DOWNWASH_PROFILE)
    mine = table["case"] == name
    r = evidence.campaign.vehicle.rotor_radius
    return rows(
        panel,
        kind,
        name,
        x_hat=table["x_m"][mine] / r,
        value_m_s=table["downwash_m_s"][mine],
        u_value_m_s=table["u_downwash_m_s"][mine],
        flag=table["mirrored"][mine],
    )


def cut(evidence: Evidence, name: str, rotor: str = "all") -> dict[str, Any]:
    """The row of downwash.parquet of one case."""
    table = evidence.table(DOWNWASH)
    (i,) = np.flatnonzero((table["case"] == name) & (table["rotor"] == rotor))
    return {k: v[i] for k, v in table.items()}


def reduction_text(row: dict[str, Any]) -> str:
    """``8.7 % (90 %: 3.4 to 13.9)``, and where that does not speak of the disk, so; a dash where
    the cut has no vectors.
    """
    if not math.isfinite(row["reduction"]):
        return "–"
    elsewhere = (
        ", not the inflow at the disk"
        if set(str(row["warnings"]).split()) & set(NOT_AT_THE_DISK)
        else ""
    )
    if not math.isfinite(row["reduction_lo90"]):
        return f"{fixed(100 * row['reduction'], 1)} %{elsewhere}"
    span = f"{fixed(100 * row['reduction_lo90'], 1)} to {fixed(100 * row['reduction_hi90'], 1)}"
    return f"{fixed(100 * row['reduction'], 1)} % (90 %: {span}){elsewhere}"


def origin(evidence: Evidence) -> str:
    """What the fields are, for captions: simulated or measured, how many, which mirrored."""
    facts = evidence.document(FLOW)["cases"]
    counts = sorted({int(f["fields"]) for f in facts.values()})
    number = str(counts[0]) if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    said = (
        f"{'SIMULATED fields, no measurement. ' if evidence.campaign.simulated else ''}Each panel"
        f" is the mean of {number} velocity fields"
    )
    reflected = [n for n, f in facts.items() if f["mirrored"]]
    if reflected:
        share = "all" if len(reflected) == len(facts) else f"{len(reflected)} of {len(facts)}"
        said += f"; in {share} cases one half was measured and the other is its reflection"
    return said + "."
