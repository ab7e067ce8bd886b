"""Coefficients that single visits or session gains determine, in numbers and in words."""

from __future__ import annotations

import numpy as np

from nearlift import catalogue
from nearlift.likelihood.subspace import orthonormal
from nearlift.loop.candidate_fit import Fitted
from nearlift.loop.families import indicators
from nearlift.loop.few_visits import applies
from nearlift.loop.search_problem import SearchProblem
from nearlift.results.diagnosis import CoefficientLimit

#: Share of a coefficient's information from one distance that makes it depend on that distance.
SINGLE_VISIT_SHARE = 0.5
#: Share of a coefficient's information that remains with a gain for each session or visit. Below
#: it the gain absorbs the coefficient.
ABSORBED = 0.01


def unidentifiable_coefficients(
    problem: SearchProblem, best: Fitted
) -> tuple[CoefficientLimit, ...]:
    """Coefficients that a single visit determines, or that gains per session absorb, at a fit.

    Gains per visit are used where visits are few. Trials may be measured or planned.
    """
    jacobian = best.jacobian
    others = orthonormal(np.delete(jacobian, np.arange(len(problem.theta)), axis=1))
    places, station = np.unique(problem.data.z_hat, return_inverse=True)
    absorbing = []
    gain = next(
        e.name for e in catalogue.effects() if e.varies_with == "session" and not e.additive
    )
    for i, parameter in enumerate(problem.base.parameters):
        slope = jacobian[:, i] - others @ (others.T @ jacobian[:, i])
        whole = float(slope @ slope)
        if whole <= 0:
            continue
        energy = np.bincount(station[problem.space.covariance.order], slope**2)
        most = int(np.argmax(energy))
        share, where = float(energy[most] / energy.sum()), float(places[most])
        if share >= SINGLE_VISIT_SHARE and len(np.unique(problem.data.visit[station == most])) == 1:
            text = (
                f"{parameter.name} depends on a single visit at z_hat = {where:.3g}, which has"
                f" {100 * share:.0f} % of the information."
            )
            absorbing.append(
                CoefficientLimit(
                    coefficient=parameter.name,
                    rests_on={"z_hat": where},
                    share=share,
                    text=text,
                )
            )
        # a visit always holds one distance: a gain per visit is tried only where visits are few
        levelled = {"session": problem.data.session}
        if applies(problem.data):
            levelled["visit"] = problem.data.visit
        for label, values in levelled.items():
            basis = orthonormal(problem.space.project(indicators(values).T).T)
            left = jacobian[:, i] - basis @ (basis.T @ jacobian[:, i])
            share = float(left @ left) / float(jacobian[:, i] @ jacobian[:, i])
            if share < ABSORBED and len(np.unique(values)) > 1:
                text = (
                    f"{parameter.name} and a gain for every {label} ({gain}) are not"
                    f" distinguishable: no {label} has more than one distance."
                )
                absorbing.append(
                    CoefficientLimit(
                        coefficient=parameter.name, absorbed_by=gain, share=share, text=text
                    )
                )
                break
    return tuple(absorbing)
