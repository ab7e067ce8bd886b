"""The loop in words: what the chapter's sentences are filled with, each number with its source."""

from __future__ import annotations

import dataclasses
from typing import Any

from nearlift import catalogue
from nearlift.report.findings import stand_ins, tried
from nearlift.report.number import Number, Place, Quoted
from nearlift.rounding import plain

#: Chances below this are not told in percent.
RARE = 1e-3
#: More parameters than this (a gain for every session) are told by their range.
PARAMETERS = 3
#: Nearer to a bound than this part of the allowed range, a parameter is at it.
AT_BOUND = 1e-6


def largest(place: Place) -> dict[str, object] | None:
    """The chance of so large a largest test under the null, in percent, or as it is where it is
    `rare`.
    """
    p = place.content.get("p_value")
    if p is None:
        return None
    rare = p < RARE
    return {
        "p": place.chance("p_value") if rare else place.percent("p_value", digits=2),
        "rare": rare,
    }


def effects(place: Place) -> list[dict[str, object]]:
    """The named effects with mechanism, parameters and rivals."""
    known, found = {e.name: e for e in catalogue.effects()}, place.content
    listed = []
    for i, effect in enumerate(found.get("effects", [])):
        sizes = (
            {p.name for p in known[effect["name"]].parameters if not p.grid}
            if effect["name"] in known
            else set()
        )
        quoted = [
            _marked(place.quote("effects", i, "parameters", name), known.get(effect["name"]))
            for name in effect.get("parameters", {})
        ]
        ends = sorted(quoted, key=lambda q: q.value.value)
        listed.append(
            {
                "name": effect["name"],
                "mechanism": effect.get("mechanism", ""),
                "rivals": [o for o in stand_ins(found, effect) if " + " not in o],
                "together": [o for o in stand_ins(found, effect) if " + " in o],
                "parameters": quoted if len(quoted) <= PARAMETERS else [],
                "many": (
                    {"number": len(quoted), "least": ends[0], "most": ends[-1], "all": quoted}
                    if len(quoted) > PARAMETERS
                    else None
                ),
                # that a length or an exponent is at an end is no wonder; a size there is
                # implausible
                "at_bound": any(q.at_bound and q.name.partition("[")[0] in sizes for q in quoted),
            }
        )
    return listed


def _marked(quoted: Quoted, effect: Any) -> Quoted:
    """With the mark of a parameter that the fit left at an end of its allowed range."""
    for p in effect.parameters if effect is not None else ():
        low, high = p.bounds
        if p.name == quoted.name.partition("[")[0] and min(
            quoted.value.value - low, high - quoted.value.value
        ) < AT_BOUND * (high - low):
            return dataclasses.replace(quoted, at_bound=True)
    return quoted


def outcome(error: dict[str, Any] | None) -> dict[str, object]:
    """How the held-out error moved: `falls`, `rises`, or `same` where the interval of its change,
    visits in pairs, holds none.

    Without a change on record the two errors' own intervals decide, `same` where they overlap. Also
    whether the floor is met.
    """
    if not error:
        return {}
    before, after = error["before"], error["after"]
    known = all(e[k] is not None for e in (before, after) for k in ("lo90", "hi90"))
    low, high = (error.get("change", {}).get(k) for k in ("lo90", "hi90"))
    if low is None or high is None:
        low, high = (
            (after["lo90"] - before["hi90"], after["hi90"] - before["lo90"])
            if known
            else (-1.0, 1.0)
        )
    word = "falls" if high < 0 else "rises" if low > 0 else "same"
    return {
        "word": word,
        "at_floor": known and after["lo90"] <= error["noise_floor"],
        "lower": after["held_out_rmse"] < before["held_out_rmse"],
    }


def folds(place: Place) -> dict[str, Number] | None:
    """In how many folds the search, repeated without the visits held out, came to the
    same answer.
    """
    found = place.content
    chosen = found.get("error", {}).get("chosen_in_folds")
    if not chosen or found["verdict"] != "effect":
        return None
    own = {e["name"] for e in found.get("effects", [])}
    same = sum({part.strip() for part in c.split("+")} == own for c in chosen)
    source = place.source("error", "chosen_in_folds")
    return {
        "same": Number(
            text=str(same), value=float(same), source=source, how="count of the same answer"
        ),
        "all": Number(text=str(len(chosen)), value=float(len(chosen)), source=source, how="count"),
    }


def within(place: Place) -> dict[str, object] | None:
    """The change of lift over a record, in percent."""
    place = place.at("within_trial")
    if not (own := place.content):
        return None
    return {
        k: place.percent("change_over_record", k, digits=2, how="in percent of lift")
        for k in ("value", "lo90", "hi90")
    } | {
        "p": place.chance("p_value"),
        "significant": own["significant"],
        "candidates": own.get("candidates", []),
    }


def candidates(place: Place) -> list[dict[str, object]]:
    """Every candidate with its gain, how far its evidence lies behind, and why not."""
    places = {
        c["name"]: place.at("rounds", i, "candidates", j)
        for i, r in enumerate(place.content.get("rounds", []))
        for j, c in enumerate(r.get("candidates", []))
    }
    rows = []
    for c in tried(place.content):
        own = places[c["name"]]
        behind = Number(
            text=plain(c["behind"], 3),
            value=float(c["behind"]),
            source=own.source("log_evidence"),
            how="less that of the best, times −2",
        )
        rows.append(
            {
                "name": c["name"],
                "gain": own.number("gain", places=1),
                "behind": behind,
                "accepted": c.get("accepted"),
                "left_in": c.get("left_in"),
            }
        )
    return rows


def proposals(place: Place) -> list[dict[str, object]]:
    """What to measure next, with the trials it takes and the evidence expected of them."""
    listed = []
    for i, n in enumerate(place.content.get("next_experiment", [])):
        own = place.at("next_experiment", i)
        digits = {"trials": 6, "expected_evidence": 2}
        known = {k: own.number(k, digits=d) if n.get(k) else None for k, d in digits.items()}
        others = [
            {
                "measure": a["measure"],
                "gain": own.number("alternatives", j, "expected_evidence", digits=2),
            }
            for j, a in enumerate(n.get("alternatives", []))
        ]
        listed.append(
            {
                "measure": n["measure"],
                "separates": n.get("separates", []),
                "others": others,
                **known,
            }
        )
    return listed
