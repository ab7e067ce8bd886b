"""Probability of each explanation, from its evidence and its prior odds.

An explanation is nothing, one effect or two, each with or without a nameless part: a family of the
test for structure, of any size. The evidence of effects is integrated over their declared priors,
that of a family over `RELATIVE_SIZES`. Log evidence is divided by `TEMPERATURE`, since the evidence
of misspecified forms is overconfident (Grunwald and van Ommen 2017, Bayesian Analysis 12, 1069).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import numpy as np

from nearlift.declare import FloatArray
from nearlift.loop import structure
from nearlift.loop.evidence import Integrated
from nearlift.loop.explanation import Explanation
from nearlift.loop.search import Answer
from nearlift.loop.search_problem import SearchProblem
from nearlift.loop.structure import Hypothesis
from nearlift.nomenclature import SCHEDULE_WORDS
from nearlift.results.diagnosis import RIVAL_MAX_2LNB, ExplanationProbability

#: Prior odds of a nameless part; 0.01 to 0.1 differ little (docs/calibration.md).
NAMELESS_ODDS = 0.05
#: Root mean square of a nameless part per trial, in standard deviations of its noise.
RELATIVE_SIZES = np.geomspace(0.03, 1.5, 12)
#: Divisor of log evidence, from tuning campaigns (docs/calibration.md).
TEMPERATURE = 1.0
#: Least probability that is listed by itself.
LEAST_LISTED = 0.005
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


def weigh(answer: Answer) -> tuple[ExplanationProbability, ...]:
    """Probabilities of nothing, each explanation, and nameless structure along each covariate.

    An explanation that the search does not allow to be named counts as nameless structure along
    what it leaves. So does one that would need a nameless part. The likeliest are first; those
    below `LEAST_LISTED` are summed at the end.
    """
    from scipy.special import softmax

    weighed = _terms(answer)
    probability = softmax(
        [log_evidence / TEMPERATURE + log_odds for _, log_evidence, log_odds in weighed]
    )
    total: dict[Key, float] = defaultdict(float)
    for (key, _, _), value in zip(weighed, probability, strict=True):
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


def probability_of(answer: Answer, listed: tuple[ExplanationProbability, ...]) -> float:
    """Probability of the answer: of the named effects, of any nameless structure, or of nothing."""
    named = answer.accepted[0].effects if answer.accepted else ()
    return sum(
        e.probability
        for e in listed
        if not e.other
        and e.effects == named
        and bool(e.nameless) == (answer.verdict == "unexplained")
    )


def _terms(answer: Answer) -> list[Term]:
    """Log evidence and log prior odds of everything that is weighed."""
    problem = answer.problem
    effects = max(len({e.name for e, _ in problem.library}), 2)
    single = -float(np.log(effects))
    pair = single - RIVAL_MAX_2LNB / 2 - float(np.log((effects - 1) / 2))
    unnamed = float(np.log(NAMELESS_ODDS))
    if problem.independent:
        nothing, along = 0.0, {next(iter(answer.first.foremost()), "distance"): 0.0}
    else:
        nothing = problem.nothing_added[1]
        along = nameless(problem, problem.base_linear_fit.left)
    terms: list[Term] = [(((), ""), nothing, 0.0)]
    terms += [(((), name), nothing + value, unnamed) for name, value in along.items()]
    if problem.null_fit.random_walk_gain and not problem.independent:
        terms.append((((), "start"), problem.unnamed, unnamed))
    if not answer.first.present:
        return terms + [
            (((name,), ""), nothing + value, single) for name, value in first_order(problem).items()
        ]
    tried = [e for e in (*answer.singles, *answer.pairs) if np.isfinite(e.evidence.log)]
    least = max((e.evidence.log for e in tried), default=0.0) - NEGLIGIBLE
    for e in (e for e in tried if e.evidence.log >= least):
        log, odds = e.evidence.log, single if len(e.effects) == 1 else pair
        left = along
        if not problem.independent:
            linear_fit = problem.linearised(e.fitted, e.form_sd, e.random_walk_gain)
            left = nameless(problem, linear_fit.left)
            terms += [(((), name), log + value, odds + unnamed) for name, value in left.items()]
        if _may_be_named(answer, e):
            terms.append(((e.effects, ""), log, odds))
        else:
            terms.append((((), max(left, key=left.__getitem__)), log, odds))
    return terms


def _may_be_named(answer: Answer, e: Explanation) -> bool:
    """Whether an explanation is in the set of the answer, or might be if it were likelier."""
    if any(e.effects == other.effects for other in answer.accepted):
        return True
    return bool(answer.accepted) and e.eligible_as_rival and e.tenable
