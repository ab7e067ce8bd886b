"""The accepted trials of one boundary, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray, IntArray
from nearlift.results.levels import LevelCurve


@dataclass(frozen=True, slots=True, kw_only=True)
class Observations:
    """The accepted trials of one boundary, in run order; all arrays have shape (n,).

    Attributes
    ----------
    trial : object array of str
    z_hat : array
        Distance over rotor radius; inf in free air.
    lift_N, u_lift_N : array
        Mean lift and its standard error from within the record (0 where unknown).
    n_eff : array
        Effectively independent samples behind each mean.
    throttle : array
        Fraction.
    visit : int array
        The traverse's stops, counted from 0.
    session : int array
        Session index from 0; all 0 where not recorded.
    radius_m : float
        Rotor radius.
    geometry : mapping
        What models may need: `spacing_hat`, `diagonal_hat`, `layout_hat`.
    covariates : mapping of str to array
        Further columns of the trials, SI; nan where missing.
    record : int array or None
        Which record a trial is a piece of, counted from 0, where records were cut into trials.
    u_zero_N : array or None
        Then the standard error of the record's zero, which its trials share; `u_lift_N` is without.
    ordered : bool
        Whether the trials are in the order in which they were run; a published table may not say.
    curve : LevelCurve or None
        What log L_inf is a polynomial of; None: free for every throttle.
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
        if self.curve is None:
            return np.searchsorted(self.levels, self.throttle).astype(np.int64)
        nearest = np.unique(self.curve.nearest(self.throttle), return_inverse=True)[1]
        return nearest.astype(np.int64)

    @property
    def level_design(self) -> FloatArray:
        """Design of log L_inf, (n, K): an indicator for each throttle, or the curve's powers."""
        if self.curve is None:
            return np.eye(len(self.levels))[self.level]
        return self.curve.columns(self.curve_inputs)

    @property
    def unknown_levels(self) -> int:
        """How many numbers log L_inf has, K."""
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
        if self.curve is None:
            return np.exp(coefficients)[self.level]
        return np.exp(self.of_trials(coefficients))

    def level_medians(self, values: FloatArray) -> FloatArray:
        """Median of trials' values (n,) at each of `levels`."""
        level = self.level
        return np.array([np.median(values[level == k]) for k in range(len(self.levels))])

    @property
    def nearness(self) -> FloatArray:
        """1 / z_hat, (n,); 0 far from any boundary."""
        return np.where(np.isfinite(self.z_hat), 1 / np.maximum(self.z_hat, 1e-3), 0.0)

    def level_known_from(self, train: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Trials whose L_inf the trials `train` tell: those at one of their throttles; of a curve,
        within their range of all that it is of.
        """
        if self.curve is None:
            return np.isin(self.throttle, self.throttle[train])
        columns = self.curve_inputs
        low, high = columns[:, train].min(axis=1), columns[:, train].max(axis=1)
        inside: NDArray[np.bool_] = (columns >= low[:, None]) & (columns <= high[:, None])
        return np.asarray(inside.all(axis=0), dtype=np.bool_)

    def take(self, keep: NDArray[Any]) -> Observations:
        """The trials selected by a mask or an index array."""
        arrays = {
            f.name: getattr(self, f.name)[keep]
            for f in fields(self)
            if isinstance(getattr(self, f.name), np.ndarray)
        }
        covariates = {k: v[keep] for k, v in self.covariates.items()}
        return replace(self, **arrays, covariates=covariates)
