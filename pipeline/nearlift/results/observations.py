"""The accepted trials of one boundary, as arrays; and L_inf as a curve over them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import BoolArray, Boundary, FloatArray, IntArray
from nearlift.results.document import Real


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelCurve:
    """Log L_inf as a polynomial of `degree` (1: a power law).

    Its variables are the logarithms of the columns `of`, each scaled to [-1, 1] over the trials.
    They are ``throttle`` and further columns of the trials in SI, such as ``supply_V``. `low`,
    `high` and `typical` are their range over the trials, and median. L_inf is given at the
    throttles `shown`, the others of `of` at their median.
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
class Observations:
    """The accepted trials of one boundary, in run order; all arrays have shape (n,).

    `z_hat` is distance over rotor radius, inf in free air. `u_lift_N` is the standard error of the
    mean lift from within the record (0 where unknown), `n_eff` the effectively independent samples
    behind it. `throttle` is a fraction. `visit` counts the traverse's stops, `session` the sessions
    from 0 (all 0 where not recorded). `geometry` is what models may need, such as `spacing_hat`.
    `covariates` are further columns of the trials in SI, nan where missing.

    Where records were cut into trials, `record` is the one that a trial is a piece of, from 0.
    `u_zero_N` is then the standard error of the record's zero, which its trials share; `u_lift_N`
    is without. `ordered`: in the order in which they were run, which a published table may not say.
    `curve` is what log L_inf is a polynomial of; None: free for every throttle.
    """

    boundary: Boundary
    trial: NDArray[Any]
    z_hat: FloatArray
    lift_N: FloatArray
    u_lift_N: FloatArray
    n_eff: FloatArray
    throttle: FloatArray
    visit: IntArray
    session: IntArray
    radius_m: float
    geometry: Mapping[str, Any] = field(default_factory=dict)
    covariates: Mapping[str, FloatArray] = field(default_factory=dict)
    record: IntArray | None = None
    u_zero_N: FloatArray | None = None
    ordered: bool = True
    curve: LevelCurve | None = None

    @property
    def n(self) -> int:
        """Number of trials."""
        return len(self.lift_N)

    @property
    def levels(self) -> FloatArray:
        """The throttles at which L_inf is given, ascending: every distinct one; of a curve, those
        that it shows.
        """
        if self.curve is None:
            return np.unique(self.throttle)
        return np.array(self.curve.shown)[np.unique(self.curve.nearest(self.throttle))]

    @property
    def level(self) -> IntArray:
        """Index into `levels` of each trial; of a curve, the nearest."""
        at = self.throttle if self.curve is None else self.curve.nearest(self.throttle)
        return np.unique(at, return_inverse=True)[1].astype(np.int64)

    @property
    def level_design(self) -> FloatArray:
        """Design of log L_inf, (n, K): an indicator for each throttle, or the curve's powers."""
        if self.curve is None:
            return np.eye(len(self.levels))[self.level]
        return self.curve.columns(self.curve_inputs)

    @property
    def unknown_levels(self) -> int:
        """Number of parameters of log L_inf, K."""
        return len(self.levels) if self.curve is None else len(self.curve.terms)

    @property
    def curve_inputs(self) -> FloatArray:
        """Throttle and the other inputs of the curve, (v, n)."""
        assert self.curve is not None
        known = {"throttle": self.throttle, **self.covariates}
        return np.stack([known[name] for name in self.curve.of])

    def shown(self, coefficients: FloatArray) -> FloatArray:
        """Rows that multiply `level_design`, (K, ...), as those of `levels`."""
        if self.curve is None:
            return coefficients
        return self.curve.columns(self.curve.at(self.levels)) @ coefficients

    def of_trials(self, coefficients: FloatArray) -> FloatArray:
        """Log L_inf of each trial, (n,), from what multiplies `level_design`."""
        if self.curve is None:
            return coefficients[self.level]
        return np.asarray(self.level_design @ coefficients, dtype=np.float64)

    def lift_inf_N(self, coefficients: FloatArray) -> FloatArray:
        """L_inf of each trial, (n,), likewise."""
        return np.exp(self.of_trials(coefficients))

    def level_medians(self, values: FloatArray) -> FloatArray:
        """Median of trials' values (n,) at each of `levels`."""
        level = self.level
        return np.array([np.median(values[level == k]) for k in range(len(self.levels))])

    @property
    def nearness(self) -> FloatArray:
        """1 / z_hat, (n,); 0 far from any boundary."""
        return np.where(np.isfinite(self.z_hat), 1 / np.maximum(self.z_hat, 1e-3), 0.0)

    def level_known_from(self, train: BoolArray) -> BoolArray:
        """Trials whose L_inf the trials `train` tell: those at one of their throttles; of a curve,
        within their range of all that it is of.
        """
        if self.curve is None:
            return np.isin(self.throttle, self.throttle[train])
        columns = self.curve_inputs
        low, high = (end(columns[:, train], axis=1)[:, None] for end in (np.min, np.max))
        return np.asarray(((columns >= low) & (columns <= high)).all(axis=0), dtype=np.bool_)

    def take(self, keep: NDArray[Any]) -> Observations:
        """The trials selected by a mask or an index array."""
        given = {f.name: getattr(self, f.name) for f in fields(self)}
        arrays = {name: v[keep] for name, v in given.items() if isinstance(v, np.ndarray)}
        covariates = {k: v[keep] for k, v in self.covariates.items()}
        return replace(self, **arrays, covariates=covariates)
