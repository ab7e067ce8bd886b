"""Probability of each explanation, from its evidence and its prior odds.

An explanation is nothing, one effect or two, or nameless structure: a family of the test for
structure, of any size. Nothing means no effect that the test would detect with a power of 80 %: a
smaller one cannot be excluded. Log evidence is divided by `TEMPERATURE`, since the evidence of
inexact forms is overconfident (Grunwald and van Ommen 2017, Bayesian Analysis 12, 1069).
Temperature and prior odds were set on tuning campaigns, whose mix of causes is the base rate that
is assumed (docs/calibration.md).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.loop import structure
from nearlift.loop.evidence import Explanation, Integrated
from nearlift.loop.search_problem import SearchProblem
from nearlift.loop.structure import Hypothesis, Structure
from nearlift.results.diagnosis import ExplanationProbability

#: Divisor of log evidence.
TEMPERATURE = 1.25
#: Log prior odds over nothing of nameless structure; those of a second effect over none.
LOG_NAMELESS_ODDS, LOG_SECOND_ODDS = float(np.log(0.03)), -1.0
#: Log odds of nothing while the test is silent, and once it is significant.
LOG_SILENT_ODDS, LOG_DETECTED_ODDS = 2.0, -2.0
#: Share of explanations that is true: of those that may be named, since structure outside the
#: library can imitate an effect; and where none may be named, since misfit of form and bounds
#: refuse both wrong effects and right ones of another form.
NAMED_SHARE, REFUSED_SHARE = 0.97, 0.5
#: Probability that the set of rival explanations holds.
SET_PROBABILITY = 0.95
#: Root mean square of a nameless part per trial, in standard deviations of its noise.
RELATIVE_SIZES = np.geomspace(0.03, 1.5, 12)
#: Least probability that is listed by itself.
LEAST_LISTED = 0.01
#: Log evidence by which a refused explanation trails the best, beyond which it is not weighed.
NEGLIGIBLE = 12.0

K = TypeVar("K", bound=Hashable)
#: Effects of an explanation, and the covariate of its nameless structure.
Key = tuple[tuple[str, ...], str]


def family_log_evidence(chi2: FloatArray, rank: FloatArray, n: int) -> FloatArray:
    """Log Bayes factor of random effects along orthonormal directions over none, (k,).

    `chi2` and `rank` (k,) are the squared length of the whitened residual along each family, and
    its number of directions. Sizes are root mean squares over `n` trials.
    """
    from scipy.special import logsumexp

    variance = RELATIVE_SIZES[:, None] ** 2 * n / rank
    each = 0.5 * (variance / (1 + variance) * chi2 - rank * np.log1p(variance))
    return np.asarray(logsumexp(each, axis=0) - np.log(len(RELATIVE_SIZES)))


def nameless(problem: SearchProblem, left: Integrated) -> dict[str, float]:
    """Log Bayes factor of nameless structure along each covariate in what an explanation leaves.

    Families have equal prior probability, shared by the times of a step; sums are over those of the
    same covariate.
    """
    kept, chi2, ranks = _tested([h for h in problem.hypotheses[0] if not h.effect], left)
    names = [h.name for h in kept]
    shares = np.log([names.count(name) * len(set(names)) for name in names])
    log_bf = family_log_evidence(chi2, ranks, problem.data.n) - shares
    return _summed(zip((h.covariate for h in kept), log_bf, strict=True))


def first_order(problem: SearchProblem) -> dict[str, float]:
    """Log Bayes factor of each effect over the base model, to first order by unit information."""
    effects = [h for h in problem.hypotheses[0] if h.effect]
    kept, chi2, ranks = _tested(effects, problem.base_linear_fit.left)
    shapes = [h.effect for h in kept]
    log_bf = 0.5 * (chi2 - ranks * np.log(problem.data.n))
    return _summed(zip(shapes, log_bf - np.log([*map(shapes.count, shapes)]), strict=True))


def _tested(
    hypotheses: list[Hypothesis], left: Integrated
) -> tuple[list[Hypothesis], FloatArray, FloatArray]:
    """Hypotheses of which a fit leaves anything, with chi-square and rank of each."""
    which, stacked, ranks = structure.bases(
        structure.mapped(tuple(hypotheses), left.whiten), left.removed
    )
    if not which:
        return [], np.zeros(0), np.zeros(0)
    chi2 = structure.chi2_of_each(left.scores[:, 0], stacked, ranks)
    return [hypotheses[i] for i in which], chi2, ranks


def _summed(terms: Iterable[tuple[K, float]]) -> dict[K, float]:
    """Log of the sum of weights given as logarithms, by key."""
    total: dict[K, float] = {}
    for key, value in terms:
        total[key] = float(np.logaddexp(total.get(key, -np.inf), value))
    return total


def log_odds(problem: SearchProblem, effects: int) -> float:
    """Log prior odds over nothing of an explanation of one effect or two.

    All single effects together have odds 1, as have all second effects `LOG_SECOND_ODDS`.
    """
    n = max(len(problem.known_effects), 3)
    single = -float(np.log(n))
    return single if effects < 2 else single + LOG_SECOND_ODDS - float(np.log((n - 1) / 2))


def log_weights(problem: SearchProblem, explanations: Sequence[Explanation]) -> FloatArray:
    """Log of the relative probabilities of explanations, (k,)."""
    odds = (0.0, log_odds(problem, 1), log_odds(problem, 2))
    return np.array([e.log_evidence / TEMPERATURE + odds[len(e.effects)] for e in explanations])


def relative(problem: SearchProblem, explanations: Sequence[Explanation]) -> FloatArray:
    """Probabilities of explanations, (k,), if one of them is true."""
    from scipy.special import softmax

    return np.asarray(softmax(log_weights(problem, explanations)))


def credible_set(
    problem: SearchProblem, explanations: Sequence[Explanation]
) -> tuple[Explanation, ...]:
    """The fewest explanations that hold `SET_PROBABILITY`, the likeliest first."""
    log = log_weights(problem, explanations)
    member = in_credible_set(log)
    return tuple(explanations[i] for i in np.argsort(-log, kind="stable") if member[i])


def in_credible_set(log_weight: FloatArray) -> NDArray[np.bool_]:
    """Membership in the smallest set that holds `SET_PROBABILITY`.

    `log_weight` is (k, ...), minus infinity for those that are excluded; the same shape.
    """
    if not len(log_weight):
        return np.zeros(log_weight.shape, dtype=bool)
    probability = np.exp(log_weight - np.maximum(log_weight.max(axis=0), -1e300))
    order = np.argsort(-probability, axis=0, kind="stable")
    falling = np.take_along_axis(probability, order, 0)
    before = np.cumsum(falling, axis=0) - falling
    kept = (before < SET_PROBABILITY * falling.sum(axis=0)) & (falling > 0)
    member = np.zeros(log_weight.shape, dtype=bool)
    np.put_along_axis(member, order, kept, 0)
    return member


def membership_margin(log_weight: FloatArray, i: int) -> float:
    """Log evidence by which explanation i is inside the set, negative outside, the others fixed."""
    weight = np.exp(log_weight - log_weight.max())
    others = -np.sort(-np.delete(weight, i))
    before = np.r_[0.0, np.cumsum(others)]
    # least weight in each place of the order that leaves less than the set's share before it
    needed = np.maximum(before / SET_PROBABILITY - before[-1], np.r_[others, 0.0])
    enters = needed[needed <= np.r_[np.inf, others]].min()
    # in logarithms: a weight may underflow
    return TEMPERATURE * float(log_weight[i] - log_weight.max() - np.log(enters))


def weigh(
    problem: SearchProblem,
    first: Structure,
    tried: Sequence[Explanation],
    allowed: Sequence[Explanation],
    silent: bool,
) -> tuple[ExplanationProbability, ...]:
    """Probabilities of nothing, each explanation, and nameless structure along each covariate.

    `first` is the test on the base model, `tried` are all explanations, and `allowed` those that
    may be named. Trials are `silent` if no test shows structure. The likeliest are first; those
    below `LEAST_LISTED` are summed at the end.
    """
    # where visits are few, scores are of those left out, relative to the base model's
    by_visits = problem.independent
    nothing = 0.0 if by_visits else problem.nothing_added[1]
    foremost = next(iter(first.foremost()), "distance")
    odds = LOG_SILENT_ODDS if silent else LOG_DETECTED_ODDS
    terms: list[tuple[Key, float]] = [(((), ""), nothing / TEMPERATURE + odds)]

    def add_nameless(families: Iterable[tuple[str, float]], log_weight: float) -> None:
        for along, log_bf in families:
            terms.append((((), along), log_weight + log_bf / TEMPERATURE + LOG_NAMELESS_ODDS))

    if by_visits:
        add_nameless([(foremost, 0.0)], 0.0)
    else:
        along = nameless(problem, problem.base_linear_fit.left)
        add_nameless(along.items(), nothing / TEMPERATURE)
        if problem.null_fit.random_walk_gain:
            add_nameless([("start", problem.unnamed - nothing)], nothing / TEMPERATURE)
    if first.present:
        named, explanations = bool(allowed), allowed or tried
        log = log_weights(problem, explanations)
        least = np.max(log, where=np.isfinite(log), initial=-np.inf) - NEGLIGIBLE / TEMPERATURE
        # a share of each explanation is nameless structure that imitates it
        share = NAMED_SHARE if named else REFUSED_SHARE
        for e, value in zip(explanations, log.tolist(), strict=True):
            if not (named or value >= least):
                continue
            terms.append(((e.effects, ""), value + float(np.log(share))))
            terms.append((((), foremost), value + float(np.log(1 - share))))
            if not (named or by_visits):
                linear_fit = problem.linearised(e.fitted, e.form_sd, e.random_walk_gain)
                add_nameless(nameless(problem, linear_fit.left).items(), value)
    else:
        single = nothing / TEMPERATURE + log_odds(problem, 1)
        # where visits are few, trials are fitted as independent but weighed as correlated
        for name, log_bf in first_order(problem.correlated).items():
            terms.append((((name,), ""), single + log_bf / TEMPERATURE))
    return _listed(_summed(terms))


def _listed(log_weight: dict[Key, float]) -> tuple[ExplanationProbability, ...]:
    total = np.logaddexp.reduce([*log_weight.values()])
    listed = sorted(((np.exp(v - total), k) for k, v in log_weight.items()), key=lambda i: -i[0])
    kept = [
        ExplanationProbability(effects=effects, nameless=along or None, probability=float(value))
        for value, (effects, along) in listed
        if value >= LEAST_LISTED
    ]
    rest = [float(value) for value, _ in listed if value < LEAST_LISTED]
    if rest:
        kept.append(ExplanationProbability(effects=(), other=len(rest), probability=sum(rest)))
    return tuple(kept)
