"""Result to quote after the loop: the coefficients over all accepted answers, with budget,
influence, doubts, and the sizes of the identified effects.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit import information
from nearlift.fit.density import Density
from nearlift.fit.estimator import Estimator, largest
from nearlift.fit.posterior import Posterior
from nearlift.fit.solver import solve
from nearlift.likelihood import budget, student
from nearlift.likelihood.problem import Likelihood
from nearlift.loop import few_visits
from nearlift.loop.candidate import Candidate
from nearlift.loop.coefficients import Answers, Pair
from nearlift.loop.search import Answer
from nearlift.results.diagnosis import LoopError, NamedEffect
from nearlift.results.quotation import (
    BoundaryResult,
    Correlation,
    Doubt,
    HeldOutError,
    IdentifiedSize,
)
from nearlift.rounding import like

#: Standard uncertainties within which the coefficients' density is linear in the effects.
LINEAR = 8.0
#: Difference of an end of a 90 % interval from the posterior's, in standard uncertainties, from
#: which it is stated: twice the Monte Carlo error of 4000 draws.
SAME_END = 0.05
#: Factor of the size that is quoted, where it is not 1: a drift is from the middle of the campaign.
FACTORS = {"drift": 2.0}


def result(
    answer: Answer, answers: Answers, effects: tuple[NamedEffect, ...], error: LoopError | None
) -> BoundaryResult:
    """The boundary's part of results.json; `answers` holds the coefficients under every answer,
    `effects` the identified effects, `error` the cross-validated error.
    """
    problem, estimator = answer.problem, _estimator(answer, answers)
    rivals = (name for e in answer.accepted[1:] for name in e.effects if name not in answer.named)
    # refits at other exponents have no jackknife: their intervals would be those of trials
    doubts = estimator.doubts(exponents=not problem.independent)
    which = (
        f"choice between {len(answers.members)} explanations"
        if len(answers.members) > 1
        else "shift by the form"
    )
    coefficients = {
        name: estimator.quoted(
            i,
            answers.readings(i),
            _holds(answer, answers),
            [*_doubts(estimator, answer, answers, i), *doubts[i]],
            which,
            max(len(answer.accepted), 1),
        )
        for i, name in enumerate(answers.names)
    }
    if problem.independent:
        # by refits: the visit whose omission moves the fit most
        moved = few_visits.without_each(problem, answer.best) - answer.best.vector
        visits, z_hat = problem.data.visit, problem.data.z_hat
        for i, (name, quoted) in enumerate(coefficients.items()):
            most = largest(np.unique(visits), moved[:, i], visits, z_hat)
            influence = dataclasses.replace(quoted.influence, visit=most)
            coefficients[name] = dataclasses.replace(quoted, influence=influence)
    held_out = None
    if error is not None:
        before, after = error.before.held_out_rmse, error.after.held_out_rmse
        held_out = HeldOutError(before=before, after=after, noise_floor=error.noise_floor)
    return BoundaryResult(
        verdict=answer.verdict,
        base_model=problem.base.name,
        effects=answer.named,
        forms={e.name: e.form for e in answer.best.candidate.effects if e.form} or None,
        rivals=tuple(dict.fromkeys(rivals)),
        probability=answer.probability,
        coefficients=coefficients,
        error=held_out,
        sizes=sizes(answer, effects),
        correlation=_correlation(answer.best.candidate, answers.covariance),
    )


def sizes(answer: Answer, effects: tuple[NamedEffect, ...]) -> tuple[IdentifiedSize, ...]:
    """Sizes of the identified effects, without the parameters of their form."""
    fitted, listed = answer.best, []
    forms = {s.parameter.name for s in fitted.candidate.slots if s.parameter.grid}
    for effect, named in zip(fitted.candidate.effects, effects, strict=True):
        lift = np.exp(fitted.candidate.contribution(fitted.vector, effect))
        for name, e in named.parameters.items():
            plain = name.partition("[")[0]
            if plain in forms:
                continue
            scale = FACTORS.get(plain, 1.0)
            listed.append(
                IdentifiedSize(
                    effect=effect.name,
                    parameter=name,
                    value=scale * e.value,
                    lo90=scale * e.lo90,
                    hi90=scale * e.hi90,
                    unit=effect.parameter(plain).size_unit or e.unit or "1",
                    lift_percent=100 * float(lift.max() - lift.min()),
                )
            )
    return tuple(listed)


def _correlation(candidate: Candidate, covariance: FloatArray) -> Correlation:
    """Correlation of the parameters that all sessions share; zero where one does not vary."""
    places = {s.parameter.name: s.start for s in candidate.slots if s.stop - s.start == 1}
    entries = list(places.values())
    values = information.correlation(covariance[np.ix_(entries, entries)]).tolist()
    return Correlation(parameters=tuple(places), values=tuple(tuple(row) for row in values))


def _holds(answer: Answer, answers: Answers) -> str:
    """Sentence on the errors that an interval includes."""
    named, by_visits = " and ".join(answer.named), answer.problem.independent
    errors = ["trial noise", *budget.stated(answer.problem.parts)]
    if by_visits:
        errors = [f"the scatter of whole visits ({answers.dof.min():.2g} degrees of freedom)"]
    if answers.carried:
        errors.append(f"the unexplained dependence on {' and '.join(answers.carried)}")
    if named and not by_visits:
        errors.append(f"the uncertainty of the {named} correction")
    if len(answers.members) > 1:
        errors.append("the choice between rivals")
    included = f"Includes {', '.join(errors[:-1])}{' and ' if errors[1:] else ''}{errors[-1]}"
    if named and by_visits:
        return f"{included}, with {named} in the model"
    if answer.verdict == "unexplained" and not answers.carried:
        return f"{included}, not the unexplained structure"
    return included


def _doubts(estimator: Estimator, answer: Answer, answers: Answers, i: int) -> list[Doubt]:
    """The coefficient under each answer alone, and with undetected effects."""

    def at(condition: str, pair: Pair, explanation: str | None = None) -> Doubt:
        doubt = estimator.doubt(i, condition, float(pair[0][i]), float(pair[1][i]))
        return dataclasses.replace(doubt, explanation=explanation)

    listed, others = [], answers.members[1:]
    if answer.accepted:
        best = answer.accepted[0].name
        listed.append(at(f"{best} alone, exactly in its stated form", answers.conditional, best))
        listed += [at(f"{name} instead of {best}", pair, name) for name, pair in others]
    if answers.carried:
        listed += [at(f"{name} as the explanation", pair) for name, pair in others]
    if answer.verdict != "adequate":
        listed.append(at("base model without any effect", answers.before))
    listed.append(at("every undetected effect at its plausible size", answers.constrained))
    return listed


def _estimator(answer: Answer, answers: Answers) -> Estimator:
    """The best answer's, linearised about the values quoted: its effects, their form and what has
    no name are unknowns in the covariance.
    """
    problem, p = answer.problem, len(answers.names)
    value, u = answers.value, answers.members[0][1][1]
    low, high = answer.best.candidate.bounds
    likelihood, unknowns = _marginal_likelihood(answer, answers)
    gain = information.joint_information(likelihood, likelihood.jacobian(value)).gain
    if problem.independent:
        # the only line of coefficients whose covariance comes from repeats as a whole
        name = "visits left out in turn"
        lines = [information.Line(name, u**2, unit="", scope="", distribution="")]
    else:
        lines = information.lines(
            likelihood, gain, problem.parts, problem.noise, problem.slope, unknowns
        )
    return Estimator(
        problem=likelihood,
        theta=value,
        u=u,
        dof=answers.dof,
        gain=gain,
        lines=lines,
        parts=problem.parts,
        slope=problem.slope,
        fixed=(value <= low[:p]) | (value >= high[:p]) | ~np.isfinite(u),
    )


def posterior_density(answer: Answer, answers: Answers) -> Density | None:
    """Posterior density of the coefficients by the best answer; None where nothing is free.

    Effects' parameters, uncertain forms and stated uncertainties are integrated out, to first order
    about the fit. The density is zero beyond `LINEAR` standard uncertainties, where that is no
    guide: an effect's linearised part may fit as well without any near-boundary lift. Where visits
    are few, its curvature is from the jackknife's covariance.
    """
    if not answers.names:
        return None
    problem, _ = _marginal_likelihood(answer, answers)
    value, u = answers.members[0][1]
    centre, _ = solve(problem, value, quoted=True)
    dof = max(float(answers.dof.min()), information.LEAST_DOF)
    if not answer.problem.independent:
        return Density(problem=problem, centre=centre, dof=dof, reach=LINEAR * u)
    p, known = len(u), information.joint_information(problem, problem.jacobian(centre))
    stated = answers.covariance[:p, :p]
    if not (known.determined.all() and np.isfinite(stated).all() and np.all(u > 0)):
        return None
    working, jackknife = map(np.linalg.cholesky, (known.parameter_covariance, stated))
    return Density(
        problem=problem,
        centre=centre,
        dof=dof,
        reach=LINEAR * u * student.quantile(0.95, dof) / student.NORMAL_90,
        curvature=np.asarray(working @ np.linalg.inv(jackknife), dtype=np.float64),
    )


def with_posterior(quoted: BoundaryResult, drawn: Posterior) -> BoundaryResult:
    """The result with the posterior's interval added to `holds` where it differs by `SAME_END` from
    the quoted one. Causes are the effect's exact form, rivals, the prior, or the model's curvature.
    """
    coefficients = dict(quoted.coefficients)
    for i, (name, c) in enumerate(quoted.coefficients.items()):
        low, high = drawn.quantiles(i, (0.05, 0.95))
        apart = max(abs(low - c.lo90), abs(high - c.hi90))
        if np.isfinite(apart) and apart > SAME_END * c.u:
            ends = f"{like(low, c.u)} to {like(high, c.u)}"
            why = "alone" if quoted.effects else "with prior and curvature"
            holds = f"{c.holds} Posterior {why}: 90 % {ends}."
            coefficients[name] = dataclasses.replace(c, holds=holds)
    return dataclasses.replace(quoted, coefficients=coefficients)


def _marginal_likelihood(answer: Answer, answers: Answers) -> tuple[Likelihood, dict[str, slice]]:
    """Likelihood of the coefficients alone, and the columns of each source in its covariance.

    Effect sizes and discrepancies are marginalised into that covariance.
    """
    problem, p = answer.problem, len(answers.names)
    candidate, vector = answer.best.candidate, answer.best.vector
    data = dataclasses.replace(problem.data, lift_N=np.exp(problem.log_lift))
    jacobian, (mean, sd) = candidate.jacobian(vector), candidate.prior
    base = Candidate(base=problem.base, effects=(), data=problem.data)
    shift = (
        candidate.log_ratio(vector)
        - base.log_ratio(vector[:p])
        - jacobian[:, p:] @ (vector - mean)[p:]
    )
    further: dict[str, FloatArray] = {}
    if candidate.effects:
        mine = np.concatenate([candidate.entries_of(e.name) for e in candidate.effects])
        independent = problem.independent or not answer.accepted
        nuisances = {} if independent else answer.accepted[0].nuisances
        # an error of the form is taken up by the size: one source
        form = nuisances.pop(f"form of {candidate.name}", np.zeros((problem.data.n, 0)))
        of = "size and form" if form.shape[1] else "size"
        further[f"{of} of {candidate.name}"] = np.hstack([jacobian[:, mine] * sd[mine], form])
        further |= nuisances
    if answers.carried:
        further[f"unexplained structure along {' and '.join(answers.carried)}"] = answers.unnamed
    slope = problem.slope
    if candidate.at_datum.any():
        slope = jacobian[:, candidate.at_datum][:, 0]
    space = problem.whitening(problem.parts, slope)
    shared, unknowns = space.covariance.shared, {}
    for name, columns in further.items():
        if columns.shape[1]:
            unknowns[name] = slice(shared.shape[1], shared.shape[1] + columns.shape[1])
            shared = np.hstack([shared, columns])
    covariance = dataclasses.replace(space.covariance, shared=shared)
    return Likelihood(model=problem.base, data=data, covariance=covariance, shift=shift), unknowns
