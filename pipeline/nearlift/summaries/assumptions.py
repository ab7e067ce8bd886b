"""What the ratio takes for granted, as drawn: the coefficient per throttle, against the exponent of
the held quantity, and C_L against speed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from nearlift.declare import Boundary
from nearlift.products import FIT
from nearlift.rounding import plain
from nearlift.summaries.evidence import Columns, Evidence

PARTS = ("throttle", "exponent", "rotor")
NUMBERS = ("x", "value", "lo90", "hi90", "lo90_apart", "hi90_apart")


def summarise(evidence: Evidence) -> Columns:
    """Everything that is drawn, a row each.

    Returns
    -------
    dict of arrays
        `panel` (boundary), `part`, `kind`, `label` (the coefficient's name), `x`, `value`, `lo90`,
        `hi90`, `lo90_apart`, `hi90_apart`. Part `throttle`: kinds `throttle` (x in per cent; the
        interval `apart` is without what all throttles share) and `common`. Part `exponent`: kinds
        `curve`, `plausible`, and `supported` (an end of what the logs leave). Part `rotor`: kinds
        `C_L` (x in Hz), `law`, `paper`.
    """
    rows: list[dict[str, Any]] = []
    for boundary in evidence.boundaries:
        rows += [
            {"panel": boundary, "part": "throttle", **r} for r in _throttles(evidence, boundary)
        ]
        rows += [
            {"panel": boundary, "part": "exponent", **r} for r in _exponents(evidence, boundary)
        ]
        rows += [{"panel": boundary, "part": "rotor", **r} for r in _rotor(evidence, boundary)]
    texts = {
        name: np.array([r[name] for r in rows], dtype=object)
        for name in ("panel", "part", "kind", "label")
    }
    return {
        **texts,
        **{name: np.array([r.get(name, np.nan) for r in rows], dtype=float) for name in NUMBERS},
    }


def entry(evidence: Evidence, question: str, boundary: Boundary) -> dict[str, Any]:
    """What fit.json says beside one boundary's base fit; empty where it says nothing."""
    found: dict[str, Any] = evidence.document(FIT).get(question, {}).get(boundary, {})
    return found


def _estimate(e: dict[str, Any]) -> dict[str, float]:
    return {k: e[k] for k in ("value", "lo90", "hi90")}


def _throttles(evidence: Evidence, boundary: Boundary) -> list[dict[str, Any]]:
    found = entry(evidence, "throttle_collapse", boundary)
    each = found.get("per_throttle", {})
    if len(each) < 2:
        return []
    name = found["coefficient"]
    _, base = evidence.base(boundary)
    rows = [{"kind": "common", "label": name, **_estimate(base["parameters"][name])}]
    for throttle, e in each.items():
        apart = (e["hi90"] - e["value"]) * e["u_apart"] / e["u"]
        around = {"lo90_apart": e["value"] - apart, "hi90_apart": e["value"] + apart}
        rows.append(
            {
                "kind": "throttle",
                "label": name,
                "x": 100 * float(throttle),
                **_estimate(e),
                **around,
            }
        )
    return rows


def _exponents(evidence: Evidence, boundary: Boundary) -> list[dict[str, Any]]:
    found = entry(evidence, "held_quantity", boundary)
    if not found.get("curve"):
        return []
    name = found["coefficient"]
    rows = [
        {"kind": kind, "label": name, "x": e["n"], **_estimate(e)}
        for kind in ("curve", "plausible")
        for e in found[kind]
    ]
    return rows + [
        {"kind": "supported", "label": name, "x": n} for n in found["supported_exponents"] or ()
    ]


def _rotor(evidence: Evidence, boundary: Boundary) -> list[dict[str, Any]]:
    found = entry(evidence, "rotor_coefficient", boundary)
    if not found.get("per_throttle"):
        return []
    points = [
        {"kind": "C_L", "label": "C_L", "x": e["speed_Hz"], **_estimate(e)}
        for e in found["per_throttle"].values()
    ]
    rows = [*points, {"kind": "paper", "label": "C_L", "value": found["paper"]}]
    if found["exponent"] is not None:
        speeds = np.geomspace(min(p["x"] for p in points), max(p["x"] for p in points), 41)
        law = (
            found["law"]["C_L"] * (speeds / found["law"]["speed_Hz"]) ** found["exponent"]["value"]
        )
        rows += [
            {"kind": "law", "label": "C_L", "x": float(x), "value": float(c)}
            for x, c in zip(speeds, law, strict=True)
        ]
    return rows


def caption(evidence: Evidence, table: Columns) -> str:
    """What each row of panels shows."""
    parts = []
    if (table["part"] == "throttle").any():
        parts.append(
            "Coefficient of the base fit per throttle (symbols) and for all (line, 90 % band)."
        )
        parts.append(
            "Thick: 90 % interval of what parts a throttle from the others; thin: with the errors"
            " that all throttles share."
        )
    if (table["part"] == "exponent").any():
        parts.append(
            "Coefficient of the base fit against the exponent n to which the model's ratio is"
            " raised (line, 90 % band):"
        )
        parts.append(
            "1 as published, 2/3 constant power, 0.60 to 0.82 constant rotor speed (symbols)."
        )
    if (table["kind"] == "supported").any():
        parts.append("Shade: what the logged speed or power leaves.")
    if (table["part"] == "rotor").any():
        parts.append(
            "Rotor coefficient per throttle against rotor speed, 90 % intervals; line: power law;"
        )
        parts.append("dashed: the constant of Carter et al. 2021.")
    return " ".join(parts)


def alt(evidence: Evidence, table: Columns) -> str:
    """The picture's numbers for those who do not see it."""
    parts = []
    for boundary in dict.fromkeys(table["panel"].tolist()):
        mine = table["panel"] == boundary
        for part, kind, what, unit in (
            ("throttle", "throttle", "per throttle", " %"),
            ("exponent", "plausible", "per exponent", ""),
            ("rotor", "C_L", "per speed", " Hz"),
        ):
            rows = np.flatnonzero(mine & (table["part"] == part) & (table["kind"] == kind))
            if len(rows):
                each = ", ".join(
                    f"{plain(float(table['value'][i]), 3)} at"
                    f" {plain(float(table['x'][i]), 3)}{unit}"
                    for i in rows
                )
                parts.append(f"{boundary.capitalize()}: {table['label'][rows[0]]} {what}: {each}.")
    return " ".join(parts)
