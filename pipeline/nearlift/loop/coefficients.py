"""The model's coefficients before and after, with three intervals that answer three different
questions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nearlift.declare import Effect, FloatArray
from nearlift.fit import information
from nearlift.likelihood import student
from nearlift.likelihood.subspace import left_singular, orthonormal
from nearlift.loop import confirmation, discrepancy, few_visits, weigh
from nearlift.loop.candidate import WIDE
from nearlift.loop.candidate_fit import Fitted, inverse
from nearlift.loop.power import size_parameters
from nearlift.loop.search import Answer
from nearlift.loop.search_problem import SearchProblem
from nearlift.results.diagnosis import LoopCoefficients, LoopEstimate
from nearlift.results.outlook import SilentEffect

#: Least probability with which a refused explanation is part of an `unexplained` interval.
LEAST_REFUSED = 0.05
#: Values and standard uncertainties of the coefficients, (p,) each.
Pair = tuple[FloatArray, FloatArray]


def joint(
    problem: SearchProblem, fitted: Fitted, nuisance: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Everything fitted, (P,), and its covariance (P, P), in the order of the candidate's slots.

    `nuisance` (n, t) are columns of further unit-variance unknowns, such as the form or undetected
    effects. They widen the covariance. The values move to their new optimum by one Gauss-Newton
    step, within the bounds.
    """
    if nuisance is None or not nuisance.shape[1]:
        return fitted.vector, fitted.covariance
    mean, sd = fitted.candidate.prior
    weight2 = 1 / sd**2
    j, r = fitted.jacobian, fitted.residual
    u, s = left_singular(problem.space.project(nuisance.T).T)
    j_solved = j - u @ ((s**2 / (1 + s**2))[:, None] * (u.T @ j))
    covariance = inverse(j.T @ j_solved + np.diag(weight2))
    step = covariance @ (j_solved.T @ r - weight2 * (fitted.vector - mean))
    return np.clip(fitted.vector + step, *fitted.candidate.bounds), covariance


def spread(
    problem: SearchProblem, fitted: Fitted, nuisance: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Value and standard uncertainty of the base model's coefficients at a fit; as `joint`."""
    value, covariance = joint(problem, fitted, nuisance)
    p = len(problem.theta)
    return value[:p], np.sqrt(np.maximum(np.diag(covariance)[:p], 0))


def constrained_columns(problem: SearchProblem, chosen: tuple[str, ...]) -> FloatArray:
    """Every effect that was not named, at its physical or stated prior's size, as unit-variance
    columns (n, t).
    """
    columns = [np.zeros((problem.data.n, 0))]
    for effect in {e.name: e for e, _ in problem.library}.values():
        if effect.name in chosen:
            continue
        candidate = problem.candidate(effect)
        _, sd = candidate.prior
        sizes = candidate.sizes()
        # a search grants more than is physical, but for what differs by session
        physical = np.where(candidate.by_session, sd, sd / WIDE)[sizes]
        shapes = [c for e, c in problem.library if e.name == effect.name]
        # one unknown size whose shape is unknown too: each shape carries its share of the variance
        for c in shapes:
            columns.append(c * physical / np.sqrt(len(shapes)))
    return np.hstack(columns)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """The p coefficients under each explanation, as value and standard uncertainty: two arrays
    (p,).

    Attributes
    ----------
    names : tuple of str
    bounds : tuple of (float, float)
        Declared range of each coefficient; an interval ends there.
    dof : (p,)
        Degrees of freedom behind the uncertainties.
    before : pair of arrays
        By the base fit alone.
    members : tuple of (str, pair of arrays)
        Accepted explanations with uncertain form, best first; else the base fit with residual
        structure as random effects, and the explanations that were refused with a probability of
        at least `LEAST_REFUSED`.
    weights : (m,)
        Relative probability of each member.
    conditional : pair of arrays
        If the best answer is exactly true.
    constrained : pair of arrays
        With every unidentified effect as a nuisance of its physical size.
    carried : tuple of str
        The covariates of residual structure that is included as random effects.
    unnamed : (n, t)
        Columns of log lift of these random effects, with unknowns of unit variance.
    covariance : (P, P)
        Of everything that the best answer fits, its form uncertain.
    """

    names: tuple[str, ...]
    bounds: tuple[tuple[float, float], ...]
    dof: FloatArray
    before: Pair
    members: tuple[tuple[str, Pair], ...]
    weights: FloatArray
    conditional: Pair
    constrained: Pair
    carried: tuple[str, ...] = ()
    unnamed: FloatArray
    covariance: FloatArray

    @property
    def value(self) -> FloatArray:
        """The values quoted: the mean over rivals, so that nothing jumps where two of them change
        places; the base fit's where nothing is named.
        """
        if self.carried:
            return self.members[0][1][0]
        return np.average([value for _, (value, _) in self.members], axis=0, weights=self.weights)

    def readings(self, i: int) -> list[student.Mixture]:
        """Coefficient i over all members, and by the best answer if that is exactly true."""
        value, u = self.conditional
        over_all = tuple(
            (float(p), float(v[i]), float(s[i]))
            for p, (_, (v, s)) in zip(self.weights, self.members, strict=True)
        )
        return [*dict.fromkeys([over_all, ((1.0, float(value[i]), float(u[i])),)])]

    def estimates(self) -> LoopCoefficients:
        """The coefficients without and with the named effects."""
        before, after = {}, {}
        for i, name in enumerate(self.names):
            low, high = self._interval90(i, self.before)
            before[name] = LoopEstimate(value=self.before[0][i], lo90=low, hi90=high)
            low, high = self._ends90(i, self.readings(i))
            after[name] = LoopEstimate(
                value=self.value[i],
                lo90=low,
                hi90=high,
                conditional=self._interval90(i, self.conditional),
                constrained=self._interval90(i, self.constrained),
            )
        return LoopCoefficients(before=before, after=after, carried=self.carried)

    def width90(self, i: int) -> float:
        """Width of the 90 % interval of coefficient i, before it is cut at a bound."""
        low, high = student.interval(0.9, self.readings(i), float(self.dof[i]))
        return high - low

    def _interval90(self, i: int, pair: Pair) -> tuple[float, float]:
        return self._ends90(i, [((1.0, float(pair[0][i]), float(pair[1][i])),)])

    def _ends90(self, i: int, readings: list[student.Mixture]) -> tuple[float, float]:
        interval = student.interval(0.9, readings, float(self.dof[i]))
        low, high = np.clip(interval, *self.bounds[i]).tolist()
        return low, high


def answers(answer: Answer) -> Answers:
    """Coefficients before and after the loop; where visits are few, with jackknife uncertainties
    over visits.
    """
    problem, best, p = answer.problem, answer.best, len(answer.problem.theta)

    def known_by(fitted: Fitted, form_discrepancy: FloatArray | None = None) -> Pair:
        if not problem.independent:
            return joint(problem, fitted, form_discrepancy)
        return fitted.vector, confirmation.jackknife(few_visits.without_each(problem, fitted))

    def coefficients(known: Pair) -> Pair:
        value, covariance = known
        return value[:p], np.sqrt(np.maximum(np.diag(covariance)[:p], 0))

    carried: tuple[str, ...] = ()
    unnamed = np.zeros((problem.data.n, 0))
    if answer.verdict == "unexplained" and not problem.independent:
        # structure without a name is no noise: it is carried, and biases the base fit
        carried = tuple(discrepancy.covariates(answer.first)) or ("distance",)
        unnamed = discrepancy.columns(problem, carried)
    fits = [(e.name, e.fitted, e.form_discrepancy) for e in answer.accepted] or [
        ("", problem.base_fit, unnamed)
    ]
    weights = weigh.relative(problem, answer.accepted) if answer.accepted else np.ones(1)
    if carried:
        refused = [
            (e, p.probability)
            for p in answer.probabilities
            for e in (*answer.singles, *answer.pairs)
            if p.effects == e.effects and p.probability >= LEAST_REFUSED
        ]
        fits += [(e.name, e.fitted, e.form_discrepancy) for e, _ in refused]
        shares = np.array([p for _, p in refused])
        weights = np.r_[1 - shares.sum(), shares]
    known = [known_by(fitted, form_discrepancy) for _, fitted, form_discrepancy in fits]
    members = tuple((name, coefficients(k)) for (name, _, _), k in zip(fits, known, strict=True))
    chosen = answer.accepted[0].effects if answer.accepted else ()
    unseen = np.hstack([fits[0][2], constrained_columns(problem, chosen)])
    exactly, constrained = spread(problem, best), spread(problem, best, unseen)
    if problem.independent:
        # the jackknife over visits does not show the variance from undetected effects
        value, u = members[0][1]
        hidden = np.maximum(constrained[1] ** 2 - exactly[1] ** 2, 0.0)
        constrained = value, np.sqrt(u**2 + hidden)
    return Answers(
        names=tuple(q.name for q in problem.base.parameters),
        bounds=tuple(q.bounds for q in problem.base.parameters),
        dof=np.full(p, few_visits.freedom(problem)) if problem.independent else _freedom(problem),
        before=coefficients(known_by(problem.base_fit)),
        members=members,
        weights=weights,
        conditional=members[0][1] if carried or problem.independent else exactly,
        constrained=constrained,
        carried=carried,
        unnamed=unnamed,
        covariance=known[0][1],
    )


def _freedom(problem: SearchProblem) -> FloatArray:
    """Effective degrees of freedom of the base fit's coefficients, (p,)."""
    g = np.zeros((0, problem.data.n))
    space = problem.whitening(problem.parts, problem.slope)
    if len(problem.theta):
        g = information.gain(space, problem.base_fit.vector[: len(problem.theta)])
    return information.freedom(space, g, problem.parts, problem.noise, problem.slope)


def silent(
    problem: SearchProblem, effects: tuple[Effect, ...], limit: float
) -> tuple[SilentEffect, ...]:
    """Effects that the coefficients and L_inf absorb, and the bias by undetected ones.

    `bias_at_detection_limit` is the shift of the headline coefficient in its own standard
    uncertainties. The effect is at the detection limit (non-centrality 16), or at its physical
    prior's size if it can never be detected. `u` is that uncertainty, of the base fit under the
    loop's noise floor; the one in fit.json has the noise of repeats.
    """
    if not problem.base.parameters:
        return ()
    names = [p.name for p in problem.base.parameters]
    space = problem.whitening(problem.parts, problem.slope)
    jacobian = space.project(problem.base_fit.candidate.jacobian(problem.base_fit.vector).T).T
    jacobian = jacobian[:, : len(names)]
    basis, covariance = orthonormal(jacobian), inverse(jacobian.T @ jacobian)
    u = np.sqrt(np.diag(covariance))

    def described(effect: Effect, by: str, share: float, bias: float, hidden: bool) -> SilentEffect:
        return SilentEffect(
            effect=effect.name,
            absorbed_by=by,
            share_visible=share,
            bias_at_detection_limit=bias,
            in_units_of=f"u({names[0]})",
            u=float(u[0]),
            u_of="base fit, noise floor of the loop",
            hidden=hidden,
        )

    unseen = []
    for effect in effects:
        if effect not in problem.effects and not effect.within_trial:
            unseen.append(described(effect, "L_inf", 0.0, 0.0, hidden=True))
        columns = [c for e, c in problem.library if e.name == effect.name and c.shape[1] == 1]
        if not columns:
            continue
        white = space.project(columns[0].T).T[:, 0]
        if np.linalg.norm(white) == 0:
            continue
        share = problem.visibility(effect)
        left = white - basis @ (basis.T @ white)
        shift = covariance @ jacobian.T @ white / u
        most = int(np.argmax(np.abs(shift)))
        hidden, size = share < limit, size_parameters(effect)[0].plausible
        if not hidden:
            size = min(4.0 / max(float(np.linalg.norm(left)), 1e-300), size)
        if hidden or abs(shift[most]) * size > 1.0:
            unseen.append(
                described(effect, names[most], share, float(abs(shift[0]) * size), hidden)
            )
    return tuple(sorted(unseen, key=lambda f: -f.bias_at_detection_limit))
