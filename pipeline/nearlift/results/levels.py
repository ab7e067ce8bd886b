"""L_inf as a curve: its logarithm as a polynomial of the logarithms of throttle and supply."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import FloatArray
from nearlift.errors import InputRefused
from nearlift.results.document import Real


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelCurve:
    """All products of at most `degree` of the logarithms of what L_inf is a curve of, each scaled
    to [-1, 1] over the trials.

    Attributes
    ----------
    of : tuple of str
        ``throttle``, and further columns of the trials in SI, such as ``supply_V``.
    degree : int
        1 is a power law.
    low, high, typical : tuple of float
        Range over the trials, and median, of each.
    shown : tuple of float
        Throttles at which L_inf is given, the others of `of` at their median.
    """

    of: tuple[str, ...]
    degree: int
    low: tuple[Real, ...]
    high: tuple[Real, ...]
    typical: tuple[Real, ...]
    shown: tuple[Real, ...]

    @property
    def terms(self) -> tuple[tuple[int, ...], ...]:
        """Factors of each column, as indices into `of`; none for the first."""
        return tuple(
            term
            for d in range(self.degree + 1)
            for term in combinations_with_replacement(range(len(self.of)), d)
        )

    def columns(self, values: FloatArray) -> FloatArray:
        """The polynomial's columns (n, K) at values (v, n) of what the curve is of."""
        low, high = (np.log(np.array(end))[:, None] for end in (self.low, self.high))
        x = 2 * (np.log(values) - low) / (high - low) - 1
        return np.stack([np.prod(x[list(term)], axis=0) for term in self.terms], axis=1)

    def at(self, throttle: FloatArray) -> FloatArray:
        """Values (v, n) of what the curve is of at some throttles, the others at their median."""
        typical = np.tile(np.array(self.typical)[:, None], len(throttle))
        typical[self.of.index("throttle")] = throttle
        return typical

    def nearest(self, throttle: FloatArray) -> NDArray[np.int64]:
        """Index of the nearest of `shown` to each throttle."""
        distance = np.abs(np.subtract.outer(throttle, np.array(self.shown)))
        return np.asarray(np.argmin(distance, axis=1), dtype=np.int64)


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelFit:
    """A fitted curve of L_inf.

    Attributes
    ----------
    coefficients : tuple of float
        Of the curve's columns, L_inf in N.
    covariance : tuple of tuple of float
        Theirs, the lift model's coefficients free.
    held_out : mapping of int to float
        By degree: root mean square of log lift in visits left out, with free curves of distance.
    """

    curve: LevelCurve
    coefficients: tuple[Real, ...]
    covariance: tuple[tuple[Real, ...], ...]
    held_out: Mapping[int, Real]

    def lift_inf_N(self, **values: float) -> tuple[float, float]:
        """L_inf, N, and its standard uncertainty at a throttle (a fraction); other arguments of the
        curve are at their medians unless given.

        Raises
        ------
        InputRefused
            A value lies beyond those of the trials: a polynomial says nothing there.
        """
        curve = self.curve
        at = dict(zip(curve.of, curve.typical, strict=True)) | values
        for name, low, high in zip(curve.of, curve.low, curve.high, strict=True):
            if not low <= at[name] <= high:
                raise InputRefused(
                    f"L_inf at {name} = {at[name]:.4g}",
                    f"lies outside {low:.4g} to {high:.4g}, where lift was measured",
                    "measure there, or ask within that range",
                )
        row = curve.columns(np.array([[at[name]] for name in curve.of]))[0]
        value = math.exp(float(row @ np.array(self.coefficients)))
        return value, value * math.sqrt(float(row @ np.array(self.covariance) @ row))
