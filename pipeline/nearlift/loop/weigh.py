"""Probability of each explanation, from its evidence and its prior odds.

An explanation is nothing, one effect or two, or nameless structure: a family of the test for
structure, of any size. Nothing means no effect that the test would detect with a power of 80 %: a
smaller one cannot be excluded. Log evidence is divided by `TEMPERATURE`, since the evidence of
inexact forms is overconfident (Grunwald and van Ommen 2017, Bayesian Analysis 12, 1069).
Temperature and prior odds were set on tuning campaigns, whose mix of causes is the base rate that
is assumed (docs/calibration.md).
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from typing import TypeVar

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
#: An explanation with the log of its relative probability.
Term = tuple[Key, float]


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
    return _summed([SCHEDULE_WORDS.get(h.covariate, h.covariate) for h in kept], log_bf)


def first_order(problem: SearchProblem) -> dict[str, float]:
    """Log Bayes factor of each effect over the base model, to first order by unit information."""
    effects = [h for h in problem.hypotheses[0] if h.effect]
    kept, chi2, ranks = tested(effects, problem.base_linear_fit.left)
    shapes = [h.effect for h in kept]
    log_bf = 0.5 * (chi2 - ranks * np.log(problem.data.n))
    return _summed(shapes, log_bf - np.log([shapes.count(name) for name in shapes]))


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


def _summed(keys: Sequence[K], log: FloatArray) -> dict[K, float]:
    """Log of the sum of weights given as logarithms, by key."""
    total: dict[K, float] = {}
    for key, value in zip(keys, log.tolist(), strict=True):
        total[key] = float(np.logaddexp(total.get(key, -np.inf), value))
    return total


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
    silent: bool,
) -> tuple[ExplanationProbability, ...]:
    """Probabilities of nothing, each explanation, and nameless structure along each covariate.

    `first` is the test on the base model, `tried` are all explanations, and `allowed` those that
    may be named. Trials are `silent` if no test shows structure. The likeliest are first; those
    below `LEAST_LISTED` are summed at the end.
    """
    of_nothing = LOG_SILENT_ODDS if silent else LOG_DETECTED_ODDS
    terms = _unnamed(problem, first, of_nothing)
    if not first.present:
        nothing, odds = terms[0][1] - of_nothing, log_odds(problem, 1)
        effects = first_order(problem).items()
        terms += [(((name,), ""), nothing + v / TEMPERATURE + odds) for name, v in effects]
    else:
        terms += _explained(problem, first, allowed or tried, bool(allowed))
    weights = _summed([key for key, _ in terms], np.array([value for _, value in terms]))
    total = np.logaddexp.reduce([*weights.values()])
    listed = sorted(((np.exp(v - total), k) for k, v in weights.items()), key=lambda i: -i[0])
    kept = [
        ExplanationProbability(effects=effects, nameless=along or None, probability=float(value))
        for value, (effects, along) in listed
        if value >= LEAST_LISTED
    ]
    rest = [float(value) for value, _ in listed if value < LEAST_LISTED]
    if rest:
        kept.append(ExplanationProbability(effects=(), other=len(rest), probability=sum(rest)))
    return tuple(kept)


def _unnamed(problem: SearchProblem, first: Structure, odds: float) -> list[Term]:
    """Nothing first, with these log odds, then nameless structure along each covariate."""
    if problem.independent:
        # scores on visits left out are relative to the base model's, and families have none
        foremost = next(iter(first.foremost()), "distance")
        return [(((), ""), odds), (((), foremost), LOG_NAMELESS_ODDS)]
    nothing = problem.nothing_added[1]
    along = [*nameless(problem, problem.base_linear_fit.left).items()]
    if problem.null_fit.random_walk_gain:
        along.append(("start", problem.unnamed - nothing))
    terms: list[Term] = [(((), ""), nothing / TEMPERATURE + odds)]
    for name, value in along:
        terms.append((((), name), (nothing + value) / TEMPERATURE + LOG_NAMELESS_ODDS))
    return terms


def _explained(
    problem: SearchProblem, first: Structure, explanations: Sequence[Explanation], named: bool
) -> Iterator[Term]:
    """Explanations, a share of each as nameless structure; with more of it in what they leave, if
    none may be `named`.
    """
    log = log_weights(problem, explanations)
    least = np.max(log, where=np.isfinite(log), initial=-np.inf) - NEGLIGIBLE / TEMPERATURE
    share, foremost = NAMED_SHARE if named else REFUSED_SHARE, next(iter(first.foremost()))
    for e, value in zip(explanations, log.tolist(), strict=True):
        if not (named or value >= least):
            continue
        yield (e.effects, ""), value + float(np.log(share))
        yield ((), foremost), value + float(np.log(1 - share))
        if not (named or problem.independent):
            linear_fit = problem.linearised(e.fitted, e.form_sd, e.random_walk_gain)
            for name, gain in nameless(problem, linear_fit.left).items():
                yield ((), name), value + gain / TEMPERATURE + LOG_NAMELESS_ODDS
