"""An estimate with its interval, and the noise of trials."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Self

from pydantic import Field, computed_field

from nearlift.results.document import Above, Below, IfAny, Real, Unbounded, Unwritten

#: Default of a number that an estimate does not have; it is not written.
ABSENT = float("nan")
_LEFT_OUT = Field(exclude_if=lambda number: number is ABSENT)


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A number with its uncertainty, by the same names in every product.

    `u` is the standard uncertainty, `dof` the effective degrees of freedom behind it; `unit` is
    "1" without dimension. `lo68` to `hi95` are ends of intervals. `median` is of draws, whose mean
    is the value. `at_bound`: the parameter is at the end of its range. `warning` is given where the
    degrees of freedom are few.
    """

    value: Real
    u: Annotated[Unbounded, _LEFT_OUT] = ABSENT
    dof: Annotated[Unbounded, _LEFT_OUT] = ABSENT
    unit: Annotated[str, Field(exclude_if=lambda unit: not unit)] = ""
    lo68: Annotated[Below, _LEFT_OUT] = ABSENT
    hi68: Annotated[Above, _LEFT_OUT] = ABSENT
    lo90: Annotated[Below, _LEFT_OUT] = ABSENT
    hi90: Annotated[Above, _LEFT_OUT] = ABSENT
    lo95: Annotated[Below, _LEFT_OUT] = ABSENT
    hi95: Annotated[Above, _LEFT_OUT] = ABSENT
    median: Annotated[Real, _LEFT_OUT] = ABSENT
    at_bound: IfAny[bool] = None
    warning: IfAny[str] = None

    @classmethod
    def around(cls, value: float, u: float, quantile: float, unit: str = "1", **more: Any) -> Self:
        """An estimate, its 90 % interval `quantile` standard uncertainties to either side."""
        low, high = float(value - quantile * u), float(value + quantile * u)
        return cls(value=float(value), u=float(u), unit=unit, lo90=low, hi90=high, **more)


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Scatter of trials about any smooth curve, as standard deviations.

    `relative` is in proportion to lift, beyond what the records themselves show, and `force_N` an
    additive force. `height_m` is that of one visit's height, shared by its trials. In proportion to
    lift, `common` is what else the trials of a visit have in common. `drift` are slow drifts
    between trials, one for each length in `likelihood.variance_components.DRIFT_LENGTHS`.

    They were estimated from `source`, with `dof` degrees of freedom. `sizes` are the estimated
    components (`drift0` and so on for the drifts), with the covariance of the logarithms of their
    sizes. Both are empty where the noise was declared. `modes` are the logarithms of the sizes at
    each mode of their posterior, force as a fraction of the median lift. A search among nearly the
    same trials begins there.
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
