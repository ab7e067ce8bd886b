"""The closed loop's findings, as diagnosis.json has them: what each boundary's section of the
chapter says.
"""

from __future__ import annotations

from typing import Any

from nearlift.declare import BOUNDARIES, Boundary
from nearlift.products import DIAGNOSIS
from nearlift.report.chapters import loop_words
from nearlift.report.documents import brief
from nearlift.report.evidence import Evidence
from nearlift.report.findings import could_have_seen, to_log
from nearlift.report.number import Number, chance, cite

#: So many lines of structure, and of silent effects, are shown.
LINES = 12


def facts(evidence: Evidence) -> dict[str, Any]:
    """A section for each boundary that was diagnosed, and why the others were not."""
    content = evidence.document(DIAGNOSIS)
    rate = (
        cite(evidence, DIAGNOSIS, "false_alarm_rate", scale=100, digits=3, how="in percent")
        if "false_alarm_rate" in content
        else None
    )
    return {
        "sections": [
            _section(evidence, b, found) for b in BOUNDARIES if (found := evidence.diagnosed(b))
        ],
        "not_diagnosed": {b: reason for b in BOUNDARIES if (reason := evidence.not_diagnosed(b))},
        "rate": rate,
    }


def _section(evidence: Evidence, boundary: Boundary, found: dict[str, Any]) -> dict[str, Any]:
    path = ("boundaries", boundary)
    coefficients = found.get("coefficients", {})
    structure = [
        {
            "covariate": s["covariate"],
            "p": chance(evidence, DIAGNOSIS, *path, "structure", str(i), "p_value"),
            "significant": s.get("significant"),
        }
        for i, s in enumerate(found.get("structure", [])[:LINES])
    ]
    return {
        "boundary": boundary,
        "kind": found["verdict"],
        "carried": coefficients.get("carried", []),
        "verdict": brief.verdict(evidence, boundary),
        "largest": loop_words.largest(evidence, boundary, found),
        "look": found.get("look", {}).get("text", ""),
        "effects": loop_words.effects(evidence, boundary, found),
        "not_confirmed": [" + ".join(names) for names in found.get("not_confirmed", [])],
        "partial": [
            {
                "name": p["name"],
                "share": cite(
                    evidence,
                    DIAGNOSIS,
                    *path,
                    "partial",
                    str(i),
                    "share",
                    scale=100,
                    digits=2,
                    how="in percent",
                ),
            }
            for i, p in enumerate(found.get("partial", []))
        ],
        "structure": structure,
        "along": [s for s in structure if s["significant"]] or structure[:1],
        "error": _error(evidence, boundary, found),
        "outcome": loop_words.outcome(found),
        "folds": loop_words.folds(evidence, boundary, found),
        "within": loop_words.within(evidence, boundary, found),
        "candidates": loop_words.candidates(evidence, boundary, found),
        "nearly_all": next(
            (
                r["reason"]
                for r in found.get("rounds", [])
                if r["reason"].startswith("accounts for")
            ),
            "",
        ),
        "by_visits": any(
            c.get("judged_by") for r in found.get("rounds", []) for c in r.get("candidates", [])
        ),
        "rounds": found.get("rounds", []),
        "limits": [
            line["text"]
            for key in ("shifts", "limits")
            for line in found.get(key, [])
            if "text" in line
        ],
        "sensitivity": found.get("sensitivity", {}),
        "could_have_seen": could_have_seen(found),
        "untestable": found.get("untestable", []),
        "log": to_log(found),
        "silent": _silent(evidence, boundary, found),
        "next_experiment": loop_words.proposals(evidence, boundary, found),
    }


def _silent(evidence: Evidence, boundary: str, found: dict[str, Any]) -> list[dict[str, Any]]:
    path = ("boundaries", boundary, "silent")
    return [
        {
            "effect": s["effect"],
            "absorbed_by": s.get("absorbed_by", ""),
            "bias": cite(evidence, DIAGNOSIS, *path, str(i), "bias_at_detection_limit", digits=2),
            "coefficient": s.get("in_units_of", "").removeprefix("u(").removesuffix(")"),
            "u": cite(evidence, DIAGNOSIS, *path, str(i), "u", digits=2)
            if s.get("u") is not None
            else None,
            "hidden": bool(s.get("hidden")),
        }
        for i, s in enumerate(found.get("silent", [])[:LINES])
    ]


def _error(evidence: Evidence, boundary: str, found: dict[str, Any]) -> dict[str, Number] | None:
    """Held-out errors in percent of lift, before and after, beside the noise floor."""
    if "error" not in found:
        return None
    path = ("boundaries", boundary, "error")

    def percent(*keys: str) -> Number:
        return cite(
            evidence, DIAGNOSIS, *path, *keys, scale=100, digits=3, how="in percent of lift"
        )

    keys = [
        (when, key) for when in ("before", "after") for key in ("held_out_rmse", "lo90", "hi90")
    ]
    cited = {"floor": percent("noise_floor")} | {
        f"{when}_{key}": percent(when, key) for when, key in keys
    }
    if found["error"].get("change", {}).get("lo90") is not None:
        cited |= {
            f"change_{k}": cite(
                evidence, DIAGNOSIS, *path, "change", k, scale=100, digits=2, how="in percent"
            )
            for k in ("value", "lo90", "hi90")
        }
    return cited
