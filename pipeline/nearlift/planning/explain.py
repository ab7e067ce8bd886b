"""Account of one effect in one campaign: its mechanism, its detection limit, its confusions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nearlift import catalogue
from nearlift.campaign.manifest import Campaign
from nearlift.declare import Boundary, Effect, FloatArray
from nearlift.errors import InputRefused, NotConverged
from nearlift.loop import coefficients
from nearlift.loop.few_visits import visits_are_few
from nearlift.loop.power import LIMIT_POWER, DesignPower, SizeParameter, size_parameters
from nearlift.loop.search_problem import SILENT
from nearlift.loop.within_trial import power as heating_power
from nearlift.observed import Trials, boundaries
from nearlift.planning.forecast import Forecast, of_trials
from nearlift.results.answers import (
    Confusion,
    EffectAccount,
    EffectAtBoundary,
    EffectBetweenTrials,
    EffectSize,
    EffectWithinTrial,
    NoCandidate,
    Signature,
)
from nearlift.results.diagnosis import BoundaryDiagnosis
from nearlift.results.outlook import UnseenBias


def explain(
    name: str,
    trials: Trials,
    campaign: Campaign,
    diagnoses: Mapping[Boundary, BoundaryDiagnosis],
    seed: int,
) -> EffectAccount:
    """Account of the effect of that name at every boundary.

    Raises
    ------
    UsageError
        There is no such effect.
    InputRefused
        No boundary has enough trials; the reasons.
    """
    effect = catalogue.effect(name)
    explained: dict[Boundary, EffectAtBoundary] = {}
    refused = []
    for boundary in boundaries(trials):
        try:
            forecast = of_trials(trials, campaign, boundary, diagnoses.get(boundary), seed)
        except NotConverged as fault:
            refused.append(f"{boundary}: {fault.what}; {fault.remedy}")
            continue
        explained[boundary] = _at(forecast, effect)
    if not explained:
        raise InputRefused(
            campaign.name,
            "; ".join(refused) or "no trial was accepted",
            "an explanation needs what a diagnosis needs",
        )
    return EffectAccount(
        effect=effect.name,
        campaign=campaign.name,
        boundaries=explained,
        notes=tuple(refused),
    )


def _at(forecast: Forecast, effect: Effect) -> EffectAtBoundary:
    """Account at one boundary."""
    for lacking in forecast.untestable:
        if lacking.effect == effect.name:
            return NoCandidate(needs=lacking.needs, log_next_time=lacking.log_next_time)
    known = {e.name: e for e in forecast.effects}
    if effect.name not in known:
        reason = "it does not occur at this boundary, or the base model holds it already"
        return NoCandidate(needs=(), log_next_time=(), reason=reason)
    # its sizes are those of this campaign's lift
    effect = known[effect.name]
    problem = forecast.problem
    rate = problem.options.false_alarm_rate
    common: dict[str, Any] = {
        "base_model": problem.base.name,
        "trials": problem.data.n,
        "false_alarm_rate": rate,
        "few_visits": visits_are_few(problem.data),
        "noise": problem.noise,
    }
    if effect.within_trial:
        power = heating_power(problem.data, rate, LIMIT_POWER)
        return EffectWithinTrial(**common, within_trial=power)
    return EffectBetweenTrials(
        **common,
        share_visible=problem.visibility(effect),
        sizes=tuple(_size(forecast.design, of) for of in size_parameters(effect)),
    )


def _size(design: DesignPower, size_parameter: SizeParameter) -> EffectSize:
    """Power, detection limit, confusions and harm of one of the effect's sizes."""
    stage = design.problem
    silent = stage.visibility(size_parameter.effect) <= SILENT
    power = None if silent else design.power(size_parameter)
    limit = power.limit(LIMIT_POWER) if power else None
    shown = min(size_parameter.plausible, size_parameter.largest) if limit is None else limit
    raw, left = design.signature(size_parameter, shown)
    contest = None if silent else design.contest(size_parameter, shown)
    absorbed = {} if silent else design.absorbed(size_parameter)
    value, u = coefficients.spread(stage, stage.base_fit)
    shift = design.harm(size_parameter, shown)
    confused = [
        Confusion(
            effect=n,
            energy_absorbed=a,
            rival_chance=contest.rivals.get(n, 0.0) if contest else 0.0,
        )
        for n, a in absorbed.items()
    ]
    return EffectSize(
        parameter=size_parameter.parameter.name,
        unit=size_parameter.parameter.unit,
        meaning=size_parameter.parameter.meaning,
        per=size_parameter.parameter.per,
        shape=size_parameter.shape,
        plausible_size=size_parameter.plausible,
        largest_size=size_parameter.largest,
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
            p.name: UnseenBias(value=float(v), shift=float(d), in_u=float(d / s) if s > 0 else 0.0)
            for p, v, d, s in zip(stage.base.parameters, value, shift, u, strict=True)
        },
    )


def _rms(x: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(x))))
