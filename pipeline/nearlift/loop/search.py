"""One pass of the search: is there structure, which single effect or pair leaves none, and which of
them are rivals.
"""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Effect, FloatArray
from nearlift.loop import structure, weigh
from nearlift.loop.candidate_fit import Fitted
from nearlift.loop.evidence import CREDIT, PLAIN_2LNB, Explanation
from nearlift.loop.noise_floor import prepare
from nearlift.loop.random_walk_gain import waves
from nearlift.loop.search_problem import SILENT, SearchProblem
from nearlift.loop.structure import Structure
from nearlift.results import IntArray
from nearlift.results.diagnosis import ExplanationProbability
from nearlift.results.quotation import Verdict

#: Pairs that are tried at most, and at least.
PAIRS, FIRST_PAIRS = 40, 8
#: Allowed error of the first-order gain of a pair, as a share and in chi2.
LINEARISATION_SLACK, LINEARISATION_SLACK_CHI2 = 0.1, 10.0
#: Relative singular value below which the first-order gain of a pair ignores a direction.
DETERMINED = 1e-8
#: A gain in chi2 beyond this many times the number of trials is large against the noise.
LARGE = 0.3
#: Log evidence by which an explanation on a `Shortlist` may trail: first order is not exact.
SLACK = 3.0
#: Share of the structure's excess chi2, and log Bayes factor over the null, from which an effect is
#: accepted although its form is inexact; its form's uncertainty is then multiplied by the last.
NEARLY_ALL, PLAIN, LOOSER = 0.8, 15.0, 2.0
#: Explanations to try, each the names of its effects.
Shortlist = frozenset[tuple[str, ...]]


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Relative held-out residuals of every trial, nan where it cannot be predicted.

    `before` is by the base model, `after` by the answer of each fold's search (`chosen`). `named`
    is by the explanation found in all visits, refitted in each fold. `visit` holds the
    cross-validation blocks.
    """

    before: FloatArray
    after: FloatArray
    named: FloatArray
    visit: IntArray
    chosen: tuple[str, ...]

    @property
    def predicted(self) -> NDArray[np.bool_]:
        """Mask of the trials that could be predicted."""
        return np.isfinite(self.before) & np.isfinite(self.after)


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Outcome of a search.

    `singles` and `pairs` are all explanations that were tried. `allowed` are those that may be
    named, `accepted` the set of rivals among these, the likeliest first.

    Cross-validation adds the held-out residuals `scored`, and `refuted`, the explanations that they
    do not confirm. `contradicted` lists the evidence against a base model without residual
    structure.
    """

    problem: SearchProblem
    first: Structure
    singles: tuple[Explanation, ...] = ()
    pairs: tuple[Explanation, ...] = ()
    allowed: tuple[Explanation, ...] = ()
    accepted: tuple[Explanation, ...] = ()
    refuted: tuple[Explanation, ...] = ()
    scored: HeldOut | None = None
    contradicted: tuple[str, ...] = ()

    @property
    def tried(self) -> tuple[Explanation, ...]:
        """All explanations that were tried."""
        return (*self.singles, *self.pairs)

    @property
    def verdict(self) -> Verdict:
        """adequate, effect or unexplained."""
        if not self.first.present:
            return "unexplained" if self.contradicted else "adequate"
        return "effect" if self.accepted else "unexplained"

    @property
    def named(self) -> tuple[str, ...]:
        """The effects of the best explanation, empty where none is accepted."""
        return self.accepted[0].effects if self.accepted else ()

    @property
    def would_name(self) -> tuple[str, ...] | None:
        """Effects that the search names, confirmed or not; None where it finds no structure."""
        named = self.refuted or self.accepted
        return (named[0].effects if named else ()) if self.first.present else None

    @property
    def best(self) -> Fitted:
        """The model to predict with: the best explanation, else the base model."""
        return self.accepted[0].fitted if self.accepted else self.problem.base_fit

    def claimed_below(self, threshold: float) -> Answer:
        """Answer with a claim only if a test's log10 p is below `threshold`."""
        first = dataclasses.replace(self.first, threshold=threshold)
        accepted = self.accepted if first.present else ()
        return dataclasses.replace(self, first=first, accepted=accepted)

    @property
    def random_walk_gain(self) -> float:
        """Root mean square of the random-walk gain of the answer, as a fraction of lift."""
        if not self.first.present:
            return 0.0
        by = self.accepted[0] if self.accepted else self.problem.null_fit
        unit = np.sqrt(np.mean(np.sum(waves(self.problem.data) ** 2, axis=1)))
        return by.random_walk_gain * float(unit)

    def shortlist(self, left_out: NDArray[np.bool_]) -> Shortlist:
        """Explanations that may belong to the set without the trials `left_out` (n,).

        Without those trials an explanation gains, to first order, their share of its misfit.
        """
        dropped = left_out[self.problem.space.covariance.order]

        def without(log: float, fitted: Fitted) -> float:
            return log + 0.5 * float(np.sum(fitted.residual[dropped] ** 2))

        named = self.refuted or self.accepted
        least = (
            max(without(e.log_evidence, e.fitted) for e in named) - PLAIN_2LNB / 2
            if named
            else without(self.problem.unnamed, self.problem.base_fit) + CREDIT
        )
        kept = {e.effects for e in self.tried if without(e.log_evidence, e.fitted) > least - SLACK}
        # a pair is held against what each of its effects accounts for
        return frozenset(kept | {(name,) for names in kept for name in names})

    @cached_property
    def probabilities(self) -> tuple[ExplanationProbability, ...]:
        """Probabilities of everything that was weighed; they sum to 1."""
        allowed, silent = self.allowed if self.accepted else (), self.verdict == "adequate"
        return weigh.weigh(self.problem, self.first, self.tried, allowed, silent)

    @property
    def probability(self) -> float:
        """Probability of the answer: of the named effects, of nameless structure, or of nothing."""
        nameless = self.verdict == "unexplained"
        return sum(
            e.probability
            for e in self.probabilities
            if not e.other and e.effects == self.named and bool(e.nameless) == nameless
        )


def search_to_convergence(problem: SearchProblem, shortlist: Shortlist | None = None) -> Answer:
    """Alternate the search and the noise estimate about the best explanation, at most two repeats.

    The noise is estimated about the best explanation, named or not, if the structure is large
    compared with it, else about the base model. With a `shortlist`, only its explanations are
    tried.
    """
    # new cached values, freed when this search ends
    problem = dataclasses.replace(problem)
    answer = run(problem, shortlist)
    for again in range(2):
        # once taken about an explanation, that of these trials stays so
        about = problem.about if again else None
        best = answer.accepted or sorted(answer.tried, key=lambda e: -e.log_evidence)
        if best and best[0].gain >= LARGE * problem.data.n:
            about = best[0].fitted.candidate, best[0].fitted.vector
        now, before = (one and one[0].effects for one in (about, problem.about))
        if now == before:
            break
        del answer, best
        problem = prepare(dataclasses.replace(problem), about=about)
        answer = run(problem, shortlist)
    return answer


def run(problem: SearchProblem, shortlist: Shortlist | None = None) -> Answer:
    """Test, then single effects, then pairs if no single one will do; those of the `shortlist`, if
    there is one. Once an explanation is accepted, all that may be named are weighed.
    """
    first, _ = problem.nothing_added
    if not first.present:
        return Answer(problem=problem, first=first)
    tried = (
        problem.explain((e,))
        for e in problem.known_effects
        if (not shortlist or (e.name,) in shortlist) and problem.visibility(e) > SILENT
    )
    # one that has no value at some trial, however small, explains nothing
    singles = tuple(s for s in tried if np.isfinite(s.gain))
    if problem.options.pairs and not any(s.accepted for s in singles):
        singles = tuple(_accept_inexact(problem, s) for s in singles)
    # in a pair an effect has the form that is likeliest alone
    alone = {s.fitted.candidate.effects[0]: s for s in singles}
    if shortlist is None:
        offered = promising(problem, alone)
    else:
        offered = [
            (one, two) for one, two in combinations(alone, 2) if (one.name, two.name) in shortlist
        ]
    pairs = tuple(problem.explain(pair, tuple(alone[e] for e in pair)) for pair in offered)
    both = (*singles, *pairs)
    some = any(e.accepted for e in both)
    allowed = tuple(e for e in both if some and e.may_be_named)
    accepted = weigh.credible_set(problem, allowed)
    if len(accepted) == 1:
        accepted = (accepted[0].without_rivals(),)
    answer = Answer(
        problem=problem,
        first=first,
        singles=singles,
        pairs=pairs,
        allowed=allowed,
        accepted=accepted,
    )
    if not accepted:
        return answer
    nameless = sum(e.probability for e in answer.probabilities if e.nameless)
    named = max((e.probability for e in answer.probabilities if e.effects), default=0.0)
    return dataclasses.replace(answer, accepted=()) if nameless > named else answer


def promising(
    problem: SearchProblem, alone: Mapping[Effect, Explanation]
) -> list[tuple[Effect, Effect]]:
    """Pairs of effects that deserve a fit, by their possible gain, largest first.

    `alone` are the explanations by one effect. If one of them is accepted, they are the pairs that
    could gain more than the likeliest by `PLAIN_2LNB`. Else they are the first few, and those that
    could explain most of the remainder of each effect. A gain beyond first order of one effect is
    assumed to persist in its pairs.
    """
    if not problem.options.pairs:
        return []
    projected = pair_gains(problem)
    bent = {e: max(s.gain - projected[e.name, ""], 0.0) for e, s in alone.items()}
    offered = sorted(
        (
            (projected[one.name, two.name] + bent[one] + bent[two], one, two)
            for one, two in combinations(alone, 2)
        ),
        key=lambda pair: -pair[0],
    )[:PAIRS]
    accepted = [s for s in alone.values() if s.accepted]
    if accepted:
        least = max(accepted, key=lambda e: e.log_evidence).gain + PLAIN_2LNB
        return [(one, two) for gain, one, two in offered if gain > least]

    def may_be_needed(gain: float, one: Effect, two: Effect) -> bool:
        most = (1 + LINEARISATION_SLACK) * gain + LINEARISATION_SLACK_CHI2
        base = max(alone[one].gain, alone[two].gain)
        return bool(problem.explains_enough(most - base, problem.excess - base))

    return [
        (one, two)
        for i, (gain, one, two) in enumerate(offered)
        if i < FIRST_PAIRS or may_be_needed(gain, one, two)
    ]


def pair_gains(problem: SearchProblem) -> dict[tuple[str, str], float]:
    """First-order drop of chi2 by two effects next to the coefficients, the largest over their
    shapes.

    Keys are the two names in either order; "" and a name are one effect alone.
    """
    hypotheses, basis = problem.hypotheses
    effects = tuple(h for h in hypotheses if h.effect)
    which, stacked, ranks = structure.bases(effects, problem.absorbed)
    score, product = stacked.T @ (basis.T @ problem.base_fit.residual), stacked.T @ stacked
    shapes = [("", np.arange(0))]
    for i, entries in zip(which, np.split(np.arange(len(score)), np.cumsum(ranks)), strict=False):
        shapes.append((effects[i].effect, entries))
    best: dict[tuple[str, str], float] = defaultdict(float)
    # all pairs with as many columns are solved at once
    by_size = defaultdict(list)
    for (one, left), (two, right) in combinations(shapes, 2):
        by_size[len(left) + len(right)].append(((one, two), np.r_[left, right]))
    for pairs in by_size.values():
        both = np.array([entries for _, entries in pairs])
        inner = product[both[:, :, None], both[:, None, :]]
        solve = np.linalg.pinv(inner, rcond=DETERMINED, hermitian=True)
        gains = np.einsum("ki,kij,kj->k", score[both], solve, score[both])
        for ((one, two), _), gain in zip(pairs, gains.tolist(), strict=True):
            best[one, two] = best[two, one] = max(best[one, two], gain)
    return best


def _accept_inexact(problem: SearchProblem, e: Explanation) -> Explanation:
    """The explanation, accepted if it removes `NEARLY_ALL` of the excess chi2, whatever it leaves.

    Data of a large effect resolve errors of its form that are smaller than any form is known. An
    effect outside the library is excluded by its share: the nearest effect in the library rarely
    removes half of it. An effect that differs by session has no form and imitates any step.
    """
    enough = e.gain >= NEARLY_ALL * problem.excess and e.over_none > PLAIN
    if not enough or e.fitted.candidate.by_session.any():
        return e
    return dataclasses.replace(e, form_sd=LOOSER * e.form_sd, confirmed=True)
