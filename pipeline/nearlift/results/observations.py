"""The accepted trials of one boundary, as arrays."""

from __future__ import annotations

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
    record : int array or None
        Which record a trial is a piece of, counted from 0, where records were cut into trials.
    u_zero_N : array or None
        Then the standard error of the record's zero, which its trials share; `u_lift_N` is without.
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
    record: IntArray | None = None
    u_zero_N: FloatArray | None = None
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
