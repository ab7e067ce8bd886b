"""Random-effects analysis of one coefficient over campaigns: mean, spread between campaigns,
prediction.

``y = mu + spread * e + error``: each campaign's error has its own uncertainty. Campaigns may share
a part of it (one load cell, say). A few campaigns hardly determine the spread. It is therefore
integrated over, and not set to its most likely value, which is zero far too often. `mu` has a flat
prior.
"""

from __future__ import annotations

import numpy as np

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.likelihood import student
from nearlift.results.answers import Population, SpreadPrior
from nearlift.results.estimate import Estimate

#: Grid points of the integral over the spread. Ours: 4.5 decades, a point each 2.6 %.
SPREAD_POINTS = 400
#: Fewest campaigns for an estimate of the spread: two have one difference and no scatter of it.
MIN_CAMPAIGNS = 3
#: Probability beyond each end of an interval (90 %, as everywhere in the package).
TAIL_PROBABILITY = 0.05


def population(value: FloatArray, covariance: FloatArray, unit: str = "1") -> Population:
    """Population mean and spread of a coefficient.

    Parameters
    ----------
    value : (n,) array
    covariance : (n, n) array
        Of the values' errors; off the diagonal what campaigns share.

    Raises
    ------
    InputRefused
        Fewer than three campaigns, or a value without an uncertainty.

    Notes
    -----
    The spread's prior is half-Cauchy (Gelman 2006): it allows zero and never excludes a large
    spread. Its scale is the typical uncertainty or the values' own spread, whichever is larger.
    """
    from scipy.stats import chi2

    n = len(value)
    if n < MIN_CAMPAIGNS:
        raise InputRefused(
            "compare",
            f"{n} campaigns do not determine how much campaigns differ",
            f"give at least {MIN_CAMPAIGNS}",
        )
    u = np.sqrt(np.diag(covariance))
    if not (np.isfinite(value).all() and np.isfinite(u).all() and (u > 0).all()):
        raise InputRefused(
            "compare", "a value has no uncertainty", "leave that campaign out, or fit it again"
        )
    scale = float(max(np.median(u), np.std(value, ddof=1)))
    # errors' principal axes: there the spread only adds to each variance
    length, axes = np.linalg.eigh(covariance)
    length = np.maximum(length, 1e-12 * length.max())
    ones, y = axes.T @ np.ones(n), axes.T @ value
    spread = np.concatenate([[0.0], scale * np.geomspace(1e-3, 30.0, SPREAD_POINTS)])
    weight = 1.0 / (length + spread[:, None] ** 2)
    information = weight @ ones**2
    mean = (weight @ (ones * y)) / information
    misfit = np.einsum("gi,gi->g", weight, (y - mean[:, None] * ones) ** 2)
    log_likelihood = 0.5 * np.log(weight).sum(axis=1) - 0.5 * np.log(information) - 0.5 * misfit

    def posterior(prior_scale: float) -> FloatArray:
        log_density = log_likelihood - np.log1p((spread / prior_scale) ** 2)
        density = np.exp(log_density - log_density.max()) * np.gradient(spread)
        return np.asarray(density / density.sum(), dtype=np.float64)

    density = posterior(scale)
    u_mean = np.sqrt(1.0 / information)
    q = float(misfit[0])
    return Population(
        mean=_mixture(mean, u_mean, density, unit),
        spread=_quantiles(spread, density, unit),
        next=_mixture(mean, np.hypot(u_mean, spread), density, unit),
        q=q,
        dof=n - 1,
        p_value=float(chi2.sf(q, n - 1)),
        spread_prior=SpreadPrior(
            scale=scale, mean_if_doubled=_mixture(mean, u_mean, posterior(2 * scale), unit)
        ),
    )


def _mixture(centre: FloatArray, sd: FloatArray, weight: FloatArray, unit: str) -> Estimate:
    """Mean, standard deviation and 90 % interval of a mixture of normals."""
    mean = float(weight @ centre)
    u = float(np.sqrt(weight @ (sd**2 + (centre - mean) ** 2)))
    low, high = student.mixture(TAIL_PROBABILITY, np.column_stack([weight, centre, sd]), np.inf)
    return Estimate(value=mean, u=u, lo90=low, hi90=high, unit=unit)


def _quantiles(x: FloatArray, weight: FloatArray, unit: str) -> Estimate:
    """Median, standard deviation and 90 % interval of a density on a grid."""
    below = np.cumsum(weight) - 0.5 * weight
    low, median, high = np.interp([TAIL_PROBABILITY, 0.5, 1 - TAIL_PROBABILITY], below, x)
    mean = weight @ x
    return Estimate(
        value=float(median),
        u=float(np.sqrt(weight @ (x - mean) ** 2)),
        lo90=float(low),
        hi90=float(high),
        unit=unit,
    )
