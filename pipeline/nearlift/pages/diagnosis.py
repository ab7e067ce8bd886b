"""The closed loop's findings, as diagnosis.json has them."""

from __future__ import annotations

from typing import Any

from nearlift.declare import BOUNDARIES
from nearlift.pages.number import Number, chance, cite, interval, quote
from nearlift.pages.verdict import WORDS
from nearlift.products import DIAGNOSIS
from nearlift.summaries.evidence import Evidence

#: So many lines of structure, and of silent effects, are shown.
LINES = 12


def facts(evidence: Evidence) -> dict[str, Any]:
    """A section for each boundary that was diagnosed."""
    content = evidence.document(DIAGNOSIS)
    found = content.get("boundaries", {})
    rate = cite(evidence, DIAGNOSIS, "false_alarm_rate", scale=100, digits=3, how="in percent") if "false_alarm_rate" in content else None
    return {"sections": [_section(evidence, b, found[b]) for b in BOUNDARIES if b in found], "rate": rate}


def _section(evidence: Evidence, boundary: str, found: dict[str, Any]) -> dict[str, Any]:
    path = ("boundaries", boundary)
    coefficients = found.get("coefficients", {})
    return {
        "boundary": boundary,
        "verdict": WORDS.get(found["verdict"], found["verdict"]),
        "effects": [
            {
                "name": e["name"],
                "rivals": e.get("rivals", []),
                "parameters": [quote(evidence, DIAGNOSIS, *path, "effects", str(i), "parameters", p) for p in e.get("parameters", {})],
            }
            for i, e in enumerate(found.get("effects", []))
        ],
        "partial": [
            {"name": p["name"], "share": cite(evidence, DIAGNOSIS, *path, "partial", str(i), "share", scale=100, digits=2, how="in percent")}
            for i, p in enumerate(found.get("partial", []))
        ],
        "structure": [
            {
                "covariate": s["covariate"],
                "p": chance(evidence, DIAGNOSIS, *path, "structure", str(i), "p_value"),
                "significant": s.get("significant"),
            }
            for i, s in enumerate(found.get("structure", [])[:LINES])
        ],
        "error": _error(evidence, boundary, found),
        "coefficients": [_coefficient(evidence, boundary, n, coefficients) for n in coefficients.get("before", {})],
        "rounds": found.get("rounds", []),
        "untestable": found.get("untestable", []),
        "silent": [
            {
                "effect": s["effect"],
                "absorbed_by": s.get("absorbed_by", ""),
                "bias": cite(evidence, DIAGNOSIS, *path, "silent", str(i), "bias_at_detection_limit", digits=2),
                "unit": s.get("in_units_of", ""),
            }
            for i, s in enumerate(found.get("silent", [])[:LINES])
        ],
        "next_experiment": found.get("next_experiment", []),
    }


def _error(evidence: Evidence, boundary: str, found: dict[str, Any]) -> dict[str, Number] | None:
    """Held-out errors in percent of lift, before and after, beside the noise floor."""
    if "error" not in found:
        return None
    path = ("boundaries", boundary, "error")

    def percent(*keys: str) -> Number:
        return cite(evidence, DIAGNOSIS, *path, *keys, scale=100, digits=3, how="in percent of lift")

    keys = [(when, key) for when in ("before", "after") for key in ("held_out_rmse", "lo90", "hi90")]
    return {"floor": percent("noise_floor")} | {f"{when}_{key}": percent(when, key) for when, key in keys}


def _coefficient(evidence: Evidence, boundary: str, name: str, coefficients: dict[str, Any]) -> dict[str, Any]:
    path = ("boundaries", boundary, "coefficients")
    after = name in coefficients.get("after", {})
    return {
        "before": quote(evidence, DIAGNOSIS, *path, "before", name),
        "after": quote(evidence, DIAGNOSIS, *path, "after", name) if after else None,
        "conditional": interval(evidence, boundary, name, "conditional"),
        "constrained": interval(evidence, boundary, name, "constrained"),
    }
