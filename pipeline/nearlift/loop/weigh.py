"""Probability of each explanation, from its evidence and its prior odds.

An explanation is nothing, one effect or two, or nameless structure: a family of the test for
structure, of any size. Log evidence is divided by `TEMPERATURE`, since the evidence of inexact
forms is overconfident (Grunwald and van Ommen 2017, Bayesian Analysis 12, 1069). Temperature and
prior odds were set on tuning campaigns (docs/calibration.md).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.loop import structure
from nearlift.loop.evidence import Integrated
from nearlift.loop.explanation import Explanation
from nearlift.loop.search_problem import SearchProblem
from nearlift.loop.structure import Hypothesis, Structure
from nearlift.nomenclature import SCHEDULE_WORDS
from nearlift.results.diagnosis import ExplanationProbability

#: Divisor of log evidence.
TEMPERATURE = 1.25
#: Log prior odds over nothing of nameless structure that the test detects, and of such that it does
#: not; those of a second effect over none.
LOG_NAMELESS_ODDS, LOG_UNDETECTED_ODDS = float(np.log(0.02)), float(np.log(0.5))
LOG_SECOND_ODDS = -1.0
#: Probability that the set of rival explanations holds.
SET_PROBABILITY = 0.95
#: Root mean square of a nameless part per trial, in standard deviations of its noise.
RELATIVE_SIZES = np.geomspace(0.03, 1.5, 12)
#: Least probability that is listed by itself.
LEAST_LISTED = 0.01
#: Log evidence by which an explanation trails the best, beyond which it is not weighed.
NEGLIGIBLE = 12.0

#: Effects of an explanation, and the covariate of its nameless structure.
Key = tuple[tuple[str, ...], str]
#: An explanation with its log evidence and log prior odds.
Term = tuple[Key, float, float]


def family_log_evidence(chi2: FloatArray, rank: FloatArray, n: int) -> FloatArray:
    """Log Bayes factor of random effects along orthonormal directions over none, (k,).

    Parameters
    ----------
    chi2, rank : (k,)
        Squared length of the whitened residual along each family, and its number of directions.
    n : int
        Number of trials; the effects' sizes are root mean squares over them.
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
    families = [h for h in problem.hypotheses[0] if not h.effect]
    kept, chi2, ranks = tested(families, left)
    names = [h.name for h in kept]
    shares = np.log([names.count(name) * len(set(names)) for name in names])
    log_bf = family_log_evidence(chi2, ranks, problem.data.n) - shares
    return _summed(
        (SCHEDULE_WORDS.get(h.covariate, h.covariate), float(value))
        for h, value in zip(kept, log_bf, strict=True)
    )


def first_order(problem: SearchProblem) -> dict[str, float]:
    """Log Bayes factor of each effect over the base model, to first order by unit information."""
    effects = [h for h in problem.hypotheses[0] if h.effect]
    kept, chi2, ranks = tested(effects, problem.base_linear_fit.left)
    shapes = [h.effect for h in kept]
    log_bf = 0.5 * (chi2 - ranks * np.log(problem.data.n))
    shares = np.log([shapes.count(name) for name in shapes])
    return _summed((h.effect, float(value)) for h, value in zip(kept, log_bf - shares, strict=True))


def tested(
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


def _summed(weights: Iterable[tuple[str, float]]) -> dict[str, float]:
    """Log of the sum of weights given as logarithms, by key."""
    from scipy.special import logsumexp

    by_key: dict[str, list[float]] = defaultdict(list)
    for key, value in weights:
        by_key[key].append(value)
    return {key: float(logsumexp(values)) for key, values in by_key.items()}


def log_odds(problem: SearchProblem, effects: int) -> float:
    """Log prior odds over nothing of an explanation of one effect or two.

    All single effects together have odds 1, as have all second effects `LOG_SECOND_ODDS`.
    """
    n = max(len({e.name for e, _ in problem.library}), 3)
    single = -float(np.log(n))
    return single if effects < 2 else single + LOG_SECOND_ODDS - float(np.log((n - 1) / 2))


def log_weights(problem: SearchProblem, explanations: Sequence[Explanation]) -> FloatArray:
    """Log of the relative probabilities of explanations, (k,)."""
    return np.array(
        [e.evidence.log / TEMPERATURE + log_odds(problem, len(e.effects)) for e in explanations]
    )


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
) -> tuple[ExplanationProbability, ...]:
    """Probabilities of nothing, each explanation, and nameless structure along each covariate.

    `first` is the test on the base model, `tried` are all explanations, and `allowed` those that
    may be named. If none is, each counts as nameless structure along what it leaves. The likeliest
    are first; those below `LEAST_LISTED` are summed at the end.
    """
    from scipy.special import softmax

    terms = _terms(problem, first, tried, allowed)
    total: dict[Key, float] = defaultdict(float)
    for (key, _, _), value in zip(
        terms, softmax([log / TEMPERATURE + odds for _, log, odds in terms]), strict=True
    ):
        total[key] += float(value)
    listed = sorted(total.items(), key=lambda item: -item[1])
    kept = [
        ExplanationProbability(effects=effects, nameless=along or None, probability=value)
        for (effects, along), value in listed
        if value >= LEAST_LISTED
    ]
    rest = [value for _, value in listed if value < LEAST_LISTED]
    if rest:
        kept.append(ExplanationProbability(effects=(), other=len(rest), probability=sum(rest)))
    return tuple(kept)


def _terms(
    problem: SearchProblem,
    first: Structure,
    tried: Sequence[Explanation],
    allowed: Sequence[Explanation],
) -> list[Term]:
    """Log evidence and log prior odds of everything that is weighed."""
    if problem.independent:
        # scores on visits left out are relative to the base model's, and families have none
        nothing, along = 0.0, {next(iter(first.foremost()), "distance"): 0.0}
    else:
        nothing = problem.nothing_added[1]
        along = nameless(problem, problem.base_linear_fit.left)
    unnamed = LOG_NAMELESS_ODDS if first.present else LOG_UNDETECTED_ODDS
    terms: list[Term] = [(((), ""), nothing, 0.0)]
    terms += [(((), name), nothing + value, unnamed) for name, value in along.items()]
    if not problem.independent and problem.null_fit.random_walk_gain:
        terms.append((((), "start"), problem.unnamed, unnamed))
    if not first.present:
        return terms + [
            (((name,), ""), nothing + value, log_odds(problem, 1))
            for name, value in first_order(problem).items()
        ]
    terms += [((e.effects, ""), e.evidence.log, log_odds(problem, len(e.effects))) for e in allowed]
    if allowed:
        return terms
    tried = [e for e in tried if np.isfinite(e.evidence.log)]
    least = max((e.evidence.log for e in tried), default=0.0) - NEGLIGIBLE
    for e in (e for e in tried if e.evidence.log >= least):
        log, odds, left = e.evidence.log, log_odds(problem, len(e.effects)), along
        if not problem.independent:
            linear_fit = problem.linearised(e.fitted, e.form_sd, e.random_walk_gain)
            left = nameless(problem, linear_fit.left)
            terms += [(((), name), log + value, odds + unnamed) for name, value in left.items()]
        terms.append((((), max(left, key=left.__getitem__, default="distance")), log, odds))
    return terms
