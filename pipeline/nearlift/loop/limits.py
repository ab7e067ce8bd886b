"""Limits of a campaign: coefficients that one visit or gains per session determine, and undetected
effects that bias them.
"""

from __future__ import annotations

import numpy as np

from nearlift import catalogue
from nearlift.declare import Effect
from nearlift.fit.information import joint_information
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.candidate_fit import Fitted, covariance_of
from nearlift.loop.families import indicators
from nearlift.loop.few_visits import visits_are_few
from nearlift.loop.power import size_parameters
from nearlift.loop.search_problem import SearchProblem
from nearlift.results.diagnosis import CoefficientLimit
from nearlift.results.outlook import NextExperiment, SilentEffect

#: Share of a coefficient's information from one distance that makes it depend on that distance.
SINGLE_VISIT_SHARE = 0.5
#: Share of a coefficient's information that remains with a gain for each session or visit. Below
#: it the gain absorbs the coefficient.
ABSORBED = 0.01
#: Standardised length of the visible part of an effect at its detection limit.
DETECTED = 4.0


def unidentifiable_coefficients(
    problem: SearchProblem, best: Fitted
) -> tuple[CoefficientLimit, ...]:
    """Coefficients that a single visit determines, or that gains per session absorb, at a fit.

    Gains per visit are used where visits are few. Trials may be measured or planned.
    """
    jacobian, data, limits = best.jacobian, problem.data, []
    others = orthonormal(np.delete(jacobian, np.arange(len(problem.theta)), axis=1))
    places, station = np.unique(data.z_hat, return_inverse=True)
    gain = next(
        e.name for e in catalogue.effects() if e.varies_with == "session" and not e.additive
    )
    # a visit always holds one distance: a gain per visit is tried only where visits are few
    levelled = {"session": data.session} | ({"visit": data.visit} if visits_are_few(data) else {})
    for name, column in zip((p.name for p in problem.base.parameters), jacobian.T, strict=False):
        slope = column - others @ (others.T @ column)
        if not slope @ slope > 0:
            continue
        energy = np.bincount(station[problem.space.covariance.order], slope**2)
        most = int(np.argmax(energy))
        share, where = float(energy[most] / energy.sum()), float(places[most])
        if share >= SINGLE_VISIT_SHARE and len(np.unique(data.visit[station == most])) == 1:
            text = (
                f"{name} depends on a single visit at z_hat = {where:.3g}, which has"
                f" {100 * share:.0f} % of the information."
            )
            rests_on = {"z_hat": where}
            limits.append(
                CoefficientLimit(coefficient=name, rests_on=rests_on, share=share, text=text)
            )
        for label, values in levelled.items():
            basis = orthonormal(problem.space.project(indicators(values).T).T)
            left = column - basis @ (basis.T @ column)
            share = float(left @ left) / float(column @ column)
            if share < ABSORBED and len(np.unique(values)) > 1:
                text = (
                    f"{name} and a gain for every {label} ({gain}) are not distinguishable: no"
                    f" {label} has more than one distance."
                )
                limits.append(
                    CoefficientLimit(coefficient=name, absorbed_by=gain, share=share, text=text)
                )
                break
    return tuple(limits)


def visits_to_add(limits: tuple[CoefficientLimit, ...]) -> tuple[NextExperiment, ...]:
    """Visits to add where one distance determines coefficients or session gains absorb them."""
    experiments = []
    for limit in limits:
        if limit.absorbed_by:
            other = limit.absorbed_by
            measure = (
                "several distances within each session, in random order, so that a session's"
                " gain shifts them all alike"
            )
        else:
            z_hat = (limit.rests_on or {})["z_hat"]
            other = f"the one visit at z_hat = {z_hat:.2g}"
            measure = f"more visits around z_hat = {z_hat:.2g}, in other sessions"
        experiments.append(NextExperiment(separates=(limit.coefficient, other), measure=measure))
    return tuple(experiments)


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
    jacobian = problem.base_fit.candidate.jacobian(problem.base_fit.vector)[:, : len(names)]
    known, basis = joint_information(space, jacobian), orthonormal(space.project(jacobian.T).T)
    u = np.sqrt(np.diag(covariance_of(known)))
    # effect, what absorbs it, its visible share, the headline's bias, and whether it is hidden
    unseen: list[tuple[Effect, str, float, float, bool]] = []
    for effect in effects:
        if effect not in problem.effects and not effect.within_trial:
            unseen.append((effect, "L_inf", 0.0, 0.0, True))
        columns = [c for e, c in problem.library if e.name == effect.name and c.shape[1] == 1]
        white = space.project(columns[0].T)[0] if columns else np.zeros(1)
        if not np.any(white):
            continue
        share = problem.visibility(effect)
        left = white - basis @ (basis.T @ white)
        shift = known.gain @ columns[0][:, 0] / u
        most = int(np.argmax(np.abs(shift)))
        hidden, size = share < limit, size_parameters(effect)[0].plausible
        if not hidden:
            size = min(DETECTED / max(float(np.linalg.norm(left)), 1e-300), size)
        if hidden or abs(shift[most]) * size > 1.0:
            bias = float(abs(shift[0]) * size)
            unseen.append((effect, names[most], share, bias, hidden))
    return tuple(
        SilentEffect(
            effect=effect.name,
            absorbed_by=by,
            share_visible=share,
            bias_at_detection_limit=bias,
            u=float(u[0]),
            hidden=hidden,
        )
        for effect, by, share, bias, hidden in sorted(unseen, key=lambda row: -row[3])
    )
