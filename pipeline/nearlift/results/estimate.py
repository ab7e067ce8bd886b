"""An estimate with its interval, and the noise of trials."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, computed_field

from nearlift.results.document import Above, Below, IfAny, Real, Unbounded, Unwritten


@dataclass(frozen=True, slots=True, kw_only=True)
class Interval:
    """A number with its 90 % interval."""

    value: Real
    lo90: Below
    hi90: Above


@dataclass(frozen=True, slots=True, kw_only=True)
class Intervals:
    """Ends of the intervals of 68, 90 and 95 %."""

    lo68: Real
    hi68: Real
    lo90: Real
    hi90: Real
    lo95: Real
    hi95: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate(Interval):
    """A number in `unit` with its standard uncertainty and 90 % interval. Parameters of a model
    have `at_bound`: whether it is at the end of its range.
    """

    u: Unbounded
    unit: str = "1"
    at_bound: IfAny[bool] = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ValueWithU:
    """A number with its standard uncertainty."""

    value: Real
    u: Real


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
        length in `likelihood.variance_components.DRIFT_LENGTHS`.
    source : str
        What they were estimated from.
    dof : float
        Degrees of freedom behind them.
    sizes, log_covariance : tuple
        Names of the estimated components (`drift0` and so on for the drifts), and the covariance
        of the logarithms of their sizes. Empty where the noise was declared.
    modes : tuple
        Logarithms of the sizes at each mode of their posterior, force as a fraction of the median
        lift. A search among nearly the same trials begins there.
    """

    relative: Real
    force_N: Real = 0.0
    height_m: Real = 0.0
    common: Real = 0.0
    drift: Annotated[tuple[Real, ...], Field(alias="drift_by_length")] = ()
    source: str = "declared"
    dof: Unbounded = math.inf
    sizes: Unwritten[tuple[str, ...]] = ()
    log_covariance: Unwritten[tuple[tuple[float, ...], ...]] = ()
    modes: Unwritten[tuple[tuple[float, ...], ...]] = ()

    @computed_field(alias="drift")  # type: ignore[prop-decorator]
    @property
    def drift_rms(self) -> float:
        """Root of the sum of the drifts' variances."""
        return math.sqrt(sum(sd**2 for sd in self.drift))
