"""Prior of a model's parameters: the declared distributions, truncated at the declared bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray, Parameter


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

    @cached_property
    def _log_mass(self) -> float:
        below, above = self._ends
        return math.log(above - below)

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log of the density, -inf outside the bounds, (m,)."""
        prior, (low, high) = self.parameter.prior, self.parameter.bounds
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
        return np.where((x >= low) & (x <= high), inside - self._log_mass, -np.inf)

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

    def draw(self, rng: np.random.Generator, n: int) -> FloatArray:
        """Independent draws, (n, p)."""
        uniform = rng.random((n, len(self.each)))
        return np.stack([b.quantile(uniform[:, i]) for i, b in enumerate(self.each)], axis=-1)

    @cached_property
    def _logarithmic(self) -> NDArray[np.bool_]:
        """Which parameters are scales: those with a log-normal prior."""
        return np.array(
            [b.parameter.prior.distribution == "lognorm" for b in self.each], dtype=bool
        )

    def coordinates(self, theta: FloatArray) -> FloatArray:
        """Theta (..., p) with scales replaced by their logarithms."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(
                self._logarithmic, np.log(np.where(self._logarithmic, theta, 1.0)), theta
            )

    def parameters(self, coordinates: FloatArray) -> FloatArray:
        """Theta from its coordinates."""
        with np.errstate(over="ignore"):
            return np.where(
                self._logarithmic,
                np.exp(np.where(self._logarithmic, coordinates, 0.0)),
                coordinates,
            )

    def log_stretch(self, theta: FloatArray) -> FloatArray:
        """Log Jacobian, (...): added to a log density in coordinates, gives one in theta."""
        with np.errstate(divide="ignore", invalid="ignore"):
            each: FloatArray = -np.log(np.where(self._logarithmic, theta, 1.0)).sum(axis=-1)
        return each
