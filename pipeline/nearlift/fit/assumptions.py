"""Checks of a base fit's assumptions: throttle collapse, held quantity, constant C_L."""

from __future__ import annotations

from nearlift.campaign.manifest import Campaign
from nearlift.declare import FloatArray
from nearlift.fit import collapse, held_quantity, information, rotor
from nearlift.fit.least_squares import LeastSquaresFit
from nearlift.likelihood import student
from nearlift.results.assumptions import HeldQuantity, RotorCoefficient, ThrottleCollapse


def check(
    campaign: Campaign, fitted: LeastSquaresFit
) -> tuple[ThrottleCollapse, HeldQuantity | None, RotorCoefficient]:
    """The three checks of one boundary, from the fit of its base model."""
    problem, theta = fitted.problem, fitted.theta
    # the exponent is confounded with the coefficients and takes their degrees of freedom
    reach90 = student.quantile(0.95, fitted.effective[0]) if len(theta) else student.NORMAL_90
    held: HeldQuantity | None = None
    responses: tuple[held_quantity.Response, ...] = ()
    if len(theta):
        held, responses = held_quantity.examine(
            problem, theta, fitted.dof_of_all, reach90, campaign.rig.held
        )

    def freedom(g: FloatArray) -> FloatArray:
        return information.freedom(problem, g, fitted.parts, fitted.noise, fitted.slope)

    return (
        collapse.examine(problem, theta, freedom, reach90),
        held,
        rotor.examine(campaign, problem, theta, fitted.covariance, responses),
    )
