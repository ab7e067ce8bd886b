"""Flow and lift: downwash measured, what each model implies, convergence, topology."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, LiftModel
from nearlift.flow.downwash import WARNINGS
from nearlift.report.evidence import Evidence
from nearlift.report.figures import fig5
from nearlift.report.figures.flow_panels import cut, manifest
from nearlift.report.number import Number, Place, pointer
from nearlift.rounding import fixed, like, plain
from nearlift.stages.fit import FIT
from nearlift.stages.flow import DOWNWASH, FLOW, FLOW_TOPOLOGY

#: Statements of the paper and their check; tests recompute every number.
CLAIMS = (
    (
        "22 % less downwash near the ceiling (ẑ = 2)",
        (
            "The paper's own Eq. 3 implies 0.8 % there, and its text calls that flow almost"
            " identical to the control: the labels are probably swapped."
        ),
    ),
    (
        "6 % less near the ground (ẑ = 3.4)",
        (
            "The cut is 1.4 radii above the floor, where the jet turns. It does not measure the"
            " inflow at the disk, which images reduce by 1.5 to 1.7 %."
        ),
    ),
    (
        "Cheeseman and Bennett predict 0.4 % at ẑ = 3.4",
        "Their formula gives 0.54 %; 0.4 % belongs to ẑ = 3.95.",
    ),
)
#: Rows of the table of topology: title and decimals by column of flow_topology.parquet.
NUMBERS = {
    "vortices_ccw": ("vortices, counter-clockwise", 0),
    "vortices_cw": ("vortices, clockwise", 0),
    "stagnation_area_hat2": ("stagnation zone, area / r²", 2),
    "stagnation_height_hat": ("stagnation zone, height / r", 2),
}


def facts(evidence: Evidence) -> dict[str, object]:
    """Tables of the chapter."""
    piv = manifest(evidence)
    return {
        "simulated": evidence.campaign.simulated,
        "control": piv.control,
        "measured": [_measured(evidence, c.name) for c in piv.case],
        "warnings": sorted(
            {w for c in piv.case for w in cut(evidence, c.name)["warnings"].split()}
        ),
        "meanings": WARNINGS,
        "implied": [
            table for b in ("ground", "ceiling") if (table := _implied(evidence, b)) is not None
        ],
        "convergence": [Place(evidence, FLOW, ("cases", c.name)) for c in piv.case],
        "topology": _topology(evidence),
        "claims": CLAIMS,
    }


def _measured(evidence: Evidence, name: str) -> dict[str, object]:
    row = cut(evidence, name)
    z_hat, tilt, clearance = row["z_hat"], math.degrees(row["tilt_rad"]), row["clearance_hat"]
    u_flow, u = row["u_downwash_m_s"], 100 * row["u_reduction"]

    def entry(key: str, text: str, how: str = "") -> Number:
        how = f"{key} of case {name}, rotor {row['rotor']}{how}"
        return Number(text=text, value=float(row[key]), source=DOWNWASH.file, how=how)

    def percent(key: str) -> Number:
        value = 100 * row[key]
        text = like(value, u) if math.isfinite(u) and u > 0 else plain(value, 3)
        return entry(key, text, ", in percent")

    return {
        "name": name,
        "z_hat": "∞" if math.isinf(z_hat) else plain(z_hat, 3),
        "tilt": fixed(tilt, 1) if abs(row["tilt_rad"]) > 1e-4 else "0",
        "fields": entry("n_fields", str(row["n_fields"])),
        "downwash": entry("downwash_m_s", like(row["downwash_m_s"], u_flow), ", in m/s"),
        "u": entry("u_downwash_m_s", like(u_flow, u_flow), ", in m/s"),
        "covered": entry("covered", fixed(100 * row["covered"], 0), ", in percent"),
        "clearance": entry("clearance_hat", "–" if math.isinf(clearance) else plain(clearance, 3)),
        "reduction": None if name == manifest(evidence).control else percent("reduction"),
        "lo90": percent("reduction_lo90"),
        "hi90": percent("reduction_hi90"),
        "seen": math.isfinite(row["reduction"]),
        "warnings": row["warnings"].split(),
    }


def _implied(evidence: Evidence, boundary: Boundary) -> dict[str, object] | None:
    """Downwash that each model implies at the untilted cases."""
    cases = sorted(
        (c for c in manifest(evidence).case if c.boundary == boundary and abs(c.tilt) < 1e-4),
        key=lambda c: -(c.z_hat or 0),
    )
    if not cases:
        return None
    vehicle, geometry = evidence.campaign.vehicle, evidence.campaign.geometry()
    z_hat = np.array([c.z_hat for c in cases], dtype=float)
    fitted = evidence.fits.boundaries.get(boundary, {})
    rows, base = [], None
    for model in catalogue.models(boundary):
        classic = model.name in ("cheeseman_bennett_fixed", "cheeseman_bennett")
        if model.downwash is None or not (classic or model.suits(vehicle.rotors, geometry)):
            continue
        declared = reduction_percent(
            model, z_hat, {p.name: p.value for p in model.parameters}, geometry
        )
        entry = fitted.get(model.name)
        ours = (
            reduction_percent(model, z_hat, entry.values, geometry)
            if entry and model.parameters
            else None
        )
        source = pointer(FIT, "boundaries", boundary, model.name, "parameters")
        if model.name == evidence.fits.base.get(boundary):
            base = _shortfall((ours or declared)[-1], source, "these")
        rows.append(
            {
                "title": model.title,
                "declared": [
                    _shortfall(v, f"model {model.name}", "its declared values") for v in declared
                ],
                "fitted": None if ours is None else [_shortfall(v, source, "these") for v in ours],
            }
        )
    return {
        "boundary": boundary,
        "z_hat": [plain(z, 3) for z in z_hat],
        "measured": [_measured(evidence, c.name) for c in cases],
        "rows": rows,
        "base": base,
    }


def reduction_percent(
    model: LiftModel, z_hat: Any, parameters: dict[str, float], geometry: dict[str, object]
) -> list[float]:
    """Percent by which a model's induced velocity at the disk falls short of its value far away."""
    assert model.downwash is not None
    known = {n: geometry[n] for n in model.needs}
    with np.errstate(invalid="ignore", divide="ignore"):
        velocity = np.broadcast_to(
            np.asarray(model.downwash(z_hat, **parameters, **known), dtype=float), np.shape(z_hat)
        )
    return [100 * (1 - float(v)) for v in velocity]


def _shortfall(percent: float, source: str, values: str) -> Number:
    places = 2 if abs(percent) < 10 else 1
    return Number(
        text=fixed(percent, places) if math.isfinite(percent) else "–",
        value=percent,
        source=source,
        how=f"1 - downwash at {values}, in percent",
    )


def _topology(evidence: Evidence) -> dict[str, object] | None:
    cases = fig5.cases(evidence)
    if not cases:
        return None
    table = [fig5.topology(evidence, c.name) for c in cases]
    return {
        "tilts": [f"{math.degrees(c.tilt):+.1f}°".replace("-", "−") for c in cases],
        "rows": [
            {"title": title, "cells": [_cell(row, name, places) for row in table]}
            for name, (title, places) in NUMBERS.items()
        ],
        "jets": [row["jets"] or "–" for row in table],
    }


def _cell(row: dict[str, Any], name: str, places: int) -> Number:
    value, how = float(row[name]), f"{name} of case {row['case']}"
    return Number(text=fixed(value, places), value=value, source=FLOW_TOPOLOGY.file, how=how)
