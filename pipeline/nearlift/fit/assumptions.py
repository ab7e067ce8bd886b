"""Checks of a base fit's assumptions: throttle collapse, held quantity, constant C_L."""

from __future__ import annotations

from dataclasses import replace

from nearlift.campaign.manifest import Campaign
from nearlift.declare import FloatArray
from nearlift.fit import collapse, gum, held_quantity, rotor
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.fit.linearised import linear_problem, stand_in
from nearlift.fit.solver import solve
from nearlift.likelihood import student
from nearlift.likelihood.problem import Problem
from nearlift.results.assumptions import HeldQuantity, RotorCoefficient, ThrottleCollapse


def check(
    campaign: Campaign, fitted: LeastSquaresFit
) -> tuple[ThrottleCollapse, HeldQuantity | None, RotorCoefficient]:
    """The three checks of one boundary, from the fit of its base model."""
    problem, theta = linearised(fitted)
    parts, slope = (*fitted.parts, *fitted.plan.shared), linear_problem(fitted)[2]
    # the exponent is confounded with the coefficients and takes their degrees of freedom
    reach90 = student.quantile(0.95, fitted.effective[0]) if len(theta) else student.NORMAL_90
    held: HeldQuantity | None = None
    responses: tuple[held_quantity.Response, ...] = ()
    if len(theta):
        held, responses = held_quantity.examine(
            problem, theta, fitted.dof_of_all, reach90, campaign.rig.held
        )

    def freedom(g: FloatArray) -> FloatArray:
        return gum.freedom(problem, g, parts, fitted.noise, slope)

    return (
        collapse.examine(problem, theta, freedom, reach90),
        held,
        rotor.examine(campaign, problem, theta, fitted.covariance, responses),
    )


def linearised(fitted: LeastSquaresFit) -> tuple[Problem, FloatArray]:
    """The likelihood with every error in its covariance, and its optimum.

    A shared height error that was integrated over is linearised about its posterior mean. Its
    stated distribution is centred there too, which matters only if the trials hardly determine it.
    """
    problem, over = stand_in(fitted), fitted.marginal
    if over is None:
        return problem, fitted.theta
    about = replace(problem, shift=0.0)
    return about, solve(about, over.theta[over.best])[0]
