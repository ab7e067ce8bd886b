"""Report of a design: effects detected or confounded.

For few trials, once diagnosed, it gives the detection limits.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable

import numpy as np

from nearlift.declare import Effect
from nearlift.loop import coefficients
from nearlift.loop.absorption import unidentifiable_coefficients
from nearlift.loop.families import STEP, families
from nearlift.loop.power import DesignPower
from nearlift.loop.search_problem import SearchProblem
from nearlift.loop.size_parameter import (
    LIMIT_POWER,
    NamingProbability,
    SizeParameter,
    size_parameters,
)
from nearlift.loop.visibility import SILENT, visibility
from nearlift.results import Noise
from nearlift.results.design import BoundaryOutlook, ExpectedCoefficient
from nearlift.results.outlook import (
    DetectionLimit,
    EffectOutlook,
    Sensitivity,
    UnseenBias,
    UntestableEffect,
)
from nearlift.rounding import plain

#: Probability from which a rival counts as confounded with an effect, or the effect as named.
CONFUSED = 0.5


def outlook(
    design: DesignPower,
    library: tuple[Effect, ...],
    untestable: tuple[UntestableEffect, ...],
    expected: Noise,
) -> BoundaryOutlook:
    """Power, confounding and bias of a design.

    Parameters
    ----------
    design : DesignPower
        Power of the design, at the noise floor that the loop would find.
    library : tuple of Effect
        The testable effects.
    untestable : tuple of UntestableEffect
    expected : Noise
        Noise that the plan assumes.
    """
    problem = design.problem
    rows = tuple(
        weigh(design, size_parameter)
        for effect in library
        if not effect.within_trial
        for size_parameter in size_parameters(effect)
    )
    value, u = coefficients.spread(problem, problem.base_fit)
    unseen = coefficients.constrained_columns(problem, ())
    _, u_wide = coefficients.spread(problem, problem.base_fit, unseen)
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


def weigh(design: DesignPower, size_parameter: SizeParameter) -> EffectOutlook:
    """Detection limit of one size_parameter, its contest at the plausible size, and the bias of the
    coefficients at the largest plausible size that goes undetected.
    """
    problem = design.problem
    share = visibility(problem, size_parameter.effect)
    plausible = min(size_parameter.plausible, size_parameter.largest)
    limit = design.limit(size_parameter)
    contest = design.contest(size_parameter, plausible) if share > SILENT else NamingProbability()
    hiding = plausible if limit is None else min(limit, plausible)
    shift = design.harm(size_parameter, hiding)
    _, u = coefficients.spread(problem, problem.base_fit)
    if share <= SILENT:
        verdict = "silent"
    elif contest.seen < LIMIT_POWER:
        verdict = "too small to see"
    elif contest.alone >= CONFUSED:
        verdict = "named"
    else:
        verdict = (
            "detectable, confounded"
            if any(c >= CONFUSED for c in contest.rivals.values())
            else "seen, seldom named"
        )
    return EffectOutlook(
        effect=size_parameter.effect.name,
        parameter=size_parameter.parameter.name,
        unit=size_parameter.parameter.unit,
        shape=size_parameter.shape,
        share_visible=share,
        plausible_size=plausible,
        detection_limit=limit,
        verdict=verdict,
        seen=contest.seen,
        within=contest.within,
        first=contest.first,
        alone=contest.alone,
        rivals={n: c for n, c in sorted(contest.rivals.items(), key=lambda i: -i[1]) if c >= 0.05},
        hides_up_to=hiding,
        bias={
            p.name: UnseenBias(shift=float(d), in_u=float(d / s) if s > 0 else 0.0)
            for p, d, s in zip(problem.base.parameters, shift, u, strict=True)
        },
    )


def confounded(row: EffectOutlook) -> dict[str, float]:
    """The rivals that an effect of its plausible size is confounded with, and their chances."""
    if row.verdict == "too small to see":
        return {}
    return {rival: chance for rival, chance in row.rivals.items() if chance >= CONFUSED}


def groups(rows: Iterable[EffectOutlook]) -> tuple[tuple[str, ...], ...]:
    """Connected components of the effects that are confounded at their plausible sizes."""
    group: dict[str, set[str]] = {}
    for row in rows:
        for rival in confounded(row):
            merged = group.get(row.effect, {row.effect}) | group.get(rival, {rival})
            for name in merged:
                group[name] = merged
    return tuple(sorted({tuple(sorted(g)) for g in group.values()}))


def sensitivity(problem: SearchProblem, seen: Collection[str] = ()) -> Sensitivity:
    """Families and effects searched for, and the detection limits of the effects.

    Limits hold about the base fit, which is wrong where an effect was `seen`: those are left out.
    """
    design, data = DesignPower(problem=problem), problem.data
    declared = (data.u_lift_N / data.lift_N) ** 2 / problem.space.covariance.variance
    listed = [
        _limit(design, size_parameter)
        for effect in design.candidates
        if effect.name not in seen
        for size_parameter in size_parameters(effect)
    ]
    return Sensitivity(
        trials=data.n,
        families=tuple(dict.fromkeys(f.name for f in families(data) if f.name != STEP)),
        effects=tuple(e.name for e in design.candidates),
        chance=LIMIT_POWER,
        declared_share=float(np.median(declared)),
        limits=tuple(
            sorted(listed, key=lambda row: (row.size is None, (row.size or 0.0) / row.plausible))
        ),
    )


def _limit(design: DesignPower, size_parameter: SizeParameter) -> DetectionLimit:
    """Detection limit of one effect's parameter, at a power of `LIMIT_POWER`."""
    size, parameter, text = (
        design.limit(size_parameter),
        size_parameter.parameter,
        size_parameter.effect.name,
    )
    if size is not None:
        unit = "" if parameter.unit == "1" else f" {parameter.unit.replace('1/', 'per ')}"
        # "offset" of offset_m, with its unit behind the number
        label = re.sub(r"(_per)?_[mNK]$", "", parameter.name).replace("_hat2", " squared")
        away = "" if parameter.value == 0 else f" away from {plain(parameter.value, 3)}"
        text += f" ({label.replace('_', ' ')} ≥ {plain(size, 2)}{unit}{away})"
    return DetectionLimit(
        effect=size_parameter.effect.name,
        parameter=parameter.name,
        unit=parameter.unit,
        size=size,
        plausible=size_parameter.plausible,
        text=text,
    )
