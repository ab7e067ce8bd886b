"""The closed loop's findings, as diagnosis.json has them: what each boundary's section of the
chapter says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from nearlift.declare import BOUNDARIES, Boundary
from nearlift.products import DIAGNOSIS
from nearlift.report.chapters import loop_words
from nearlift.report.documents import brief
from nearlift.report.evidence import Evidence
from nearlift.report.findings import to_log
from nearlift.report.number import Number, Place
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.outlook import SilentEffect

#: So many lines of structure, and of silent effects, are shown.
LINES = 12


def facts(evidence: Evidence) -> dict[str, object]:
    """A section for each boundary that was diagnosed, and why the others were not."""
    rate = Place(evidence, DIAGNOSIS, ("false_alarm_rate",))
    return {
        "sections": [
            _section(evidence, b, found) for b in BOUNDARIES if (found := evidence.diagnosed(b))
        ],
        "not_diagnosed": {b: reason for b in BOUNDARIES if (reason := evidence.not_diagnosed(b))},
        "rate": None if rate.content is None else rate.percent(digits=3),
    }


def _section(evidence: Evidence, boundary: Boundary, found: BoundaryDiagnosis) -> dict[str, object]:
    place = Place(evidence, DIAGNOSIS, ("boundaries", boundary))
    tried = [c for r in found.rounds for c in r.candidates]
    structure = [
        {
            "covariate": s.covariate,
            "p": place.chance("structure", i, "p_value"),
            "significant": s.significant,
        }
        for i, s in enumerate(found.structure[:LINES])
    ]
    return {
        "boundary": boundary,
        "kind": found.verdict,
        "carried": found.coefficients.carried,
        "verdict": brief.verdict(evidence, boundary),
        "largest": loop_words.largest(place),
        "look": found.look.text if found.look else "",
        "effects": loop_words.effects(place, found),
        "not_confirmed": [" + ".join(names) for names in found.not_confirmed or ()],
        "partial": [
            {"name": p.name, "share": place.percent("partial", i, "share", digits=2)}
            for i, p in enumerate(found.partial or ())
        ],
        "structure": structure,
        "along": [s for s in structure if s["significant"]] or structure[:1],
        "error": _error(place),
        "left_out": evidence.left_out,
        "outcome": loop_words.outcome(found.error),
        "folds": loop_words.folds(place, found),
        "within": loop_words.within(place, found.within_trial),
        "candidates": loop_words.candidates(place, found),
        "nearly_all": next(
            (r.reason for r in found.rounds if r.reason.startswith("accounts for")), ""
        ),
        "by_visits": any(c.judged_by for c in tried),
        "rounds": found.rounds,
        "limits": [
            *(s.text for s in found.shifts if s.text is not None),
            *(limit.text for limit in found.limits),
        ],
        "sensitivity": found.sensitivity,
        "could_have_seen": str(found.sensitivity or ""),
        "untestable": found.not_testable,
        "log": to_log(found),
        "silent": _silent(place, found.silent),
        "next_experiment": loop_words.proposals(place, found.next_experiment),
    }


def _silent(place: Place, effects: Sequence[SilentEffect]) -> list[dict[str, object]]:
    place = place.at("silent")
    return [
        {
            "effect": s.effect,
            "absorbed_by": s.absorbed_by,
            "bias": place.number(i, "bias_at_detection_limit", digits=2),
            "coefficient": s.in_units_of.removeprefix("u(").removesuffix(")"),
            "u": place.number(i, "u", digits=2) if math.isfinite(s.u) else None,
            "hidden": s.hidden,
        }
        for i, s in enumerate(effects[:LINES])
    ]


def _error(place: Place) -> dict[str, Number] | None:
    """Held-out errors in percent of lift, before and after, beside the noise floor."""
    place = place.at("error")
    if place.content is None:
        return None

    def percent(*keys: str) -> Number:
        return place.percent(*keys, digits=3, how="in percent of lift")

    keys = [
        (when, key) for when in ("before", "after") for key in ("held_out_rmse", "lo90", "hi90")
    ]
    cited = {"floor": percent("noise_floor")} | {
        f"{when}_{key}": percent(when, key) for when, key in keys
    }
    if place.at("change", "lo90").content is not None:
        cited |= {
            f"change_{k}": place.percent("change", k, digits=2) for k in ("value", "lo90", "hi90")
        }
    return cited
