"""Checks of the base fits' assumptions, blocks of fit.json: whether one curve serves all throttles,
what a trial held constant, and C_L.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from nearlift.results.document import IfAny, NumberKey, Real, Unbounded
from nearlift.results.estimate import Estimate


@dataclass(frozen=True, slots=True, kw_only=True)
class CollapseTest:
    """An F test: what the freedom of `dof[0]` more unknowns gains, over noise known with `dof[1]`
    degrees of freedom.
    """

    statistic: Annotated[Real, Field(alias="F")]
    dof: tuple[int, Unbounded]
    p_value: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class LargestDeparture:
    """The two throttles that may differ most: by what fraction, and what 95 % confidence cannot
    exclude.
    """

    between: tuple[Real, Real]
    value: Real
    u: Real
    bound95: Unbounded


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrottleCollapse:
    """Whether Delta L is the same at all throttles: the scale of the log ratio at each throttle,
    about 1 on average. What these trials cannot test is None.
    """

    per_throttle: Mapping[NumberKey, Estimate]
    test: CollapseTest | None
    largest_departure: LargestDeparture | None
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ExponentFit(Estimate):
    """The headline coefficient with the ratio raised to `n`; `supposes` is the assumption with that
    exponent.
    """

    supposes: IfAny[str] = None
    n: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class LoggedResponse:
    """How a logged quantity answers to the boundary, and the exponents that theory then allows."""

    quantity: str
    response: Estimate
    p_value: Real
    held: bool
    spread: Real
    exponents: tuple[Real, Real] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldQuantity:
    """Dependence of the headline coefficient on the exponent of the ratio (the held quantity)."""

    declared: str
    coefficient: str
    plausible: tuple[ExponentFit, ...]
    exponent_from_lift: Estimate | None
    logged: tuple[LoggedResponse, ...]
    supported_exponents: tuple[Real, Real] | None
    supported: tuple[ExponentFit, ...]
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrottleLift(Estimate):
    """C_L at one throttle, and the speed in it."""

    speed_Hz: Real


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorTrend:
    """C_L per throttle: one constant, and a power law of speed.

    `exponent` and `p_trend` (of a constant C_L) are None for one throttle.
    """

    air_density: Real
    per_throttle: Mapping[NumberKey, ThrottleLift]
    mean: Estimate
    exponent: Estimate | None
    p_trend: float | None
    text: str


@dataclass(frozen=True, slots=True, kw_only=True)
class RotorUnknown:
    """C_L cannot be had for want of what is `missing`."""

    missing: tuple[str, ...]
    text: str


RotorCoefficient = RotorTrend | RotorUnknown
