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
            _section(evidence, b, diagnosis)
            for b in BOUNDARIES
            if (diagnosis := evidence.diagnosed(b))
        ],
        "not_diagnosed": {b: reason for b in BOUNDARIES if (reason := evidence.not_diagnosed(b))},
        "rate": None if rate.content is None else rate.percent(digits=3),
    }


def _section(
    evidence: Evidence, boundary: Boundary, diagnosis: BoundaryDiagnosis
) -> dict[str, object]:
    place = Place(evidence, DIAGNOSIS, ("boundaries", boundary))
    tried = [c for r in diagnosis.rounds for c in r.candidates]
    structure = [
        {
            "covariate": s.covariate,
            "p": place.chance("structure", i, "p_value"),
            "significant": s.significant,
        }
        for i, s in enumerate(diagnosis.structure[:LINES])
    ]
    return {
        "boundary": boundary,
        "kind": diagnosis.verdict,
        "carried": diagnosis.coefficients.carried,
        "verdict": brief.verdict(evidence, boundary),
        "largest": loop_words.largest(place),
        "look": diagnosis.look.text if diagnosis.look else "",
        "effects": loop_words.effects(place, diagnosis),
        "not_confirmed": [" + ".join(names) for names in diagnosis.not_confirmed or ()],
        "partial": [
            {"name": p.name, "share": place.percent("partial", i, "share", digits=2)}
            for i, p in enumerate(diagnosis.partial or ())
        ],
        "structure": structure,
        "along": [s for s in structure if s["significant"]] or structure[:1],
        "error": _error(place),
        "left_out": evidence.left_out,
        "outcome": loop_words.outcome(diagnosis.error),
        "folds": loop_words.folds(place, diagnosis),
        "within": loop_words.within(place, diagnosis.within_trial),
        "candidates": loop_words.candidates(place, diagnosis),
        "nearly_all": next(
            (r.reason for r in diagnosis.rounds if r.reason.startswith("accounts for")), ""
        ),
        "by_visits": any(c.judged_by for c in tried),
        "rounds": diagnosis.rounds,
        "limits": [
            *(s.text for s in diagnosis.shifts if s.text is not None),
            *(limit.text for limit in diagnosis.limits),
        ],
        "sensitivity": diagnosis.sensitivity,
        "could_have_seen": str(diagnosis.sensitivity or ""),
        "untestable": diagnosis.not_testable,
        "log": to_log(diagnosis),
        "silent": _silent(place, diagnosis.silent),
        "next_experiment": loop_words.proposals(place, diagnosis.next_experiment),
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
