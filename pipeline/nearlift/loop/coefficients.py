"""The model's coefficients before and after, with three intervals that answer three different
questions, and lift far from the boundary.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import information
from nearlift.likelihood import student
from nearlift.likelihood.covariance import group_sums
from nearlift.loop import confirmation, discrepancy, few_visits, weigh
from nearlift.loop.candidate import WIDE
from nearlift.loop.candidate_fit import Fitted, covariance_of
from nearlift.loop.search import Answer
from nearlift.loop.search_problem import SearchProblem
from nearlift.results.diagnosis import LoopCoefficients, LoopEstimate
from nearlift.results.estimate import Estimate

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
    candidate, vector, known = fitted.candidate, fitted.vector, fitted.information(nuisance)
    mean, sd = candidate.prior
    residual = problem.log_lift - candidate.log_ratio(vector)
    step = known.gain @ residual - known.parameter_covariance @ ((vector - mean) / sd**2)
    return np.clip(vector + step, *candidate.bounds), covariance_of(known)


def spread(problem: SearchProblem, fitted: Fitted, nuisance: FloatArray | None = None) -> Pair:
    """Value and standard uncertainty of the base model's coefficients at a fit; as `joint`."""
    return _of_base(problem, *joint(problem, fitted, nuisance))


def _of_base(problem: SearchProblem, value: FloatArray, covariance: FloatArray) -> Pair:
    p = len(problem.theta)
    return value[:p], np.sqrt(np.maximum(np.diag(covariance)[:p], 0))


def constrained_columns(problem: SearchProblem, chosen: tuple[str, ...]) -> FloatArray:
    """Every effect that was not named, at its physical or stated prior's size, as unit-variance
    columns (n, t).
    """
    columns = [np.zeros((problem.data.n, 0))]
    for effect in problem.known_effects:
        if effect.name in chosen:
            continue
        candidate = problem.candidate(effect)
        sd, sizes = candidate.prior[1], candidate.sizes()
        # a search grants more than is physical, but for what differs by session
        physical = np.where(candidate.by_session, sd, sd / WIDE)[sizes]
        shapes = [c for e, c in problem.library if e.name == effect.name]
        # one unknown size whose shape is unknown too: each shape carries its share of the variance
        columns += [c * physical / np.sqrt(len(shapes)) for c in shapes]
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
        Accepted explanations with uncertain form, best first. Without any: the base fit with
        residual structure as random effects, and refused explanations with a probability of at
        least `LEAST_REFUSED`.
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
        over_all = tuple(
            (float(p), float(v[i]), float(s[i]))
            for p, (_, (v, s)) in zip(self.weights, self.members, strict=True)
        )
        return [*dict.fromkeys([over_all, self._alone(i, self.conditional)])]

    def estimates(self) -> LoopCoefficients:
        """The coefficients without and with the named effects."""
        before, after = {}, {}
        for i, name in enumerate(self.names):
            low, high = self._interval90(i, self._alone(i, self.before))
            before[name] = LoopEstimate(value=self.before[0][i], lo90=low, hi90=high)
            low, high = self._interval90(i, *self.readings(i))
            after[name] = LoopEstimate(
                value=self.value[i],
                lo90=low,
                hi90=high,
                conditional=self._interval90(i, self._alone(i, self.conditional)),
                constrained=self._interval90(i, self._alone(i, self.constrained)),
            )
        return LoopCoefficients(before=before, after=after, carried=self.carried)

    def width90(self, i: int) -> float:
        """Width of the 90 % interval of coefficient i, before it is cut at a bound."""
        low, high = student.interval(0.9, self.readings(i), float(self.dof[i]))
        return high - low

    @staticmethod
    def _alone(i: int, pair: Pair) -> student.Mixture:
        return ((1.0, float(pair[0][i]), float(pair[1][i])),)

    def _interval90(self, i: int, *readings: student.Mixture) -> tuple[float, float]:
        interval = student.interval(0.9, readings, float(self.dof[i]))
        low, high = np.clip(interval, *self.bounds[i]).tolist()
        return low, high


def answers(answer: Answer) -> Answers:
    """Coefficients before and after the loop; where visits are few, with jackknife uncertainties
    over visits.
    """
    problem, best = answer.problem, answer.best

    def known_by(fitted: Fitted, nuisance: FloatArray | None = None) -> Pair:
        if not problem.independent:
            return joint(problem, fitted, nuisance)
        return fitted.vector, confirmation.jackknife(few_visits.without_each(problem, fitted))

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
            for e in answer.tried
            if p.effects == e.effects and p.probability >= LEAST_REFUSED
        ]
        fits += [(e.name, e.fitted, e.form_discrepancy) for e, _ in refused]
        shares = np.array([p for _, p in refused])
        weights = np.r_[1 - shares.sum(), shares]
    known = [known_by(fitted, nuisance) for _, fitted, nuisance in fits]
    members = tuple(
        (name, _of_base(problem, *k)) for (name, _, _), k in zip(fits, known, strict=True)
    )
    unseen = np.hstack([fits[0][2], constrained_columns(problem, answer.named)])
    exactly, constrained = spread(problem, best), spread(problem, best, unseen)
    if problem.independent:
        # the jackknife over visits does not show the variance from undetected effects
        value, u = members[0][1]
        hidden = np.maximum(constrained[1] ** 2 - exactly[1] ** 2, 0.0)
        constrained = value, np.sqrt(u**2 + hidden)
        dof = few_visits.freedom(problem, best)[: len(u)]
    else:
        space = problem.whitening(problem.parts, problem.slope)
        jacobian = space.jacobian(problem.base_fit.vector[: len(problem.theta)])
        gain = information.joint_information(space, jacobian).gain
        lines = information.lines(space, gain, problem.parts, problem.noise, problem.slope)
        dof = information.effective_dof(lines, problem.noise)
    return Answers(
        names=tuple(q.name for q in problem.base.parameters),
        bounds=tuple(q.bounds for q in problem.base.parameters),
        dof=dof,
        before=_of_base(problem, *known_by(problem.base_fit)),
        members=members,
        weights=weights,
        conditional=members[0][1] if carried or problem.independent else exactly,
        constrained=constrained,
        carried=carried,
        unnamed=unnamed,
        covariance=known[0][1],
    )


def far_lift(problem: SearchProblem, fitted: Fitted, nuisance: FloatArray) -> dict[float, Estimate]:
    """L_inf at each throttle, in the average conditions of the trials at that throttle.

    Effects that act far away, such as a sagging supply, are included at their mean over those
    trials. `nuisance` (n, t) are columns of further unit-variance unknowns. Where trials count as
    independent, the uncertainty is that of a sum over whole visits (a sandwich estimate).
    """
    data, candidate, vector = problem.data, fitted.candidate, fitted.vector
    far = replace(candidate, data=replace(data, z_hat=np.full(data.n, np.inf)))
    known, log_l_inf = fitted.information(nuisance), problem.log_lift - candidate.log_ratio(vector)
    fitted_part = slice(known.levels.start, known.parameters.stop)
    covariance = known.covariance[fitted_part, fitted_part]
    levels = problem.space.best_levels(log_l_inf)
    if problem.independent:
        visits, visit = np.unique(data.visit, return_inverse=True)
        gain = np.vstack([known.level_gain, known.gain])
        sums = group_sums(gain * (log_l_inf - data.level_design @ levels), visit)
        covariance = sums @ sums.T * len(visits) / max(len(visits) - 1, 1)
    change, slope = np.nan_to_num(far.log_ratio(vector)), far.jacobian(vector)
    by_throttle, shown_levels = {}, data.shown(np.eye(data.unknown_levels))
    for k, (throttle, shown) in enumerate(zip(data.levels, shown_levels, strict=True)):
        here = data.level == k
        weight = np.concatenate([shown, slope[here].mean(axis=0)])
        value = float(np.exp(shown @ levels + change[here].mean()))
        u = value * float(np.sqrt(weight @ covariance @ weight))
        by_throttle[float(throttle)] = Estimate(value=value, u=u)
    return by_throttle
