"""Priors of a model's parameters: the declared distributions, truncated at the declared bounds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from nearlift.declare import FloatArray, Parameter


@dataclass(frozen=True, kw_only=True)
class TruncatedPrior:
    """The prior of one parameter, normalised to 1 within its bounds."""

    parameter: Parameter

    @cached_property
    def _whole(self) -> Any:
        """The distribution before truncation."""
        return self.parameter.prior.frozen()

    @cached_property
    def _ends(self) -> FloatArray:
        """Cumulative probability at the bounds, before truncation."""
        return np.asarray(self._whole.cdf(self.parameter.bounds), dtype=np.float64)

    @cached_property
    def _log_mass(self) -> float:
        """Log of the probability within the bounds, before truncation."""
        below, above = self._ends
        return math.log(above - below)

    def log_density(self, x: FloatArray) -> FloatArray:
        """Log of the density, -inf outside the bounds, (m,)."""
        prior, (low, high) = self.parameter.prior, self.parameter.bounds
        # scipy's own log density costs as much as the likelihood
        if prior.distribution == "norm":
            log = -0.5 * ((x - prior.loc) / prior.scale) ** 2 - math.log(
                prior.scale * math.sqrt(2 * math.pi)
            )
        else:
            log = np.asarray(self._whole.logpdf(x), dtype=float)
        return np.where((x >= low) & (x <= high), log - self._log_mass, -np.inf)

    def quantile(self, probability: Any) -> FloatArray:
        """Quantile of the truncated distribution."""
        below, above = self._ends
        x = self._whole.ppf(below + np.asarray(probability, dtype=float) * (above - below))
        return np.asarray(np.clip(x, *self.parameter.bounds), dtype=np.float64)

    @property
    def width90(self) -> float:
        """Width of the central 90 % interval."""
        return float(np.ptp(self.quantile([0.05, 0.95])))
