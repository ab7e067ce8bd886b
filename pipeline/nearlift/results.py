"""Frozen values that the cores exchange: what was observed, what was estimated."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nearlift.declare import Boundary, FloatArray

IntArray = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Observations:
    """The accepted trials of one boundary, in run order; all arrays have shape (n,).

    Attributes
    ----------
    boundary : str
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
    ordered : bool
        Whether the trials stand in the order in which they were run; a published table may not say.
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
    ordered: bool = True

    @property
    def n(self) -> int:
        """Number of trials."""
        return len(self.lift_N)

    @property
    def levels(self) -> FloatArray:
        """The distinct throttles, ascending."""
        return np.unique(self.throttle)

    @property
    def level(self) -> IntArray:
        """Index into `levels` of each trial."""
        return np.searchsorted(self.levels, self.throttle).astype(np.int64)

    def take(self, keep: NDArray[Any]) -> Observations:
        """The trials selected by a mask or an index array."""
        import dataclasses

        arrays = {
            f.name: getattr(self, f.name)[keep]
            for f in dataclasses.fields(self)
            if isinstance(getattr(self, f.name), np.ndarray)
        }
        return dataclasses.replace(
            self, **arrays, covariates={k: v[keep] for k, v in self.covariates.items()}
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A number with its standard uncertainty and 90 % interval, in `unit`."""

    value: float
    u: float
    lo90: float
    hi90: float
    unit: str = "1"
    at_bound: bool = False

    @classmethod
    def of(cls, entry: Mapping[str, Any]) -> Estimate:
        """From an entry of a JSON product, whatever else it says; null, which JSON has for what is
        not finite, is nan.
        """
        numbers = {
            name: math.nan if entry[name] is None else float(entry[name])
            for name in ("value", "u", "lo90", "hi90")
        }
        return cls(**numbers, unit=entry.get("unit", "1"), at_bound=bool(entry.get("at_bound")))


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """How trials scatter about any smooth curve.

    Attributes
    ----------
    relative : float
        Standard deviation in proportion to lift, beyond what the records themselves show.
    force_N : float
        Standard deviation of an additive force.
    height_m : float
        Standard deviation of the height of one visit of the traverse, shared by the visit's trials.
    common : float
        Standard deviation, in proportion to lift, of what else the trials of a visit have in
        common.
    drift : tuple of float
        Standard deviations, in proportion to lift, of slow drifts between trials, one for each
        length in `likelihood.noise.DRIFT_LENGTHS`.
    source : str
        What they were estimated from.
    dof : float
        Degrees of freedom behind them.
    sizes, log_covariance : tuple
        The names of what was estimated (`drift0` and so on for the drifts), and the covariance of
        the logarithms of their sizes: how well the noise itself is known. Empty where it was
        declared.
    """

    relative: float
    force_N: float = 0.0
    height_m: float = 0.0
    common: float = 0.0
    drift: tuple[float, ...] = ()
    source: str = "declared"
    dof: float = np.inf
    sizes: tuple[str, ...] = ()
    log_covariance: tuple[tuple[float, ...], ...] = ()

    def record(self) -> dict[str, Any]:
        """Its block in a product."""
        sizes = {
            name: getattr(self, name) for name in ("relative", "force_N", "height_m", "common")
        }
        drift = float(np.sqrt(np.sum(np.square(self.drift))))
        return {
            **sizes,
            "drift": drift,
            "drift_by_length": list(self.drift),
            "source": self.source,
            "dof": self.dof,
        }

    @classmethod
    def recorded(cls, block: Mapping[str, Any]) -> Noise:
        """The noise of such a block."""
        own = {name: value for name, value in block.items() if name != "drift_by_length"}
        return cls(**{**own, "drift": tuple(block["drift_by_length"])})
