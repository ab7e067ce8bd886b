"""Every trial from raw byte to figure, and what each exclusion is worth."""

from __future__ import annotations

from typing import Any

from nearlift.products import QUALITY
from nearlift.reduction.quality import code
from nearlift.report.evidence import Evidence
from nearlift.report.number import Number, Place, pointer
from nearlift.rounding import plain
from nearlift.run.lock import size

#: Trials that the page lists; all of them stand in quality.json.
MOST_ROWS = 5000
NAMES = {"none": "free air"}


def facts(evidence: Evidence) -> dict[str, object]:
    """How much went in and came out at each step, the coefficient with exclusions put back, and a
    row for every trial.
    """
    content = evidence.document(QUALITY)
    files = content["files"]
    bytes_read = Number(
        text=size(files["bytes"]),
        value=float(files["bytes"]),
        source=pointer(QUALITY, "files", "bytes"),
    )
    return {
        "bytes": bytes_read,
        "files": _whole(evidence, "files", "number"),
        "read": _whole(evidence, "samples", "read")
        if content["samples"]["read"] is not None
        else None,
        "averaged": _whole(evidence, "samples", "averaged"),
        "counts": {name: _whole(evidence, "counts", name) for name in content["counts"]},
        "back": [
            _back(evidence, boundary, entry) for boundary, entry in content["put_back"].items()
        ],
        "trials": [_row(entry) for entry in content["trials"][:MOST_ROWS]],
        "further": max(len(content["trials"]) - MOST_ROWS, 0),
    }


def _whole(evidence: Evidence, *place: str) -> Number:
    return Place(evidence, QUALITY, place).number(places=0)


def _back(evidence: Evidence, boundary: str, entry: dict[str, Any]) -> dict[str, object]:
    """One boundary's table: by how much the base fit's coefficient changes with exclusions put
    back.
    """
    place = Place(evidence, QUALITY, ("put_back", boundary))
    rows = []
    if entry["all"]:
        rows.append(
            {
                "what": "all that can be",
                "code": False,
                **_change(entry["all"], place.at("all")),
            }
        )
    for name, found in entry["codes"].items():
        rows.append(
            {
                "what": name,
                "code": True,
                "meaning": code(name).meaning,
                **_change(found, place.at("codes", name)),
            }
        )
    for i, without in enumerate(entry["left_out"]):
        rows.append(
            {
                "what": f"{without['what']} left out",
                "code": False,
                **_change(without, place.at("left_out", i)),
            }
        )
    single = [
        {"what": name, "code": False, **_change(found, place.at("trials", name))}
        for name, found in entry["trials"].items()
    ]
    head, _, sub = entry["parameter"].partition("_")
    return {
        "boundary": boundary,
        "excluded": place.number("excluded", places=0),
        "head": {"alpha": "\u03b1", "lambda": "\u03bb"}.get(head, head),
        "sub": sub,
        "rows": rows,
        "single": single,
        "never": list(entry["cannot_be_put_back"].items()),
    }


def _change(found: dict[str, object], place: Place) -> dict[str, object]:
    if found["value"] is None:
        return {
            "trials": place.number("trials", places=0),
            "why_not": found["why_not"],
        }
    return {
        "trials": place.number("trials", places=0),
        "change": place.number("change", digits=2),
        "change_in_u": place.number("change_in_u", digits=2),
        "why_not": "",
    }


def _row(entry: dict[str, Any]) -> dict[str, object]:
    """One trial as printed."""
    lift = entry["lift_N"]
    return {
        "trial": entry["trial"],
        "boundary": NAMES.get(entry["boundary"], entry["boundary"]),
        "source": entry["source"],
        "sha": entry["sha256"][:8],
        "completeness": entry["completeness"],
        "samples": entry["samples"],
        "averaged": entry["averaged"],
        "lift": "\u2013" if lift is None else plain(1e3 * lift, 5),
        "codes": " ".join(entry["codes"]),
        "figures": ", ".join(
            {"fig2": "Figure 2", "residuals": "residuals"}[name] for name in entry["figures"]
        )
        or "none",
    }
