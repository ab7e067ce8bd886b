"""The loop in words: what the chapter's sentences are filled with, each number with its source."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from nearlift import catalogue
from nearlift.declare import Effect
from nearlift.report.findings import ranked
from nearlift.report.number import Number, Place, Quoted
from nearlift.results.diagnosis import BoundaryDiagnosis, LoopError, WithinTrial
from nearlift.results.outlook import NextExperiment, NextSession
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


def effects(place: Place, diagnosis: BoundaryDiagnosis) -> list[dict[str, object]]:
    """The named effects with mechanism, parameters and rivals."""
    known = {e.name: e for e in catalogue.effects()}
    listed: list[dict[str, object]] = []
    for i, effect in enumerate(diagnosis.effects):
        sizes = (
            {p.name for p in known[effect.name].parameters if not p.grid}
            if effect.name in known
            else set()
        )
        quoted = [
            _marked(place.quote("effects", i, "parameters", name), known.get(effect.name))
            for name in effect.parameters
        ]
        others = diagnosis.stand_ins(effect)
        ends = sorted(quoted, key=lambda q: q.value.value)
        listed.append(
            {
                "name": effect.name,
                "mechanism": effect.mechanism,
                "rivals": [o for o in others if " + " not in o],
                "together": [o for o in others if " + " in o],
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


def _marked(quoted: Quoted, effect: Effect | None) -> Quoted:
    """With the mark of a parameter that the fit left at an end of its allowed range."""
    for p in effect.parameters if effect is not None else ():
        low, high = p.bounds
        if p.name == quoted.name.partition("[")[0] and min(
            quoted.value.value - low, high - quoted.value.value
        ) < AT_BOUND * (high - low):
            return dataclasses.replace(quoted, at_bound=True)
    return quoted


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
    word = "falls" if high < 0 else "rises" if low > 0 else "same"
    return {
        "word": word,
        "at_floor": known and after.lo90 <= error.noise_floor,
        "lower": after.held_out_rmse < before.held_out_rmse,
    }


def folds(place: Place, diagnosis: BoundaryDiagnosis) -> dict[str, Number] | None:
    """In how many folds the search, repeated without the visits held out, came to the
    same answer.
    """
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


def within(place: Place, change: WithinTrial | None) -> dict[str, object] | None:
    """The change of lift over a record, in percent."""
    if change is None:
        return None
    place = place.at("within_trial")
    return {
        k: place.percent("change_over_record", k, digits=2, how="in percent of lift")
        for k in ("value", "lo90", "hi90")
    } | {
        "p": place.chance("p_value"),
        "significant": change.significant,
        "candidates": change.candidates,
    }


def candidates(place: Place, diagnosis: BoundaryDiagnosis) -> list[dict[str, object]]:
    """Every candidate with its gain, how far its evidence lies behind, and why not."""
    rows = []
    for c in ranked(diagnosis):
        i, j = c.place
        at = place.at("rounds", i, "candidates", j)
        behind = Number(
            text=plain(c.behind, 3),
            value=c.behind,
            source=at.source("log_evidence"),
            how="less that of the best, times −2",
        )
        rows.append(
            {
                "name": c.tried.name,
                "gain": at.number("gain", places=1),
                "behind": behind,
                "accepted": c.tried.accepted,
                "left_in": c.tried.left_in,
            }
        )
    return rows


def proposals(place: Place, experiments: Sequence[NextExperiment]) -> list[dict[str, object]]:
    """What to measure next, with the trials it takes and the evidence expected of them."""
    listed: list[dict[str, object]] = []
    for i, n in enumerate(experiments):
        at = place.at("next_experiment", i)
        digits = {"trials": 6, "expected_evidence": 2}
        known = {
            k: at.number(k, digits=d) if getattr(n, k, None) else None for k, d in digits.items()
        }
        others = [
            {
                "measure": a.measure,
                "gain": at.number("alternatives", j, "expected_evidence", digits=2),
            }
            for j, a in enumerate(n.alternatives if isinstance(n, NextSession) else ())
        ]
        listed.append(
            {
                "measure": n.measure,
                "separates": n.separates,
                "others": others,
                **known,
            }
        )
    return listed
