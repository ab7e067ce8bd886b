"""`diagnose --explain NAME`: one effect in one campaign, from its mechanism to what this design
could see of it.

Not a stage: it makes no product and stales none. It reads trials.parquet, and diagnosis.json where
there is one, and writes ``reports/<campaign>/explain/NAME.*``.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from nearlift import catalogue
from nearlift.declare import Boundary, Effect, FloatArray
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
from nearlift.report.evidence import Columns, stack
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.explanation import (
    Confusion,
    EffectAccount,
    EffectAtBoundary,
    EffectBetweenTrials,
    EffectParameter,
    EffectSize,
    EffectSource,
    EffectTrial,
    EffectVerdict,
    EffectWithinTrial,
    NoCandidate,
    Signature,
    UnnoticedShift,
)
from nearlift.results.outlook import UntestableEffect
from nearlift.run.engine import Job
from nearlift.stages.choices import choice, diagnosed, search_options
from nearlift.stages.gathering import for_print
from nearlift.stages.ingest import TRIALS
from nearlift.stages.observe import boundaries, observe


def run(job: Job, name: str) -> EffectAccount:
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
    options = search_options(job.campaign, job.seed)
    loop = diagnosed(job.processed)
    explained: dict[Boundary, EffectAtBoundary] = {}
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
    files: dict[str, bytes] = {}
    if pictures:
        # whoever asks for what cannot be told waits for no picture
        from nearlift.report.figures import explain as picture

        files = for_print(picture.draw, stack(pictures), job.campaign)
    return EffectAccount(
        effect=effect.name,
        title=effect.title,
        mechanism=effect.mechanism,
        notes_of_declaration=effect.notes,
        formula=effect.formula,
        acts_on=effect.acts_on + (", additive" if effect.additive else ""),
        varies_with=effect.varies_with,
        source=EffectSource(
            citation=effect.source.citation,
            equation=effect.source.equation,
            doi=effect.source.doi,
            doubts=effect.source.doubts,
        ),
        parameters=tuple(
            EffectParameter(
                name=p.name,
                unit=p.unit,
                null=p.value,
                bounds=p.bounds,
                expected=str(p.prior),
                meaning=p.meaning,
                per=p.per,
            )
            for p in effect.parameters
        ),
        log=effect.log_next_time,
        campaign=job.campaign.name,
        boundaries=explained,
        notes=tuple(refused),
        files=tuple(str(job.publish(f"explain/{name}.{k}", data)) for k, data in files.items()),
    )


def _at(
    stage: SearchProblem,
    effect: Effect,
    library: tuple[Effect, ...],
    untestable: tuple[UntestableEffect, ...],
    loop: BoundaryDiagnosis | None,
) -> tuple[EffectAtBoundary, list[Columns]]:
    """One boundary: numbers, and the rows of the figure."""
    for lacking in untestable:
        if lacking.effect == effect.name:
            return NoCandidate(needs=lacking.needs, log_next_time=lacking.log_next_time), []
    if effect.name not in {e.name for e in library}:
        reason = "it does not occur at this boundary, or the base model holds it already"
        return NoCandidate(needs=(), log_next_time=(), reason=reason), []
    verdict, rate = _verdict(effect.name, loop), stage.options.false_alarm_rate
    if effect.within_trial:
        return EffectWithinTrial(
            base_model=stage.base.name,
            trials=stage.data.n,
            false_alarm_rate=rate,
            draws=DRAWS,
            few_visits=applies(stage.data),
            noise=stage.noise,
            in_this_campaign=verdict,
            within_trial=heating_power(stage.data, rate, LIMIT_POWER),
        ), []
    foresight = Foresight(stage=stage)
    sizes = [_size(foresight, handle) for handle in handles(effect)]
    return EffectBetweenTrials(
        base_model=stage.base.name,
        trials=stage.data.n,
        false_alarm_rate=rate,
        draws=DRAWS,
        few_visits=applies(stage.data),
        noise=stage.noise,
        in_this_campaign=verdict,
        share_visible=visibility(stage, effect),
        sizes=tuple(size for size, _ in sizes),
    ), [rows for _, rows in sizes]


def _size(foresight: Foresight, handle: Handle) -> tuple[EffectSize, Columns]:
    """One of the effect's sizes: power, limit, confusions, harm; and what the figure draws."""
    from nearlift.report.figures.explain import rows

    stage, data = foresight.stage, foresight.stage.data
    silent = visibility(stage, handle.effect) <= SILENT
    power = None if silent else foresight.power(handle)
    limit = power.limit(LIMIT_POWER) if power else None
    shown = min(handle.plausible, handle.largest) if limit is None else limit
    raw, left = foresight.signature(handle, shown)
    contest = None if silent else foresight.contest(handle, shown)
    absorbed = {} if silent else foresight.absorbed(handle)
    value, u = coefficients.spread(stage, stage.base_fit)
    shift = foresight.harm(handle, shown)
    confused = [
        Confusion(
            effect=n,
            energy_absorbed=a,
            correlation=float(np.sqrt(a)),
            rival_chance=contest.rivals.get(n, 0.0) if contest else 0.0,
        )
        for n, a in absorbed.items()
    ]
    size = EffectSize(
        parameter=handle.parameter.name,
        unit=handle.parameter.unit,
        meaning=handle.parameter.meaning,
        per=handle.parameter.per,
        shape=handle.shape,
        plausible_size=handle.plausible,
        largest_size=handle.largest,
        detection_limit=limit,
        limit_within_set=power.limit(LIMIT_POWER, "within") if power else None,
        limit_named_alone=power.limit(LIMIT_POWER, "alone") if power else None,
        shown_size=shown,
        signature=Signature(
            rms=_rms(raw), rms_left=_rms(left), largest_left=float(np.abs(left).max())
        ),
        power=power,
        confused_with=tuple(sorted(confused, key=lambda c: (-c.rival_chance, -c.energy_absorbed))),
        bias={
            p.name: UnnoticedShift(
                value=float(v), shift=float(d), in_u=float(d / s) if s > 0 else 0.0
            )
            for p, v, d, s in zip(stage.base.parameters, value, shift, u, strict=True)
        },
    )
    noise, chance = floor(data, stage.noise, stage.slope), stage.options.false_alarm_rate
    return size, rows(data, handle.effect, data.boundary, size, raw, left, noise, chance)


def _rms(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def _verdict(name: str, loop: BoundaryDiagnosis | None) -> EffectVerdict | None:
    """What the loop made of the effect in this campaign; None where it has not run."""
    if loop is None:
        return None
    named = next((e for e in loop.effects if e.name == name), None)
    tried = next((c for r in loop.rounds for c in r.candidates if c.name == name), None)
    return EffectVerdict(
        verdict=loop.verdict,
        named=named is not None,
        parameters=named.parameters if named else None,
        rivals=named.rivals if named else (),
        rival_of=tuple(e.name for e in loop.effects if name in e.rivals),
        tried=EffectTrial(
            gain=tried.gain,
            p_value=tried.p_value,
            accepted=tried.accepted,
            left_in=tried.left_in,
        )
        if tried
        else None,
    )
