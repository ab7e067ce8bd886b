"""Predictions for a design: effects detected or confounded, and detection limits of few trials."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable

from nearlift.declare import Effect
from nearlift.loop import coefficients
from nearlift.loop.families import STEP, families
from nearlift.loop.limits import unidentifiable_coefficients
from nearlift.loop.power import (
    LIMIT_POWER,
    DesignPower,
    NamingProbability,
    SizeParameter,
    size_parameters,
)
from nearlift.loop.search_problem import SILENT, SearchProblem
from nearlift.results import Noise
from nearlift.results.answers import BoundaryOutlook, ExpectedCoefficient
from nearlift.results.outlook import (
    DetectionLimit,
    EffectOutlook,
    Sensitivity,
    UnseenBias,
    UntestableEffect,
)
from nearlift.rounding import plain

#: Probability from which a rival counts as confounded with an effect, or the effect as named; and
#: the least probability of a rival that is listed.
CONFUSED, LISTED = 0.5, 0.05


def outlook(
    design: DesignPower,
    library: tuple[Effect, ...],
    untestable: tuple[UntestableEffect, ...],
    expected: Noise,
) -> BoundaryOutlook:
    """Power, confounding and bias of a design for the testable effects of the `library`.

    The design is at the noise floor that the loop would find, `expected` is the noise that the plan
    assumes.
    """
    problem = design.problem
    value, u = coefficients.spread(problem, problem.base_fit)
    undetected = coefficients.constrained_columns(problem, ())
    _, u_wide = coefficients.spread(problem, problem.base_fit, undetected)
    rows = tuple(
        effect_outlook(design, of, u)
        for effect in library
        if not effect.within_trial
        for of in size_parameters(effect)
    )
    return BoundaryOutlook(
        base_model=problem.base.name,
        trials=problem.data.n,
        false_alarm_rate=problem.options.false_alarm_rate,
        noise=problem.noise,
        coefficients={
            p.name: ExpectedCoefficient(
                expected=float(v), u=float(s), u_with_undetected_effects=float(w)
            )
            for p, v, s, w in zip(problem.base.parameters, value, u, u_wide, strict=True)
        },
        effects=rows,
        groups=groups(rows),
        limits=unidentifiable_coefficients(problem, problem.base_fit),
        expected_noise=expected,
        untestable=untestable,
    )


def effect_outlook(design: DesignPower, of: SizeParameter, u: Iterable[float]) -> EffectOutlook:
    """Detection limit of one size, naming at its plausible size, and bias of the coefficients. The
    bias is at the largest plausible size that goes undetected, also in `u` (p,).
    """
    problem, limit = design.problem, design.limit(of)
    share = problem.visibility(of.effect)
    contest = design.contest(of, of.expected) if share > SILENT else NamingProbability()
    hiding = of.expected if limit is None else min(limit, of.expected)
    if share <= SILENT:
        verdict = "silent"
    elif contest.seen < LIMIT_POWER:
        verdict = "too small to see"
    elif contest.alone >= CONFUSED:
        verdict = "named"
    elif any(c >= CONFUSED for c in contest.rivals.values()):
        verdict = "detectable, confounded"
    else:
        verdict = "seen, seldom named"
    rivals = sorted(contest.rivals.items(), key=lambda item: -item[1])
    return EffectOutlook(
        effect=of.effect.name,
        parameter=of.parameter.name,
        unit=of.parameter.unit,
        shape=of.shape,
        share_visible=share,
        plausible_size=of.expected,
        detection_limit=limit,
        verdict=verdict,
        seen=contest.seen,
        within=contest.within,
        first=contest.first,
        alone=contest.alone,
        rivals={name: chance for name, chance in rivals if chance >= LISTED},
        hides_up_to=hiding,
        bias={
            p.name: UnseenBias(shift=float(d), in_u=float(d / s) if s > 0 else 0.0)
            for p, d, s in zip(problem.base.parameters, design.harm(of, hiding), u, strict=True)
        },
    )


def groups(rows: Iterable[EffectOutlook]) -> tuple[tuple[str, ...], ...]:
    """Connected components of the effects that are confounded at their plausible sizes."""
    group: dict[str, set[str]] = {}
    for row in rows:
        for rival, chance in row.rivals.items():
            if row.verdict == "too small to see" or chance < CONFUSED:
                continue
            merged = group.get(row.effect, {row.effect}) | group.get(rival, {rival})
            group |= dict.fromkeys(merged, merged)
    return tuple(sorted({tuple(sorted(g)) for g in group.values()}))


def sensitivity(problem: SearchProblem, seen: Collection[str] = ()) -> Sensitivity:
    """Families and effects searched for, and the detection limits of the effects.

    Limits hold about the base fit, which is wrong where an effect was `seen`: those are left out.
    """
    design, data = DesignPower(problem=problem), problem.data
    limits = [
        _limit(of, design.limit(of))
        for effect in problem.visible
        if effect.name not in seen
        for of in size_parameters(effect)
    ]
    return Sensitivity(
        trials=data.n,
        families=tuple(dict.fromkeys(f.name for f in families(data) if f.name != STEP)),
        effects=tuple(e.name for e in problem.visible),
        chance=LIMIT_POWER,
        limits=tuple(
            sorted(limits, key=lambda row: (row.size is None, (row.size or 0.0) / row.plausible))
        ),
    )


def _limit(of: SizeParameter, size: float | None) -> DetectionLimit:
    """Detection limit of one effect's parameter, in words too."""
    parameter, text = of.parameter, of.effect.name
    if size is not None:
        unit = "" if parameter.unit == "1" else f" {parameter.unit.replace('1/', 'per ')}"
        # "offset" of offset_m, with its unit behind the number
        label = re.sub(r"(_per)?_[mNK]$", "", parameter.name).replace("_hat2", " squared")
        away = "" if parameter.value == 0 else f" away from {plain(parameter.value, 3)}"
        text += f" ({label.replace('_', ' ')} ≥ {plain(size, 2)}{unit}{away})"
    return DetectionLimit(
        effect=of.effect.name,
        parameter=parameter.name,
        unit=parameter.unit,
        size=size,
        plausible=of.plausible,
        text=text,
    )
