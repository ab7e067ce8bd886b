"""Prior of a model's parameters: the declared distributions, truncated at the declared bounds.

A posterior is compared with it and with the interval of least squares.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from nearlift.declare import FloatArray, Parameter
from nearlift.results.posterior import DeclaredPrior

#: Ratio of 90 % widths, posterior over prior, above which the data say nothing, and above which the
#: prior still matters.
SAME, SHAPED = 0.8, 0.3
#: Fraction of the bounded range that counts as at a bound, and the least share of draws there to be
#: reported.
EDGE, CROWD = 0.005, 0.02
#: Ratio of 90 % widths, posterior over least squares, outside which a reason is given; and ratio of
#: prior to least squares below which the prior is one.
NARROW, WIDE, CLOSE = 0.7, 1.4, 3.0


@dataclass(frozen=True, kw_only=True)
class TruncatedPrior:
    """The prior of one parameter, normalised to 1 within its bounds."""

    parameter: Parameter

    @cached_property
    def _whole(self) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
        """Cumulative distribution and its inverse, before truncation."""
        prior = self.parameter.prior
        if prior.distribution == "norm":
            # scipy.stats takes half a second to import, more than all else in a posterior
            from scipy.special import ndtr, ndtri

            return lambda x: ndtr(
                (x - prior.loc) / prior.scale
            ), lambda p: prior.loc + prior.scale * ndtri(p)
        if prior.distribution == "uniform":
            return lambda x: np.clip(
                (x - prior.loc) / prior.scale, 0.0, 1.0
            ), lambda p: prior.loc + prior.scale * p
        whole = prior.frozen()
        return whole.cdf, whole.ppf

    @cached_property
    def _ends(self) -> tuple[float, float]:
        """Cumulative probability at the bounds, before truncation."""
        low, high = self.parameter.bounds
        cumulative, _ = self._whole
        return float(cumulative(low)), float(cumulative(high))

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log of the density, -inf outside the bounds, (m,)."""
        prior, (low, high), (below, above) = self.parameter.prior, self.parameter.bounds, self._ends
        # scipy's own log density costs as much as the likelihood
        if prior.distribution == "norm":
            inside = -0.5 * ((x - prior.loc) / prior.scale) ** 2 - math.log(
                prior.scale * math.sqrt(2 * math.pi)
            )
        elif prior.distribution == "uniform":
            inside = np.where(
                (x >= prior.loc) & (x <= prior.loc + prior.scale), -math.log(prior.scale), -np.inf
            )
        else:
            inside = np.asarray(prior.frozen().logpdf(x), dtype=float)
        return np.where((x >= low) & (x <= high), inside - math.log(above - below), -np.inf)

    def quantile(self, probability: Any) -> FloatArray:
        """Quantile of the truncated distribution."""
        below, above = self._ends
        _, inverse = self._whole
        x = inverse(below + np.asarray(probability, dtype=float) * (above - below))
        return np.asarray(np.clip(x, *self.parameter.bounds), dtype=np.float64)

    @property
    def width90(self) -> float:
        """Width of the central 90 % interval."""
        low, high = self.quantile([0.05, 0.95])
        return float(high - low)


@dataclass(frozen=True, kw_only=True)
class JointPrior:
    """The joint prior of a model's parameters, which are independent before the data."""

    each: tuple[TruncatedPrior, ...]

    @classmethod
    def from_parameters(cls, parameters: Sequence[Parameter]) -> JointPrior:
        """From their declarations."""
        return cls(each=tuple(TruncatedPrior(parameter=p) for p in parameters))

    def log_density(self, theta: FloatArray) -> FloatArray:
        """Log of the joint density of theta (m, p), (m,)."""
        total = np.zeros(theta.shape[:-1])
        for i, prior in enumerate(self.each):
            total = total + prior.log_density(theta[..., i])
        return total


@dataclass(frozen=True, slots=True, kw_only=True)
class PriorComparison:
    """One parameter's posterior compared with its prior: `ratio` of 90 % widths, shares of draws at
    either bound, and remarks.
    """

    prior: DeclaredPrior
    ratio: float
    at_low: float
    at_high: float
    words: str


def compare_with_prior(prior: TruncatedPrior, draws: FloatArray) -> PriorComparison:
    """Compare draws (n,) of a parameter's posterior with its prior."""
    low, high = prior.parameter.bounds
    before = prior.quantile([0.05, 0.95])
    after = np.quantile(draws, [0.05, 0.95])
    ratio = float(np.ptp(after) / np.ptp(before))
    edge = EDGE * (high - low)
    at_low, at_high = float(np.mean(draws < low + edge)), float(np.mean(draws > high - edge))
    name = prior.parameter.name
    words = []
    if ratio > SAME:
        words.append(
            f"the data say nothing about {name}: its interval is the prior's"
            f" ({prior.parameter.prior}), not a result"
        )
    elif ratio > SHAPED:
        words.append(
            f"the prior still shapes {name}: the data left {100 * ratio:.0f} % of its width"
            f" ({prior.parameter.prior})"
        )
    for share, bound in ((at_low, low), (at_high, high)):
        if share > CROWD:
            words.append(
                f"{100 * share:.0f} % of the posterior of {name} lies against its bound {bound:g}"
            )
    return PriorComparison(
        prior=DeclaredPrior(
            text=str(prior.parameter.prior),
            lo90=float(before[0]),
            hi90=float(before[1]),
            bounds=prior.parameter.bounds,
        ),
        ratio=ratio,
        at_low=at_low,
        at_high=at_high,
        words="; ".join(words),
    )


def compare_with_fit(
    prior: TruncatedPrior, draws: FloatArray, lo90: float, hi90: float
) -> tuple[float, str]:
    """Ratio of the posterior's 90 % width to that of least squares, with a reason where far from 1.

    Least squares gives `lo90` to `hi90`; the ratio is nan where it has no interval.
    """
    wide = hi90 - lo90
    if not (np.isfinite(wide) and wide > 0):
        return float("nan"), ""
    ratio = float(np.ptp(np.quantile(draws, [0.05, 0.95])) / wide)
    if NARROW <= ratio <= WIDE:
        return ratio, ""
    low, high = prior.parameter.bounds
    edge = EDGE * (high - low)
    reasons = [
        f"the bound {b:g} cuts it off"
        for b, out in ((low, lo90 < low + edge), (high, hi90 > high - edge))
        if out and ratio < NARROW
    ]
    if ratio < NARROW and prior.width90 < CLOSE * wide:
        reasons.append("the prior narrows it")
    reasons = reasons or ["the model is not linear there"]
    name = prior.parameter.name
    return (
        ratio,
        (
            f"the 90 % interval of {name} is {ratio:.2g} times the width by least squares,"
            f" probably because {' and '.join(reasons)}; see its profile"
        ),
    )
