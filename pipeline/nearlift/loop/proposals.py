"""Smallest changes to a design that separate confounded effects: further trials, the same trials
run otherwise, or further logging.

Changes are ranked by the expected evidence per trial of the linearised model (T-optimality); the
best are checked by the power of the changed design.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from nearlift.likelihood.covariates import unlogged
from nearlift.loop.candidate_fit import Point, search
from nearlift.loop.power import DesignPower
from nearlift.loop.separation import APART, join, menu, parted, session
from nearlift.loop.size_parameter import SizeParameter
from nearlift.results import Observations
from nearlift.results.design import (
    ChangeOption,
    CheckedChange,
    ConfoundedPair,
    PlanChanges,
    RankedChange,
    RivalChance,
)

#: Trials in an addition of this module.
FEW = 80
#: Most pairs that are examined, changes that are checked, and options listed for a pair.
MOST_PAIRS, CHECKED, LISTED = 12, 3, 4
#: Standard uncertainty of a height datum from a touch-off with a feeler gauge, m.
GAUGE_M = 1e-4


@dataclass(frozen=True, slots=True, kw_only=True)
class Pair:
    """An effect of one size, and a rival with its probability to be named or a rival."""

    size_parameter: SizeParameter
    rival: str
    size: float
    chance: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignChange:
    """A change to a design. ``gain(one, other, now)`` is the non-centrality between two points that
    it adds to `now`; `data` the changed trials, None for another kind of measurement.
    """

    text: str
    trials: int
    gain: Callable[[Point, Point, float], float]
    data: Observations | None = None


def changes(
    design: DesignPower, pairs: list[Pair], variants: Mapping[str, Observations]
) -> PlanChanges:
    """Changes that would separate each confounded pair, and those that serve most pairs.

    `variants` are the same trials run otherwise. A pair whose evidence is large already is
    confounded by the uncertainty of the effects' forms: no number of trials of this kind separates
    it.
    """
    problem = design.problem
    effects = {e.name: e for e, _ in problem.library}
    offered = menu_of(design, variants)
    listed: list[ConfoundedPair] = []
    tally: dict[str, list[tuple[bool, float]]] = {c.text: [] for c in offered}
    likeliest: dict[frozenset[str], Pair] = {}
    for pair in sorted(pairs, key=lambda p: -p.chance):
        likeliest.setdefault(frozenset((pair.size_parameter.effect.name, pair.rival)), pair)
    kept = list(likeliest.values())[:MOST_PAIRS]
    for pair in kept:
        effect, rival = pair.size_parameter.effect, effects[pair.rival]
        one: Point = ((effect,), design.vector(pair.size_parameter, pair.size))
        log_lift = problem.candidate(effect).log_ratio(one[1])
        other = search(problem.candidate(rival), problem.starts, log_lift).point
        now = parted(problem, problem.data, one, other)
        by_form = now >= APART
        options: list[ChangeOption] = []
        for change in offered:
            gain = change.gain(one, other, now)
            # a pair confounded by form and not by noise needs another kind of measurement
            other_kind = change.data is None
            parts = gain >= APART if by_form and other_kind else not by_form and now + gain >= APART
            tally[change.text].append((parts, min(gain, APART)))
            option = _option(change, gain, APART if by_form else max(APART - now, 0.0))
            if option is not None and (other_kind or not by_form):
                options.append(option)
        options.sort(key=lambda o: (o.trials_to_part, -o.evidence))
        missing = {x for e in (effect, rival) for x in unlogged(e, problem.data)}
        listed.append(
            ConfoundedPair(
                pair=(effect.name, rival.name),
                parameter=pair.size_parameter.parameter.name,
                size=pair.size,
                unit=pair.size_parameter.parameter.unit,
                rival_chance=pair.chance,
                evidence_now=now,
                held_together_by="form" if by_form else "noise",
                options=tuple(options[:LISTED]),
                log=tuple(sorted(missing)),
            )
        )
    ranking = [
        RankedChange(
            change=c.text,
            trials=c.trials,
            pairs_parted=sum(p for p, _ in tally[c.text]),
            pairs=len(kept),
            evidence_per_trial=sum(g for _, g in tally[c.text]) / max(c.trials, 1),
        )
        for c in offered
        if kept
    ]
    ranking.sort(key=lambda r: (-r.pairs_parted, -r.evidence_per_trial))
    by_text = {c.text: c for c in offered}
    best = [
        CheckedChange(
            change=r.change,
            trials=r.trials,
            pairs_parted=r.pairs_parted,
            pairs=r.pairs,
            evidence_per_trial=r.evidence_per_trial,
            rivals_after=_after(design, by_text[r.change], kept),
        )
        for r in ranking[:CHECKED]
    ]
    return PlanChanges(pairs=tuple(listed), best=(*best, *ranking[CHECKED : CHECKED + 2]))


def _option(change: DesignChange, gain: float, lacking: float) -> ChangeOption | None:
    """Evidence of one change for one pair; None where ten times its trials do not separate them."""
    needed = change.trials
    enough = gain >= lacking
    if change.data is not None and change.trials:
        rate = gain / change.trials
        needed = int(np.ceil(lacking / rate)) if rate > 0 else 0
        enough = rate > 0 and needed <= 10 * change.trials
    if not enough:
        return None
    return ChangeOption(
        change=change.text,
        trials=change.trials,
        evidence=gain,
        evidence_per_trial=gain / change.trials if change.trials else None,
        trials_to_part=needed,
    )


def _after(
    design: DesignPower, change: DesignChange, pairs: list[Pair]
) -> tuple[RivalChance, ...] | None:
    """Each pair's probability of confusion after the change; None if it changes no trials."""
    if change.data is None:
        return None
    problem = design.problem
    log_ratio = problem.candidate().log_ratio(problem.base_fit.vector, change.data)
    changed = dataclasses.replace(
        problem, data=change.data, log_lift=np.log(change.data.covariates["lift_inf_N"]) + log_ratio
    )
    then = dataclasses.replace(design, problem=changed)
    return tuple(
        RivalChance(
            pair=(p.size_parameter.effect.name, p.rival),
            before=p.chance,
            after=then.contest(p.size_parameter, p.size).rivals.get(p.rival, 0.0),
        )
        for p in pairs
    )


def menu_of(design: DesignPower, variants: Mapping[str, Observations]) -> list[DesignChange]:
    """Everything that may be proposed for this design."""
    problem = design.problem

    def by_data(data: Observations) -> Callable[[Point, Point, float], float]:
        return lambda one, other, now: max(parted(problem, data, one, other) - now, 0.0)

    offered = [
        DesignChange(text=text, trials=0, gain=by_data(data), data=data)
        for text, data in variants.items()
    ]
    additions = {p.text: p.added for p in menu(problem.data, problem.options.not_feasible)} | _more(
        problem.data
    )
    for text, added in additions.items():
        whole = join(problem.data, added)
        offered.append(DesignChange(text=text, trials=added.n, gain=by_data(whole), data=whole))
    places = len(np.unique(problem.data.z_hat))
    offered.append(
        DesignChange(
            text="a motors-off sweep of all distances, twice",
            trials=2 * places,
            gain=lambda one, other, _: _motors_off(design, one, other),
        )
    )
    if np.isfinite(problem.data.z_hat).any():
        offered.append(
            DesignChange(
                text=f"touch the traverse off with a gauge ({1e3 * GAUGE_M:g} mm)",
                trials=0,
                gain=lambda one, other, _: _gauge(one, other),
            )
        )
    return offered


def _more(data: Observations) -> dict[str, Observations]:
    """Besides those of `separation.menu`: a lower throttle; the farthest distance in between."""
    finite = data.z_hat[np.isfinite(data.z_hat)]
    near, far = float(finite.min()), float(finite.max())
    lowest = float(data.levels.min())
    low = session(data, (near, far), FEW)
    slow = low.throttle == lowest
    halved = np.where(slow, 0.5, 1.0)
    # half the lift of the lowest level: lift as the power 1.4 of throttle
    low = dataclasses.replace(
        low,
        throttle=np.where(slow, 0.61 * lowest, low.throttle),
        lift_N=halved * low.lift_N,
        covariates={**low.covariates, "lift_inf_N": halved * low.covariates["lift_inf_N"]},
    )
    lower = f"a lower throttle too ({61 * lowest:.2g} %), at the closest and the farthest distance"
    options = {lower: low}
    if data.session.max() > 0 and len(np.unique(finite)) > 1:
        stops = data.take(np.flatnonzero(np.r_[True, data.visit[1:] != data.visit[:-1]]))
        pick = stops.take(np.unique(np.linspace(0, stops.n - 1, min(FEW, stops.n)).astype(int)))
        again = dataclasses.replace(
            pick, z_hat=np.full(pick.n, far), visit=np.arange(pick.n) + int(data.visit.max()) + 1
        )
        options["visits of the farthest distance between the others, evenly over all sessions"] = (
            again
        )
    return options


def _motors_off(design: DesignPower, one: Point, other: Point) -> float:
    """Evidence from two sweeps at rest, which show additive effects that do not depend on lift."""
    problem = design.problem
    sigma = float(np.hypot(problem.noise.force_N, np.median(problem.data.u_lift_N)))
    if sigma <= 0:
        return 0.0
    _, first = np.unique(problem.data.z_hat, return_index=True)
    force = np.zeros(len(first))
    for sign, (effects, vector) in ((1.0, one), (-1.0, other)):
        for e in effects:
            # effects that grow with lift, or with previous lift, vanish when the rotors stand
            if e.additive and not e.loaded:
                share = np.expm1(problem.candidate(*effects).contribution(vector, e))
                force += sign * (share * problem.data.covariates["lift_inf_N"])[first]
    return float(2 * np.sum((force / sigma) ** 2))


def _gauge(one: Point, other: Point) -> float:
    """Evidence from a touch-off: an offset of the datum is then known to `GAUGE_M`."""
    total = 0.0
    for effects, vector in (one, other):
        # the effect's only entry is the last of the vector
        total += sum(float((vector[-1] / GAUGE_M) ** 2) for e in effects if e.error_of == "height")
    return total
