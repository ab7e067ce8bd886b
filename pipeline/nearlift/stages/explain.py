"""`diagnose --explain NAME`: one effect in one campaign, from its mechanism to what this design
could see of it.

Not a stage: it makes no product and stales none. It reads trials.parquet, and diagnosis.json where
there is one, and writes ``reports/<campaign>/explain/NAME.*``.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.declare import Effect
from nearlift.errors import InputRefused, NotConverged
from nearlift.likelihood import budget
from nearlift.likelihood.noise import floor
from nearlift.loop import coefficients
from nearlift.loop.diagnose import set_up
from nearlift.loop.few_visits import applies
from nearlift.loop.foresight import DRAWS, Foresight
from nearlift.loop.handle import LIMIT_POWER, Handle, handles
from nearlift.loop.search_problem import SearchProblem
from nearlift.loop.visibility import SILENT, visibility
from nearlift.loop.within_trial import power as heating_power
from nearlift.products import TRIALS
from nearlift.report.evidence import Columns, stack
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.outlook import UntestableEffect
from nearlift.run.job import Job
from nearlift.stages.diagnose import chosen, diagnosed
from nearlift.stages.fit import choice
from nearlift.stages.observe import boundaries, observe
from nearlift.stages.report import for_print


def run(job: Job, name: str) -> dict[str, object]:
    """Explain the effect of that name at every boundary of the campaign; writes the figure, and
    returns what the console shows.

    Raises
    ------
    UsageError
        There is no such effect.
    InputRefused
        No boundary of the campaign could be looked at, with the reasons.
    """
    effect = catalogue.effect(name)
    trials = job.read(TRIALS)
    parts = budget.components(job.campaign)
    options = chosen(job)
    loop = diagnosed(job.processed)
    explained: dict[str, object] = {}
    pictures: list[Columns] = []
    refused = []
    present = boundaries(trials)
    for i, boundary in enumerate(present):
        job.say(f"explain {name}: {boundary}", i / len(present))
        base, _ = choice(job.campaign, boundary)
        try:
            stage, library, untestable = set_up(
                observe(trials, job.campaign, boundary), base, parts, options
            )
        except NotConverged as fault:
            refused.append(f"{boundary}: {fault.what}; {fault.remedy}")
            continue
        if boundary in loop:
            # beside a large effect the noise is known only after the loop
            stage = dataclasses.replace(stage, noise=loop[boundary].noise)
        explained[boundary], rows = _at(stage, effect, library, untestable, loop.get(boundary))
        pictures += rows
    if not explained:
        raise InputRefused(
            job.campaign.name,
            "; ".join(refused) or "no trial was accepted",
            "an explanation needs what a diagnosis needs",
        )
    answer = {
        **_words(effect),
        "campaign": job.campaign.name,
        "boundaries": explained,
        "notes": refused,
        "files": [],
    }
    if pictures:
        # whoever asks for what cannot be told waits for no picture
        from nearlift.report.figures import explain as picture

        files = for_print(picture.draw, stack(pictures), job.campaign.report.style)
        answer["files"] = [
            str(job.publish(f"explain/{name}.{kind}", data)) for kind, data in files.items()
        ]
    return answer


def _words(effect: Effect) -> dict[str, object]:
    """What the declaration says."""
    source = effect.source
    return {
        "effect": effect.name,
        "title": effect.title,
        "mechanism": effect.mechanism,
        "notes_of_declaration": effect.notes,
        "formula": effect.formula,
        "acts_on": effect.acts_on + (", additive" if effect.additive else ""),
        "varies_with": effect.varies_with,
        "source": {
            "citation": source.citation,
            "equation": source.equation,
            "doi": source.doi,
            "doubts": list(source.doubts),
        },
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "null": p.value,
                "bounds": list(p.bounds),
                "expected": str(p.prior),
                "meaning": p.meaning,
                "per": p.per,
            }
            for p in effect.parameters
        ],
        "log": list(effect.log_next_time),
    }


def _at(
    stage: SearchProblem,
    effect: Effect,
    library: tuple[Effect, ...],
    untestable: tuple[UntestableEffect, ...],
    loop: BoundaryDiagnosis | None,
) -> tuple[dict[str, object], list[Columns]]:
    """One boundary: numbers, and the rows of the figure."""
    for lacking in untestable:
        if lacking.effect == effect.name:
            needs = {"needs": lacking.needs, "log_next_time": lacking.log_next_time}
            return {"testable": False, **needs}, []
    if effect.name not in {e.name for e in library}:
        reason = "it does not occur at this boundary, or the base model holds it already"
        return {"testable": False, "needs": [], "log_next_time": [], "reason": reason}, []
    common: dict[str, object] = {
        "testable": True,
        "base_model": stage.base.name,
        "trials": stage.data.n,
        "false_alarm_rate": stage.options.false_alarm_rate,
        "draws": DRAWS,
        "few_visits": applies(stage.data),
        "noise": stage.noise.record(),
        "in_this_campaign": _verdict(effect.name, loop),
    }
    if effect.within_trial:
        return common | {
            "within_trial": heating_power(stage.data, stage.options.false_alarm_rate, LIMIT_POWER)
        }, []
    foresight = Foresight(stage=stage)
    sizes, rows = [], []
    for handle in handles(effect):
        size, table = _size(foresight, handle)
        sizes.append(size)
        rows.append(table)
    return common | {"share_visible": visibility(stage, effect), "sizes": sizes}, rows


def _size(foresight: Foresight, handle: Handle) -> tuple[dict[str, object], Columns]:
    """One of the effect's sizes: power, limit, confusions, harm; and what the figure draws."""
    from nearlift.report.figures.explain import rows

    stage = foresight.stage
    silent = visibility(stage, handle.effect) <= SILENT
    power = None if silent else foresight.power(handle)
    limit = power.limit() if power else None
    shown = min(handle.plausible, handle.largest) if limit is None else limit
    raw, left = foresight.signature(handle, shown)
    contest = None if silent else foresight.contest(handle, shown)
    absorbed = {} if silent else foresight.absorbed(handle)
    value, u = coefficients.spread(stage, stage.base_fit)
    shift = foresight.harm(handle, shown)
    confused: list[dict[str, Any]] = [
        {
            "effect": n,
            "energy_absorbed": a,
            "correlation": float(np.sqrt(a)),
            "rival_chance": contest.rivals.get(n, 0.0) if contest else 0.0,
        }
        for n, a in absorbed.items()
    ]
    confused.sort(key=lambda c: (-c["rival_chance"], -c["energy_absorbed"]))
    size = {
        "parameter": handle.parameter.name,
        "unit": handle.parameter.unit,
        "meaning": handle.parameter.meaning,
        "per": handle.parameter.per,
        "shape": dict(handle.shape),
        "plausible_size": handle.plausible,
        "largest_size": handle.largest,
        "detection_limit": limit,
        "limit_within_set": power.limit("within") if power else None,
        "limit_named_alone": power.limit("alone") if power else None,
        "shown_size": shown,
        "signature": {
            "rms": _rms(raw),
            "rms_left": _rms(left),
            "largest_left": float(np.abs(left).max()),
        },
        "power": {
            k: getattr(power, k).tolist() for k in ("size", "seen", "within", "first", "alone")
        }
        if power
        else None,
        "confused_with": confused,
        "bias": {
            p.name: {"value": float(v), "shift": float(d), "in_u": float(d / s) if s > 0 else 0.0}
            for p, v, d, s in zip(stage.base.parameters, value, shift, u, strict=True)
        },
    }
    noise, chance = floor(stage.data, stage.noise, stage.slope), stage.options.false_alarm_rate
    data = stage.data
    return size, rows(data, handle.effect, data.boundary, size, raw, left, noise, chance)


def _rms(x: Any) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def _verdict(name: str, loop: BoundaryDiagnosis | None) -> dict[str, object] | None:
    """What the loop made of the effect in this campaign; None where it has not run."""
    if loop is None:
        return None
    named = next((e for e in loop.effects if e.name == name), None)
    tried = next((c for r in loop.rounds for c in r.candidates if c.name == name), None)
    return {
        "verdict": loop.verdict,
        "named": named is not None,
        "parameters": named.parameters if named else None,
        "rivals": named.rivals if named else (),
        "rival_of": [e.name for e in loop.effects if name in e.rivals],
        "tried": {k: getattr(tried, k) for k in ("gain", "p_value", "accepted", "left_in")}
        if tried
        else None,
    }
