"""The posterior density of a model's parameters: likelihood with L_inf and the noise's scale
integrated out, times the priors.

Conventions, the same as those of least squares:

- L_inf of each throttle has a prior flat in its logarithm and is integrated out in closed form; its
  constant is part of the evidence.
- The noise was learnt from repeats, so the scale of the coefficients' covariance is uncertain by a
  scaled inverse chi-square of `dof`, their effective degrees of freedom: one number here, the
  fewest of any coefficient. Integrated out, the likelihood's exp(-D / 2), D = chi2 - its least,
  becomes Student's (1 + D / dof)^-((dof + p) / 2): linear models get exactly the t intervals of
  least squares. How well the model fits has no say in the noise; only repeats have, and how visits
  scatter about the base model's curve where they are few.
- The covariance, budget included, is that of the least-squares fit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from nearlift.declare import FloatArray
from nearlift.fit.prior import JointPrior
from nearlift.likelihood.problem import Problem
from nearlift.likelihood.stations import Stations


@dataclass(frozen=True, kw_only=True)
class Density:
    """Log posterior of theta (m, p), not normalised; `centre` (p,) is the least-squares theta,
    `dof` of the noise (inf: known).
    """

    problem: Problem
    centre: FloatArray
    dof: float = math.inf

    @cached_property
    def prior(self) -> JointPrior:
        """The priors."""
        return JointPrior.from_parameters(self.problem.model.parameters)

    @cached_property
    def stations(self) -> Stations:
        """What makes chi2 cheap."""
        return Stations.from_problem(self.problem)

    @cached_property
    def least(self) -> float:
        """chi2 at the centre."""
        return float(self.stations.chi2(self.centre[None, :])[0])

    @cached_property
    def _constant(self) -> float:
        """Log of the likelihood at the centre, L_inf integrated out, and of what keeps its integral
        that of the normal one.
        """
        levels, log_det = self.problem.levels_log_det
        at_centre = (
            float(self.problem.log_likelihood(self.centre))
            + 0.5 * levels * math.log(2 * math.pi)
            - 0.5 * log_det
        )
        p = len(self.centre)
        if not math.isfinite(self.dof):
            return at_centre
        return (
            at_centre
            + math.lgamma((self.dof + p) / 2)
            - math.lgamma(self.dof / 2)
            - 0.5 * p * math.log(self.dof / 2)
        )

    def log_likelihood(self, theta: FloatArray) -> FloatArray:
        """Log of the marginal likelihood, -inf where the model has no value."""
        departure = self.stations.chi2(theta) - self.least
        if not math.isfinite(self.dof):
            return self._constant - 0.5 * departure
        return self._constant - 0.5 * (self.dof + len(self.centre)) * np.log1p(
            np.maximum(departure / self.dof, -1 + 1e-12)
        )

    def __call__(self, theta: FloatArray) -> FloatArray:
        """Log prior and log likelihood together; the model is asked only within the bounds."""
        log_prior = self.prior.log_density(theta)
        inside = np.isfinite(log_prior)
        result = np.full(len(theta), -np.inf)
        if inside.any():
            result[inside] = log_prior[inside] + self.log_likelihood(theta[inside])
        return result

    def spread(self) -> FloatArray:
        """Covariance (p, p) near the centre, to first order: the data's information and that of
        priors as wide as theirs.
        """
        jacobian = np.nan_to_num(self.problem.project(self.problem.jacobian(self.centre).T))
        information = jacobian @ jacobian.T
        sd = np.array([b.width90 / 3.3 for b in self.prior.each])
        scaled = np.linalg.inv(information * np.outer(sd, sd) + np.eye(len(sd)))
        return np.asarray(scaled * np.outer(sd, sd), dtype=np.float64)
