"""Findings of the closed loop: the facts of each boundary's section."""

from __future__ import annotations

import dataclasses
import math

from nearlift import catalogue
from nearlift.declare import BOUNDARIES, Boundary, Effect
from nearlift.report import sources, words
from nearlift.report.evidence import Evidence
from nearlift.report.findings import RankedCandidate, ranked
from nearlift.report.number import Number, Place, Quoted
from nearlift.results.diagnosis import BoundaryDiagnosis, LoopError
from nearlift.rounding import plain
from nearlift.stages.diagnose import DIAGNOSIS
from nearlift.stages.fit import RESULTS

#: So many lines of structure, and of silent effects, are shown.
LINES = 12
#: More parameters than this (a gain for every session) are shown by their range.
PARAMETERS = 3
#: Nearer to a bound than this part of the allowed range, a parameter is at it.
AT_BOUND = 1e-6


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
    structure = [
        (s, place.chance("structure", i, "p_value"))
        for i, s in enumerate(diagnosis.structure[:LINES])
    ]
    return {
        "boundary": boundary,
        "place": place,
        "diagnosis": diagnosis,
        "verdict": words.verdict(evidence, boundary),
        "effects": _effects(evidence, boundary, place, diagnosis),
        "not_confirmed": [" + ".join(names) for names in diagnosis.not_confirmed or ()],
        "structure": structure,
        "along": [(s, p) for s, p in structure if s.significant] or structure[:1],
        "left_out": evidence.left_out,
        "outcome": outcome(diagnosis.error),
        "folds": _folds(place, diagnosis),
        "candidates": [_candidate(place, c) for c in ranked(diagnosis)],
        "nearly_all": next(
            (r.reason for r in diagnosis.rounds if r.reason.startswith("accounts for")), ""
        ),
        "by_visits": any(c.judged_by for r in diagnosis.rounds for c in r.candidates),
        "limits": [
            *(s.text for s in diagnosis.shifts if s.text is not None),
            *(limit.text for limit in diagnosis.limits),
        ],
        "log": words.to_log(diagnosis),
        "silent": [
            (s, place.at("silent", i))
            for i, s in enumerate(diagnosis.silent[:LINES])
            if not sources.is_the_coefficient(s)
        ],
    }


def _effects(
    evidence: Evidence, boundary: Boundary, place: Place, diagnosis: BoundaryDiagnosis
) -> list[dict[str, object]]:
    """Identified effects with parameters and rivals; a size as results.json quotes it."""
    known = {e.name: e for e in catalogue.effects()}
    here = Place(evidence, RESULTS, ("boundaries", boundary, "sizes"))
    quotes = {
        (s.effect, s.parameter): here.quote(i, name=s.parameter)
        for i, s in enumerate(evidence.quoted(boundary).sizes)
    }
    listed: list[dict[str, object]] = []
    for i, effect in enumerate(diagnosis.effects):
        declared = known.get(effect.name)
        sizes = {p.name for p in declared.parameters if not p.grid} if declared else set()
        quoted = [
            _marked(
                place.quote("effects", i, "parameters", name),
                declared,
                quotes.get((effect.name, name)),
            )
            for name in effect.parameters
        ]
        others = diagnosis.stand_ins(effect)
        listed.append(
            {
                "effect": effect,
                "rivals": [o for o in others if " + " not in o],
                "together": [o for o in others if " + " in o],
                "parameters": quoted if len(quoted) <= PARAMETERS else [],
                "many": quoted if len(quoted) > PARAMETERS else [],
                "ends": sorted(quoted, key=lambda q: q.value.value),
                # that a length or an exponent is at an end is no wonder; a size there is
                # implausible
                "at_bound": any(q.at_bound and q.name.partition("[")[0] in sizes for q in quoted),
            }
        )
    return listed


def _marked(quoted: Quoted, effect: Effect | None, size: Quoted | None) -> Quoted:
    """The size if there is one, else the parameter; marked where the fit ended at a bound."""
    for p in effect.parameters if effect is not None else ():
        low, high = p.bounds
        if p.name == quoted.name.partition("[")[0] and min(
            quoted.value.value - low, high - quoted.value.value
        ) < AT_BOUND * (high - low):
            return dataclasses.replace(size or quoted, at_bound=True)
    return size or quoted


def outcome(error: LoopError | None) -> dict[str, object]:
    """How the held-out error moved: `falls`, `rises`, or `same` where the interval of its change,
    visits in pairs, holds none.

    Without a change on record the two errors' own intervals decide, `same` where they overlap. Also
    whether the floor is met.
    """
    if not error:
        return {}
    before, after = error.before, error.after
    known = all(math.isfinite(x) for e in (before, after) for x in (e.lo90, e.hi90))
    low, high = (error.change.lo90, error.change.hi90) if error.change else (math.nan, math.nan)
    if not (math.isfinite(low) and math.isfinite(high)):
        low, high = (after.lo90 - before.hi90, after.hi90 - before.lo90) if known else (-1.0, 1.0)
    return {
        "word": "falls" if high < 0 else "rises" if low > 0 else "same",
        "at_floor": known and after.lo90 <= error.noise_floor,
        "lower": after.held_out_rmse < before.held_out_rmse,
    }


def _folds(place: Place, diagnosis: BoundaryDiagnosis) -> dict[str, Number] | None:
    """How many folds, searched without the visits held out, came to the same answer."""
    chosen = diagnosis.error.chosen_in_folds if diagnosis.error else ()
    if not chosen or diagnosis.verdict != "effect":
        return None
    named = {e.name for e in diagnosis.effects}
    same = sum({part.strip() for part in c.split("+")} == named for c in chosen)
    source = place.source("error", "chosen_in_folds")
    return {
        "same": Number(
            text=str(same), value=float(same), source=source, how="count of the same answer"
        ),
        "all": Number(text=str(len(chosen)), value=float(len(chosen)), source=source, how="count"),
    }


def _candidate(place: Place, candidate: RankedCandidate) -> dict[str, object]:
    """A candidate with how far its evidence lies behind."""
    i, j = candidate.place
    at = place.at("rounds", i, "candidates", j)
    behind = Number(
        text=plain(candidate.behind, 3),
        value=candidate.behind,
        source=at.source("log_evidence"),
        how="less that of the best, times −2",
    )
    return {"tried": candidate.tried, "place": at, "behind": behind}
