"""results.json as `diagnose` would have written it for findings that a test makes up."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping
from typing import Any

from nearlift.declare import Boundary
from nearlift.flight.quoted_lift import QuotedLift
from nearlift.report.evidence import Evidence
from nearlift.run.engine import Job
from nearlift.stages.diagnose import DIAGNOSIS, NOT_DIAGNOSED, quoted_lifts
from nearlift.stages.fit import FIT, RESULTS

#: Half of a 90 and of a 68 and 95 % interval of a normal, in standard deviations.
HALF_90, OTHERS = 1.6449, {68: 0.9945, 95: 1.96}


#: What every block of diagnosis.json has, of a boundary where nothing was found.
EMPTY_BLOCK: Mapping[str, Any] = {
    "base_model": "",
    "false_alarm_rate": 0.05,
    "verdict": "adequate",
    "effects": [],
    "p_value": 1.0,
    "structure": [],
    "probabilities": [],
    "rounds": [],
    "noise_floor": {
        **dict.fromkeys(("relative", "force_N", "height_m", "common", "drift"), 0.0),
        "drift_by_length": [],
        "source": "declared",
        "dof": None,
    },
    "L_inf_N": {},
    "limits": [],
    "within_trial": None,
    "untestable": [],
    "silent": [],
    "next_experiment": [],
}


#: And what stands in its parts.
EMPTY_PARTS: Mapping[str, Mapping[str, Any]] = {
    "effects": {"rivals": [], "parameters": {}},
    "structure": {"family": "", "significant": False},
    "untestable": {"needs": [], "log_next_time": []},
    "silent": {"share_visible": 0.0, "u": None, "hidden": False},
    "next_experiment": {"trials_to_separate": 0},
    "error": {"chosen_in_folds": []},
    "coefficients": {"before": {}, "after": {}, "carried": []},
    "look": {"trials": 0, "scheduled": 0, "p_value_needed": 0.0},
}
EMPTY_CANDIDATE = {
    **dict.fromkeys(("accepted", "at_bound"), False),
    **dict.fromkeys(("log_evidence", "left_in")),
    "sizes": {},
}


def diagnosis(boundaries: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """diagnosis.json with these blocks, of which a test says only what it is about."""
    blocks = {}
    for boundary, block in boundaries.items():
        whole = {**EMPTY_BLOCK, "coefficients": {}, **block}
        for key, empty in EMPTY_PARTS.items():
            if isinstance(whole.get(key), Mapping):
                whole[key] = {**empty, **whole[key]}
            elif key in whole:
                whole[key] = [{**empty, **part} for part in whole[key]]
        if whole["effects"] and "accepted" not in whole:
            whole["accepted"] = accepted(whole)
        whole["rounds"] = [
            {**r, "candidates": [{**EMPTY_CANDIDATE, **c} for c in r["candidates"]]}
            for r in whole["rounds"]
        ]
        blocks[boundary] = whole
    return {"schema": DIAGNOSIS.schema, "false_alarm_rate": 0.05, "boundaries": blocks}


def accepted(block: Mapping[str, Any]) -> dict[str, Any]:
    """The likeliest explanation of a block: its values, without correlation."""
    known = {**block["coefficients"].get("after", {})}
    for effect in block["effects"]:
        known |= effect["parameters"]
    # without an end there is no standard uncertainty
    u = {
        n: None if e["hi90"] is None else (e["hi90"] - e["lo90"]) / 2 / HALF_90
        for n, e in known.items()
    }
    ends = ("value", "lo90", "hi90")
    parameters = {n: {**{k: e[k] for k in ends}, "u": u[n]} for n, e in known.items()}
    values = [[(u[a] or 0) ** 2 if a == b else 0.0 for b in known] for a in known]
    return {
        "effects": [e["name"] for e in block["effects"]],
        "parameters": parameters,
        "covariance": {"names": [*known], "values": values},
    }


def content(fitted: Mapping[str, Any], boundaries: Mapping[str, Any]) -> dict[str, Any]:
    """`fitted` is the file that `fit` wrote, `boundaries` are blocks of diagnosis.json."""
    whole: dict[str, Any] = copy.deepcopy(dict(fitted))
    for boundary, found in boundaries.items():
        own, named = whole["boundaries"][boundary], found.get("effects", [])
        verdict = found.get("verdict", own["verdict"])
        effects = [e["name"] for e in named]
        own |= {
            "verdict": verdict,
            "effects": effects,
            "rivals": [r for e in named for r in e.get("rivals", [])],
            "reason": found.get("reason", "") if verdict == NOT_DIAGNOSED else "",
        }
        if forms := {e["name"]: e["form"] for e in named if "form" in e}:
            own["forms"] = forms
        if joint := found.get("joint"):
            own["correlation"] = {"parameters": joint["parameters"], "values": joint["correlation"]}
        if error := found.get("error"):
            rmse = {when: error[when]["held_out_rmse"] for when in ("before", "after")}
            own["error"] = {"unit": "fraction of lift", "noise_floor": error["noise_floor"], **rmse}
        blocks = found.get("coefficients", {})
        for name, e in blocks.get("after", {}).items():
            _coefficient(own["coefficients"][name], e)
            alone = f"{effects[0]} alone, exactly in its stated form" if effects else ""
            unseen = "every undetected effect at its plausible size"
            base = blocks.get("before", {}).get(name) if verdict != "adequate" else None
            doubts = {
                alone: _pair(e, "conditional") if alone else None,
                "base model without any effect": base,
                unseen: _pair(e, "constrained"),
            }
            own["coefficients"][name]["doubts"] = [
                {"if": condition, **{k: d[k] for k in ("value", "lo90", "hi90")}}
                | ({"explanation": effects[0]} if condition == alone else {})
                for condition, d in doubts.items()
                if d
            ]
    return whole


def write(job: Job, boundaries: Mapping[str, Any]) -> None:
    """The same, in place of what `fit` wrote."""
    job.write(RESULTS, content(job.read_json(RESULTS), boundaries))


def fitted(evidence: Evidence, boundary: str) -> tuple[Evidence, dict[str, Any]]:
    """The same with a fit.json of its own, and the block of the base fit in it: to be changed
    before it is read.
    """
    whole = copy.deepcopy(evidence.document(FIT))
    other = dataclasses.replace(evidence, documents={**evidence.documents, FIT.file: whole})
    return other, whole["boundaries"][boundary][whole["base"][boundary]]


def known(evidence: Evidence, told: Mapping[str, Any]) -> Evidence:
    """Evidence with this diagnosis.json, and what is then quoted."""
    blocks = diagnosis(told["boundaries"])
    quoted = content(evidence.document(RESULTS), blocks["boundaries"])
    return dataclasses.replace(
        evidence, documents={**evidence.documents, DIAGNOSIS.file: blocks, RESULTS.file: quoted}
    )


def _pair(e: Mapping[str, Any], kind: str) -> dict[str, Any] | None:
    return {"value": e["value"], "lo90": e[kind][0], "hi90": e[kind][1]} if e.get(kind) else None


def _coefficient(own: dict[str, Any], e: Mapping[str, Any]) -> None:
    own["value"] = e["value"]
    if e["lo90"] is None:
        own["dof"] = 0.0
        return
    low, high = ((e[end] - e["value"]) / HALF_90 for end in ("lo90", "hi90"))
    own |= {"u": (high - low) / 2, "dof": None, "lo90": e["lo90"], "hi90": e["hi90"]}
    for level, k in OTHERS.items():
        own |= {f"lo{level}": e["value"] + k * low, f"hi{level}": e["value"] + k * high}


def fitted_lift(job: Job, side: Boundary, number: int) -> QuotedLift:
    """The lift of one boundary of a finished job, with so many draws."""
    return quoted_lifts(job).lift(side, number)


#: diagnosis.json of an effect at the ground.
_AFTER = {
    "value": 2.0,
    "lo90": 1.8,
    "hi90": 2.2,
    "conditional": [1.9, 2.1],
    "constrained": [1.5, 2.5],
}
_GROUND = {
    "base_model": "sanchez_cuevas",
    "verdict": "effect",
    "effects": [
        {
            "name": "supply_sag",
            "rivals": ["session_gain"],
            "parameters": {"p": {"value": 2.1, "lo90": 1.9, "hi90": 2.3}},
        }
    ],
    "structure": [
        {"covariate": "supply", "p_value": 1e-90},
        {"covariate": "tilt", "p_value": 0.03, "significant": False},
    ],
    "error": {
        "unit": "fraction of lift",
        "noise_floor": 0.0041,
        "before": {"held_out_rmse": 0.0122, "lo90": 0.0117, "hi90": 0.0128},
        "after": {"held_out_rmse": 0.0043, "lo90": 0.0041, "hi90": 0.0045},
    },
    "coefficients": {
        "before": {"K_b": {"value": 1.2, "lo90": 1.1, "hi90": 1.3}},
        "after": {"K_b": _AFTER},
    },
    "rounds": [{"candidates": [], "decision": "added supply_sag", "reason": "nothing is left"}],
    "untestable": [{"effect": "air_density", "needs": ["temperature"]}],
    "silent": [{"effect": "height_scale", "absorbed_by": "alpha", "bias_at_detection_limit": 0.0}],
    "next_experiment": [
        {"separates": ["height_offset", "near_wall_saturation"], "measure": "both directions"}
    ],
}
DIAGNOSED = {"schema": "nearlift.diagnosis/1", "boundaries": {"ground": _GROUND}}
