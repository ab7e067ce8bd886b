"""Posterior density of a model's parameters: marginal likelihood times priors.

Conventions, the same as those of least squares:

- L_inf of each throttle has a prior flat in its logarithm and is integrated out in closed form. The
  constant of this prior is part of the evidence.
- The noise is estimated from repeats and, where these are few, from the scatter of visits about the
  base model's curve. The model's misfit does not otherwise inform it. The scale of the
  coefficients' covariance therefore has a scaled inverse chi-square distribution with `dof`, the
  fewest effective degrees of freedom of any coefficient. It is integrated out: exp(-D / 2) becomes
  Student's (1 + D / dof)^-((dof + p) / 2), with D = chi2 less its minimum. Linear models get
  exactly the t intervals of least squares.
- The covariance, budget included, is that of the least-squares fit.
- Priors are the declared distributions, truncated at the declared bounds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from nearlift import derivative
from nearlift.declare import FloatArray, Parameter
from nearlift.likelihood.problem import Likelihood
from nearlift.likelihood.stations import Stations

#: Minus the log density where the density is zero, in the search for its peak. Ours: above that of
#: any trials.
NO_VALUE = 1e10
#: Width of a normal's central 90 % interval, in standard deviations, to two digits.
WIDTH_90 = 3.3


@dataclass(frozen=True, kw_only=True)
class TruncatedPrior:
    """The prior of one parameter, normalised to 1 within its bounds."""

    parameter: Parameter

    @cached_property
    def _whole(self) -> Any:
        """The distribution before truncation."""
        return self.parameter.prior.frozen()

    @cached_property
    def _mass(self) -> tuple[float, float]:
        """Probability below the lower bound, and within the bounds, before truncation."""
        below, above = self._whole.cdf(self.parameter.bounds)
        return float(below), float(above - below)

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log of the density, -inf outside the bounds, (m,)."""
        prior, (low, high) = self.parameter.prior, self.parameter.bounds
        # scipy's own log density costs as much as the likelihood
        if prior.distribution == "norm":
            scale = prior.scale * math.sqrt(2 * math.pi)
            log = -0.5 * ((x - prior.loc) / prior.scale) ** 2 - math.log(scale)
        else:
            log = np.asarray(self._whole.logpdf(x), dtype=float)
        return np.where((x >= low) & (x <= high), log - math.log(self._mass[1]), -np.inf)

    def quantile(self, probability: Any) -> FloatArray:
        """Quantile of the truncated distribution."""
        below, within = self._mass
        x = self._whole.ppf(below + np.asarray(probability) * within)
        return np.asarray(np.clip(x, *self.parameter.bounds), dtype=np.float64)

    @property
    def width90(self) -> float:
        """Width of the central 90 % interval."""
        return float(np.ptp(self.quantile([0.05, 0.95])))


@dataclass(frozen=True, kw_only=True)
class Density:
    """Unnormalised log posterior of theta (m, p); `centre` (p,) is the least-squares theta, `dof`
    are those of the noise (inf: known). The density is zero where theta differs from the centre by
    more than `reach` (p,).

    Departures from the centre are multiplied by `curvature` (p, p), if given, which replaces the
    likelihood's covariance by another (Ribatet et al. 2012, Statistica Sinica 22, 813).
    """

    problem: Likelihood
    centre: FloatArray
    dof: float = math.inf
    reach: FloatArray | float = math.inf
    curvature: FloatArray | None = None

    @cached_property
    def priors(self) -> tuple[TruncatedPrior, ...]:
        """The prior of each parameter; they are independent before the data."""
        return tuple(TruncatedPrior(parameter=p) for p in self.problem.model.parameters)

    @cached_property
    def stations(self) -> Stations:
        """The distinct stations, at which chi2 is computed."""
        sd = np.sqrt(np.diag(self.spread))
        return Stations.from_problem(self.problem, self.centre, sd)

    @cached_property
    def least(self) -> float:
        """chi2 at the centre."""
        return float(self.stations.chi2(self.centre[None, :])[0])

    @cached_property
    def _constant(self) -> float:
        """Log likelihood at the centre, L_inf integrated out, and the normalisation that gives
        Student's t the integral of the normal.
        """
        levels, log_det = self.problem.levels_log_det
        at_centre = float(self.problem.log_likelihood(self.centre))
        at_centre += 0.5 * (levels * math.log(2 * math.pi) - log_det)
        if math.isfinite(self.dof):
            half, p = self.dof / 2, len(self.centre)
            at_centre += math.lgamma(half + p / 2) - math.lgamma(half) - 0.5 * p * math.log(half)
        return at_centre

    def departure(self, theta: FloatArray) -> FloatArray:
        """chi2 less that at the centre, (m,), with `curvature`."""
        if self.curvature is not None:
            theta = self.centre + (theta - self.centre) @ self.curvature.T
        return np.asarray(self.stations.chi2(theta) - self.least, dtype=np.float64)

    def log_likelihood(self, theta: FloatArray) -> FloatArray:
        """Log of the marginal likelihood, -inf where the model has no value."""
        departure = self.departure(theta)
        if not math.isfinite(self.dof):
            return self._constant - 0.5 * departure
        return self._constant - 0.5 * (self.dof + len(self.centre)) * np.log1p(
            np.maximum(departure / self.dof, -1 + 1e-12)
        )

    def __call__(self, theta: FloatArray) -> FloatArray:
        """Log prior plus log likelihood; the model is evaluated only within the bounds."""
        result = np.zeros(len(theta))
        for prior, x in zip(self.priors, theta.T, strict=True):
            result += prior.log_density(x)
        result[(np.abs(theta - self.centre) > self.reach).any(axis=1)] = -np.inf
        inside = np.isfinite(result)
        if inside.any():
            result[inside] += self.log_likelihood(theta[inside])
        return result

    @cached_property
    def peak(self) -> FloatArray:
        """Approximate mode of the posterior, (p,), searched from the least-squares theta.

        It is rounded to a sixteenth of the spread: the last digits of a search depend on the
        processor, and would change all draws.
        """
        from scipy.optimize import minimize

        low, high = self.problem.model.bounds
        scale, start = np.sqrt(np.diag(self.spread)), np.clip(self.centre, low, high)
        first, last = (low - start) / scale, (high - start) / scale

        def at(x: FloatArray) -> FloatArray:
            return np.asarray(np.clip(start + x * scale, low, high), dtype=np.float64)

        def cost(x: FloatArray) -> FloatArray:
            value = self(at(x).reshape(-1, len(start)))
            return np.where(np.isfinite(value), -value, NO_VALUE).reshape(*x.shape[:-1], 1)

        def slopes(x: FloatArray) -> FloatArray:
            change, apart = derivative.central(cost, x, 1.0, first, last)
            return np.asarray(change[:, 0] / apart, dtype=np.float64)

        search: Any = minimize
        ends = list(zip(first, last, strict=True))
        end = search(lambda x: cost(x)[0], 0 * start, method="L-BFGS-B", jac=slopes, bounds=ends).x
        near = np.round(16 * end) / 16
        return at(near if cost(near)[0] < NO_VALUE else end)

    @cached_property
    def spread(self) -> FloatArray:
        """First-order covariance (p, p) at the centre, from the data's information and normal
        priors as wide as the declared ones.
        """
        jacobian = np.nan_to_num(self.problem.project(self.problem.jacobian(self.centre).T))
        if self.curvature is not None:
            jacobian = self.curvature.T @ jacobian
        sd = np.array([prior.width90 / WIDTH_90 for prior in self.priors])
        both = np.outer(sd, sd)
        scaled = np.linalg.inv(jacobian @ jacobian.T * both + np.eye(len(sd)))
        return np.asarray(scaled * both, dtype=np.float64)
